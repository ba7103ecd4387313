"""YAML is read as PyYAML's own loader reads it, and depth ends in an error."""

import pytest
import yaml

from hdd_servo_ros.messages.plain_yaml import read_yaml

TEXTS = (
    '',
    'a: 1\nb: [1.5, .inf, -3, 1e3, 0x10, 010, 1_000, true, no, ~, "1", 2001-01-01]\n',
    'a: &x {b: 1}\nc: *x\nd: {<<: *x, e: 2}\n',
    'text: |\n  two\n  lines\nµ: "\\u00b5"\n',
    '[' * 100 + ']' * 100,
)


@pytest.mark.parametrize('text', TEXTS)
def test_it_reads_as_the_loader_of_pyyaml(text):
    assert read_yaml(text) == yaml.safe_load(text)


@pytest.mark.parametrize('text', ['[' * 100_000, '{a: ' * 101 + '1' + '}' * 101, '- ' * 200 + '1'])
def test_depth_is_an_error(text):
    with pytest.raises(yaml.YAMLError, match='line 1 is nested more than 100 deep'):
        read_yaml(text)


@pytest.mark.parametrize('text', ['a: [', 'a: b: c', '!!python/object:os.system {}', '\x00'])
def test_what_is_no_yaml_is_an_error(text):
    with pytest.raises(yaml.YAMLError):
        read_yaml(text)
