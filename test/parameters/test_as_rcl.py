"""`parse_ros_arguments` gives arguments the same meaning as rcl, and rejects what rcl and `rig` reject."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments

rclpy = pytest.importorskip('rclpy')

NODES = ('plant', 'sensor')
TOPICS = ('reference', 'head')
SECTION = '  ros__parameters:\n'


def of_rcl(arguments):
    """Return rcl's reading of a command line: names, parameters and topics of each node; None if it is rejected."""
    context = rclpy.Context()
    try:
        rclpy.init(context=context, args=['program', *arguments])
    except Exception:
        return None
    try:
        return [_of_rcl(name, context) for name in NODES]
    except Exception:
        return None
    finally:
        rclpy.shutdown(context=context)


def _of_rcl(name, context):
    node = rclpy.create_node(name, context=context)
    try:
        parameters = {key: _plain(found.value) for key, found in node._parameter_overrides.items()}
        topics = [node.resolve_topic_name(topic) for topic in TOPICS]
        return node.get_fully_qualified_name(), parameters, topics
    finally:
        node.destroy_node()


def _plain(value):
    if value is None:
        return ()
    return tuple(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def of_ours(arguments):
    parsed = parse_ros_arguments(arguments)
    return [
        (parsed.full_name(node), parsed.parameters_of(node), [parsed.remaps.topic(node, topic) for topic in TOPICS])
        for node in NODES
    ]


def told(meaning):
    """Return a meaning in which nan equals nan, 1 differs from 1.0 and -0.0 from 0.0."""
    return repr(meaning)


def expect_as_rcl(arguments):
    """Expect the same reading as rcl's of a command line; return whether it was accepted."""
    try:
        ours = of_ours(arguments)
    except ArgumentError:
        return False
    assert told(ours) == told(of_rcl(arguments)), arguments
    return True


TAKEN = [
    '1',
    '-3',
    '+7',
    '010',
    '-017',
    '0x1F',
    '0X1f',
    '-0',
    '9223372036854775807',
    '9223372036854775808',
    '-9223372036854775808',
    '08',
    '0777',
    '.12e3',
    '1.',
    '+.5',
    '-.5',
    '5.e3',
    '.5e-3',
    '1e5',
    '1e+5',
    '1E-4',
    '0x1p3',
    '0x.8',
    '0x1.8p-1',
    '1e308',
    '1e309',
    '-1e309',
    '5e-324',
    '1e-400',
    '0e-999',
    '2.5e-308',
    '2.2250738585072014e-308',
    'inf',
    '-inf',
    '+INF',
    'infinity',
    '.inf',
    '-.inf',
    '.Inf',
    '+.inf',
    'nan',
    'NaN',
    '.nan',
    '.NaN',
    '.NAN',
    '1_000.0',
    '0b1',
    '0b_',
    '0o17',
    '1:30',
    '2001-99-99',
    '2001-01-01',
    '1e',
    'e5',
    '+',
    '.',
    '0x',
    '0.1.2',
    '0.1f',
    '1d',
    '12abc',
    '~',
    'null',
    'Null',
    '<<',
    '=',
    'y',
    'Y',
    'yes',
    'Yes',
    'YES',
    'yEs',
    'n',
    'N',
    'no',
    'No',
    'true',
    'True',
    'TRUE',
    'tRUE',
    'on',
    'On',
    'ON',
    'off',
    'OFF',
    'oFF',
    '"1"',
    "'1'",
    "''",
    '""',
    '!!str&1',
    '[]',
    '[1,&2]',
    '[1.0,&2.0]',
    '[a,&b]',
    '["a",&b]',
    '[true,&false]',
    '[1,]',
    'é',
    '1&#&c',
    '0x8000000000000000',
]


@pytest.mark.parametrize('text', [text.replace('&', ' ') for text in TAKEN] + ['9' * 25, '9' * 400, '-' + '9' * 5000])
def test_a_value_is_what_rcl_takes_it_for(text):
    assert expect_as_rcl(['--ros-args', '-p', f'plant:x:={text}'])


REJECTED = (
    '',
    '[1.0, 2]',
    '[a, 1]',
    '[[1]]',
    '[{a: 1}]',
    '{a: 1}',
    '*a',
    '- ',
    '%',
    '@a',
    '!!int 3',
    '!x 1',
    '1\n---\n2',
)


@pytest.mark.parametrize('text', REJECTED)
def test_a_value_that_is_rejected(text):
    with pytest.raises(ArgumentError, match="-p 'plant:x:="):
        parse_ros_arguments(['--ros-args', '-p', f'plant:x:={text}'])


@given(st.text(alphabet='0123456789.eExXpP+-_ainfyN~', min_size=1, max_size=9))
def test_whatever_a_word_is_rcl_takes_it_for_the_same(text):
    expect_as_rcl(['--ros-args', '-p', f'plant:x:={text}'])


FILES: dict[str, str | bytes] = {
    'empty': '',
    'comment': '# nothing\n',
    'no parameters': 'plant:\n  ros__parameters: {}\n',
    'no section': 'plant: {}\n',
    'two sections': f'plant:\n{SECTION}    x: 1\nplant:\n{SECTION}    y: 2\n',
    'twice': f'plant:\n{SECTION}    x: 1\n    x: 2\n',
    'nested': f'plant:\n{SECTION}    a: {{b: {{c: 1}}}}\n    a.d: 2.5\n    1: 3\n',
    'merge key': f'plant:\n{SECTION}    <<: {{a: 1}}\n',
    'anchor': f'plant:\n{SECTION}    a: &a 1\n',
    'date': f'plant:\n{SECTION}    x: 2001-99-99\n',
    'two documents': f'plant:\n{SECTION}    x: 1\n---\nplant:\n{SECTION}    y: 1\n',
    'slash above': f'/:\n  plant:\n  {SECTION}      x: 1\n',
    'wildcard above': f'/**:\n  plant:\n  {SECTION}      x: 1\n',
    'utf-16': f'plant:\n{SECTION}    x: 1\n'.encode('utf-16'),
    'byte order mark': f'\ufeffplant:\n{SECTION}    x: 1\n',
    'sections of each kind': ''.join(
        f'"{name}":\n{SECTION}    x: {index}\n' for index, name in enumerate(('/**', 'plant', '/**/sensor', '/*'))
    ),
}


@pytest.mark.parametrize('name', FILES)
def test_a_file_is_what_rcl_takes_it_for(tmp_path, name):
    path = tmp_path / 'file.yaml'
    path.write_bytes(text if isinstance(text := FILES[name], bytes) else text.encode())
    assert expect_as_rcl(['--ros-args', '--params-file', str(path)])


REJECTED_FILES = {
    f'plant:\n{SECTION}': "line 2: 'ros__parameters' is empty; expected parameters",
    'plant:\n  ros__parameters: [1, 2]\n': 'line 2: .* is not a mapping; expected parameters',
    'plant:\n': "line 1: 'plant' is empty; expected ros__parameters or further names",
    f'plant:\n{SECTION}    x:\n': "line 3: x: the value is missing; write '' for an empty string",
    f'plant:\n{SECTION}    x: {{}}\n': 'x is an empty mapping',
    f'plant:\n{SECTION}    a: &a 1\n    b: *a\n': r'line 4: b: ROS does not support the alias \*a',
    f'plant: &p\n{SECTION}    a: 1\nsensor: *p\n': r'line 4: ROS does not support the alias \*p',
    'ros__parameters:\n  x: 1\n': 'line 1: ros__parameters is not below a node name',
    f'/pl*t:\n{SECTION}    x: 1\n': "line 2: '/pl\\*t' is not a node name",
    f'pl.ant:\n{SECTION}    x: 1\n': 'is not a node name',
    f'plant/:\n{SECTION}    x: 1\n': 'is not a node name',
    f'//plant:\n{SECTION}    x: 1\n': 'is not a node name',
    f'/:\n{SECTION}    x: 1\n': 'is not a node name',
    f'plant:\n{SECTION}    x: [1, 2.0]\n': 'line 3: x: .* contains an integer and a double; .*; write 2.0 for 2',
    f'plant:\n{SECTION}    x: [[1]]\n': 'a list contains a list or a mapping',
    f'plant:\n{SECTION}    x: {"[" * 5000}\n': 'a list contains a list',
    f'plant:\n{SECTION}    x: {"{a: " * 200}1{"}" * 200}\n': 'nested more than 32 deep',
    '{a: ' * 200 + '1' + '}' * 200: 'nested more than 32 deep',
    f'plant:\n{SECTION}    ? [a]\n    : 2\n': 'line 3: a list or a mapping cannot be a name',
    f'plant:\n{SECTION}    x: "a\\0b"\n': 'NUL',
    f'plant:\n{SECTION}    x: a\0b\n': 'invalid YAML',
    f'plant:\n{SECTION}    x: !!binary aGk=\n': 'the tag',
    '- 1\n': 'line 1: expected node names at the top level',
    'word\n': 'expected node names at the top level',
    'plant: [1\n': 'line 1: .*is not a mapping; expected ',
    'plant:\n\tx: 1\n': 'line 2: invalid YAML',
}


@pytest.mark.parametrize('text', REJECTED_FILES)
def test_a_file_that_is_rejected_is_named_with_the_line(tmp_path, text):
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    with pytest.raises(ArgumentError, match=f'^parameter file .*file.yaml: .*{REJECTED_FILES[text]}') as rejected:
        parse_ros_arguments(['--ros-args', '--params-file', str(path)])
    assert len(str(rejected.value)) < len(str(path)) + 250
    assert '\n' not in str(rejected.value)


def test_a_file_in_latin_1_is_rejected(tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_bytes(f'# fréquence\nplant:\n{SECTION}    x: 1\n'.encode('latin-1'))
    with pytest.raises(ArgumentError, match=r'file.yaml: invalid YAML: .*UTF-8'):
        parse_ros_arguments(['--ros-args', '--params-file', str(path)])


@pytest.mark.parametrize('name', ['plant', '/plant', '/**/plant'])
def test_the_order_of_overrides_is_that_of_rcl(tmp_path, name):
    """A repeated pattern keeps its position: patterns after it may still win over it."""
    path = tmp_path / 'file.yaml'
    path.write_text(f'{name}:\n{SECTION}    x: 2\n')
    pieces = (['--params-file', str(path)], ['-p', 'x:=3'], ['-p', 'plant:x:=4'], ['-p', 'x:=5'])
    for order in itertools.permutations(pieces):
        assert expect_as_rcl(['--ros-args', *itertools.chain(*order)])


PATTERNS = [
    '/**',
    '/*',
    '/**/plant',
    '/*/plant',
    '/*/*',
    '/**/*',
    '**',
    '*',
    '/a/plant',
    'a/plant',
    '/a/*',
    '/a/**',
    '/**/b/plant',
    '/*/b/plant',
    'plant',
    '/**/b/*',
    '**/plant',
    '*/plant',
    '/**/**',
    '/a/b/plant',
    '/a/**/plant',
    '/a/*/plant',
    '/**/a/**/plant',
]


@pytest.mark.parametrize('namespace', ['/', '/a', '/a/b'])
def test_a_pattern_matches_as_with_rcl(tmp_path, namespace):
    for pattern in PATTERNS:
        path = tmp_path / 'file.yaml'
        path.write_text(f'"{pattern}":\n{SECTION}    x: 1\n')
        assert expect_as_rcl(['--ros-args', '-r', f'__ns:={namespace}', '--params-file', str(path)])


RULES = (
    'reference:=ref2',
    '/reference:=/ref2',
    'reference:=/a/ref2',
    '/a/reference:=z',
    'rostopic://reference:=c',
    'rostopic:///reference:=/c',
    'rosservice://reference:=c',
    'plant:reference:=ref2',
    'plant:rostopic://reference:=c',
    'other:reference:=ref2',
    'p:reference:=q',
    '~/reference:=z',
    'reference:=~/z',
    'reference:=head',
    'head:=reference',
    '__ns:=/',
    '__ns:=/a',
    '__ns:=/a/b',
    'plant:__ns:=/c',
    'p:__ns:=/d',
    'plant:__node:=p',
    'plant:__name:=p',
    '_a:=_b',
    'a_:=b_',
)


def test_remap_rules_mean_what_they_mean_to_rcl():
    """Single rules and pairs in both orders: the first that matches applies."""
    for first, second in itertools.product(RULES, RULES):
        rules = (first,) if first == second else (first, second)
        assert expect_as_rcl(['--ros-args', *itertools.chain(*(('-r', rule) for rule in rules))]), rules


REJECTED_RULES = (
    'reference',
    'reference:=',
    ':=a',
    '*:=z',
    'ref*:=z',
    'reference:=z*',
    '/**:=z',
    'reference:=a b',
    'reference:=1a',
    'reference:=a-b',
    'reference:=a//b',
    'reference:=/',
    'reference:=a/',
    'reference:=a__b',
    'reference:={node}/a',
    'reference:=a:=b',
    '/plant:reference:=a',
    'a:b:reference:=c',
    'http://reference:=c',
    'reference:=rostopic://c',
    'reference:=é',
    '__foo:=c',
    '__ns:=b',
    '__ns:=/b/',
    '__ns:=',
    '__ns:=/b//c',
    '__ns:=/1',
    '__ns:=~/x',
    '__node:=/foo',
    '__node:=foo bar',
    '__node:=1a',
)


@pytest.mark.parametrize('rule', REJECTED_RULES)
def test_a_remap_rule_that_rcl_rejects_is_rejected(rule):
    assert of_rcl(['--ros-args', '-r', rule]) is None
    with pytest.raises(ArgumentError, match=r'^-r .* is not'):
        parse_ros_arguments(['--ros-args', '-r', rule])


OTHERS = (
    ['--log-level', 'info'],
    ['--log-level', 'plant:=WARN'],
    ['--log-level', 'bogus'],
    ['--log-level'],
    ['--disable-rosout-logs'],
    ['--enable-stdout-logs'],
    ['--disable-external-lib-logs'],
    ['--enable-foo'],
    ['--enclave', '/a'],
    ['--log-file-name', 'x'],
    ['reference:=c'],
    ['--params'],
    ['-p'],
    ['-r'],
    ['-p', ':x:=1'],
    ['-p', 'x=1'],
    ['-p', '*:x:=1'],
    ['-p', '/a/plant:x:=1'],
    ['-p', 'plant:x y:=1'],
    ['-p', 'x..y:=1'],
    ['-p', 'x.y:=1'],
    ['-p', 'plant:a/b:=1'],
    ['-p', '1x:=1'],
    ['-p', 'é:=1'],
    ['-p', 'x:=1:=2'],
    ['--param', 'x:=1'],
    ['--', 'word', '--ros-args', '-p', 'x:=1'],
)


@pytest.mark.parametrize('arguments', OTHERS, ids=' '.join)
def test_what_else_rcl_takes_is_taken_and_nothing_more(arguments):
    given_to_both = ['--ros-args', *arguments]
    assert expect_as_rcl(given_to_both) == (of_rcl(given_to_both) is not None)


def test_numbers_that_are_none_are_told_apart():
    assert told([math.nan]) == told([math.nan])
    assert told(-0.0) != told(0.0)
