"""YAML within the size limits is read as by PyYAML."""

import pytest
import yaml

from hdd_servo_ros.messages.plain_yaml import DEEPEST, MOST_REPEATED, YamlError, parse_yaml, read_yaml

BOMB = 'a: &a [x,x,x,x,x,x,x,x,x,x]\n' + ''.join(
    f'{name}: &{name} [{",".join(10 * [f"*{before}"])}]\n'
    for before, name in zip('abcdefghi', 'bcdefghij', strict=True)
)


@pytest.mark.parametrize(
    'text',
    [
        '',
        'a: 1',
        'a: &a {b: [1, 2.5, yes, null, "x"]}\nc: *a\nd: [*a, *a]',
        'base: &base {a: 1, b: 2}\nmore: {<<: *base, b: 3}',
        DEEPEST * '[' + DEEPEST * ']',
        f'a: &a {MOST_REPEATED // 4 * "x"}\nb: [*a, *a]',
        'a: 1\nb: [1.5, .inf, -3, 1e3, 0x10, 010, 1_000, true, no, ~, "1", 2001-01-01]\n',
        'text: |\n  two\n  lines\nµ: "\\u00b5"\n',
        'when: 2001-12-14t21:59:43.10-05:00',
    ],
)
def test_what_one_may_have_written_is_read_as_pyyaml_reads_it(text):
    assert parse_yaml(text) == yaml.safe_load(text)


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        (BOMB, 'line 7: aliases repeat more than'),
        (f'a: &a {MOST_REPEATED // 4 * "x"}\nb: [*a, *a, *a,\n *a, *a]', 'line 3: aliases repeat more than'),
        ('a: &a [*a]', r'line 1: the alias \*a is not defined before it'),
        ('a:\n  &a {b: {c: *a}}', r'line 2: the alias \*a'),
        ('a: 1\nb: *c', r'line 2: the alias \*c'),
        (DEEPEST * '[' + '[]' + DEEPEST * ']', f'nested more than {DEEPEST} deep'),
        (1_000_000 * '[', f'nested more than {DEEPEST} deep'),
        (1_000_000 * '- ', f'nested more than {DEEPEST} deep'),
        ('a: [1\nb: 2', 'line 2: '),
        ('{[1]: 2, {}: 3}', 'unhashable'),
        ('when: 2001-13-45', 'month'),
        ('a: ' + 5000 * '9', '4300 digits'),
        ('a: 0b_', 'invalid literal'),
        ('a: !!python/object:os.system x', 'line 1: could not determine a constructor'),
        ('a: \x00', 'special characters|control characters'),
    ],
)
def test_what_nobody_wrote_is_rejected_in_one_line(text, why):
    with pytest.raises(YamlError, match=why) as error:
        parse_yaml(text)
    assert '\n' not in str(error.value)


def test_a_file_is_utf_8(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_bytes('a: ä'.encode())
    assert read_yaml(path) == {'a': 'ä'}
    for encoding in ('latin1', 'utf16'):
        path.write_bytes('a: ä'.encode(encoding))
        with pytest.raises(YamlError, match='not UTF-8'):
            read_yaml(path)
    with pytest.raises(FileNotFoundError):
        read_yaml(tmp_path / 'none.yaml')
