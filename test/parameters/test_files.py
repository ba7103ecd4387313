from pathlib import Path

import pytest

from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments, read_parameter_files

PARAMS = Path(__file__).parents[2] / 'params'


def write(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_later_wins(tmp_path):
    first = write(
        tmp_path, 'a.yaml', '/**/plant:\n  ros__parameters:\n    gain: 1.0\n    friction: {level: 1e-4, other: 2}\n'
    )
    second = write(tmp_path, 'b.yaml', 'plant:\n  ros__parameters:\n    friction.level: 3.0\n')
    parsed = parse_ros_arguments(['--ros-args', '--params-file', first, '--params-file', second, '-p', 'gain:=5'])
    assert parsed.parameters_of('plant') == {'gain': 5, 'friction.level': 3.0, 'friction.other': 2}
    assert parsed.parameters_of('sensor') == {'gain': 5}


def test_arguments_that_concern_rclpy_alone_are_passed_over():
    parsed = parse_ros_arguments(
        ['--ros-args', '--log-level', 'info', '--log-file-name', 'run', '--disable-rosout-logs', '-p', 'gain:=5']
    )
    assert parsed.parameters_of('plant') == {'gain': 5}
    assert parsed.others == []


@pytest.mark.parametrize(
    ('pattern', 'matches'),
    [('/**', True), ('/**/plant', True), ('/*/plant', True), ('/bench1/plant', True), ('plant', False), ('/*', False)],
)
def test_patterns_in_a_namespace(tmp_path, pattern, matches):
    path = write(tmp_path, 'a.yaml', f'{pattern}:\n  ros__parameters:\n    gain: 1.0\n')
    parsed = parse_ros_arguments(['--ros-args', '-r', '__ns:=/bench1', '--params-file', path])
    assert parsed.parameters_of('plant') == ({'gain': 1.0} if matches else {})


def test_nested_names(tmp_path):
    path = write(tmp_path, 'a.yaml', 'bench1:\n  plant:\n    ros__parameters:\n      gain: 1.0\n')
    parsed = parse_ros_arguments(['--ros-args', '-r', '__ns:=/bench1', '--params-file', path])
    assert parsed.parameters_of('plant') == {'gain': 1.0}


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1e-4', 1e-4),
        ('-2E3', -2e3),
        ('1.5', 1.5),
        ('7', 7),
        ('true', True),
        ('[1.0, 2.0]', (1.0, 2.0)),
        ('word', 'word'),
        ('N', False),
    ],
)
def test_values_as_ros_reads_them(text, value):
    parsed = parse_ros_arguments(['--ros-args', '-p', f'plant:x:={text}'])
    assert parsed.parameters_of('plant') == {'x': value}
    assert type(parsed.parameters_of('plant')['x']) is type(value)


@pytest.mark.parametrize(
    ('arguments', 'match'),
    [
        (['-p', 'x=1'], 'is not NODE:PARAMETER:=VALUE'),
        (['-p'], 'needs a value'),
        (['--params-file', '/does/not/exist.yaml'], 'exist.yaml'),
        (['-r', 'x'], 'is not .*FROM:=TO'),
        (['--frobnicate'], "unknown ROS argument '--frobnicate'"),
    ],
)
def test_what_cannot_be_read_is_named(arguments, match):
    with pytest.raises(ArgumentError, match=match):
        parse_ros_arguments(['--ros-args', *arguments])


@pytest.mark.parametrize('text', ['- 1\n', 'plant: 3\n', 'plant: [1\n'])
def test_a_file_that_is_none_is_named(tmp_path, text):
    with pytest.raises(ArgumentError, match=r'broken\.yaml'):
        parse_ros_arguments(['--ros-args', '--params-file', write(tmp_path, 'broken.yaml', text)])


