"""Entries of a file with scalars as ROS reads them, in nested mappings and lists."""

import re

import pytest

from hdd_servo_ros.parameters.ros_yaml import RosYamlError, read_entries


def test_scalars_are_those_of_parameter_files_at_any_depth():
    text = b"a: [1, 1.5, 1e-3, {b: 010, c: 1:30}]\nd: 'on'\ne: on\nf: 99999999999999999999\ng: {}\nh: []\n"
    assert read_entries(text) == {
        'a': [1, 1.5, 0.001, {'b': 8, 'c': '1:30'}],
        'd': 'on',
        'e': True,
        'f': 1e20,
        'g': {},
        'h': [],
    }


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'expected a mapping at the top level'),
        ('[1]', 'line 1: expected a mapping at the top level'),
        ('a: 1\nb: 2\na: 3', "line 3: 'a' is given twice"),
        ('a:\n  - b: 1\n    b: 2', "line 3: a: 'b' is given twice"),
        ('a: {name: , b: 1}', 'line 1: a: name: the value is missing'),
        ('a: &x 1\nb: *x', 'line 2: b: ROS does not support the alias *x'),
        ('? [1]\n: 2', 'line 1: a list or a mapping cannot be a name'),
        ('a: ' + 5000 * '[', 'line 1: a: entries are nested more than 32 deep'),
        ('a: ' + 5000 * '{b: ', 'line 1: a: '),
        ('a: [', 'invalid YAML'),
        ('a: 1\n---\nb: 2', 'more than one value'),
    ],
)
def test_what_is_not_allowed_is_named_with_its_line(text, message):
    with pytest.raises(RosYamlError, match=re.escape(message)):
        read_entries(text.encode())