def test_the_file_that_a_value_is_from_is_known(tmp_path):
    """From the last overlay that gives the value; none for a value from the command line."""
    base = write(tmp_path, 'base.yaml', 'plant:\n  ros__parameters:\n    a: 1\n    b:\n      c: 2\n    d: 3\n')
    overlay = write(
        tmp_path, 'overlay.yaml', '/**:\n  ros__parameters:\n    e: 1\n\n/**/plant:\n  ros__parameters: {b.c: 5}\n'
    )
    parsed = parse_ros_arguments(['--ros-args', '--params-file', base, '--params-file', overlay, '-p', 'plant:d:=4'])
    assert parsed.origin('plant:a') == f'{base}, line 3'
    assert parsed.origin('plant:b.c') == f'{overlay}, line 6'
    assert parsed.origin('plant:d') == ''
    assert parsed.origin('plant:e') == parsed.origin('e') == f'{overlay}, line 3'
    assert parsed.origin('plant:f') == ''
    again = parse_ros_arguments(['--ros-args', '-p', 'plant:d:=4', '--params-file', base])
    assert again.origin('plant:d') == f'{base}, line 6'
    rejected = pytest.raises(
        ParameterError, match=r'invalid value for parameter plant:d: 3; expected less; given in .*base\.yaml, line 6'
    )
    with rejected, again.naming_files():
        raise ParameterError('plant:d', 3, 'less')
    with pytest.raises(ParameterError, match=r'; expected less$'), parsed.naming_files():
        raise ParameterError('plant:d', 4, 'less')


def test_a_quality_of_service_is_rejected_with_the_reason():
    """The topic name starts with a slash, which is not allowed in the syntax of names."""
    for node in ('', 'plant:'):
        with pytest.raises(ArgumentError, match='the quality of service of the topics is fixed'):
            parse_ros_arguments(['--ros-args', '-p', f'{node}qos_overrides./clock.publisher.depth:=5'])


def test_reads_what_ros_reads(tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text(
        '/**/ldv_sensor:\n  ros__parameters:\n    displacement_noise: 1e-3\n    noise: false\n    seed: 7\n'
        'vcm_plant:\n  ros__parameters:\n    gain: 4.0e7\n    friction: {model: none, stiffness: 2.5}\n'
        '    resonance:\n      numerators: [1.0, 2e3, -0.5]\n    frame_id: "1e5"\n'
    )
    assert read_parameter_files([file]) == {
        'ldv_sensor': {'displacement_noise': 1e-3, 'noise': False, 'seed': 7},
        'vcm_plant': {
            'gain': 4.0e7,
            'friction.model': 'none',
            'friction.stiffness': 2.5,
            'resonance.numerators': (1.0, 2000.0, -0.5),
            'frame_id': '1e5',
        },
    }


def test_later_files_win(tmp_path):
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text('/**/n:\n  ros__parameters: {a: 1, b: 2}\n')
    second.write_text('/bench1/n:\n  ros__parameters: {b: 3}\n')
    assert read_parameter_files([first, second]) == {'n': {'a': 1, 'b': 3}}


def test_a_parameter_for_no_node_is_rejected():
    parsed = parse_ros_arguments(['--ros-args', '-p', 'plnt:gain:=1'])
    with pytest.raises(ArgumentError, match="parameters for '/plnt', but there are /plant"):
        parsed.check_nodes(['plant'])


@pytest.mark.parametrize('path', sorted(PARAMS.glob('*.yaml')), ids=lambda path: path.stem)
def test_as_rcl_reads_it(path):
    """The shipped files have the same meaning for ROS's own parser."""
    rclpy = pytest.importorskip('rclpy')
    from hdd_servo_ros.graph.catalog import names_with_parameters

    arguments = ['--ros-args', '--params-file', str(path)]
    context = rclpy.Context()
    rclpy.init(context=context, args=arguments)
    try:
        for name in names_with_parameters():
            node = rclpy.create_node(name, context=context, automatically_declare_parameters_from_overrides=True)
            theirs = {
                key: tuple(found.value)
                if hasattr(found.value, '__iter__') and not isinstance(found.value, str)
                else found.value
                for key, found in node.get_parameters_by_prefix('').items()
            }
            node.destroy_node()
            ours = parse_ros_arguments(arguments).parameters_of(name)
            assert ours == {key: theirs[key] for key in ours}
            assert theirs.keys() - ours.keys() <= {'use_sim_time', 'start_type_description_service'}
    finally:
        rclpy.shutdown(context=context)
