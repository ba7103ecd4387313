"""The parameter services of every node, as the `ros2 param` command uses them, during a run of 10 kHz."""

import math
import statistics
from typing import Any

import pytest
from geometry_msgs.msg import Vector3Stamped
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.serialization import deserialize_message

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.recording.compare_bags import first_difference

NODES = ['rig', *nodes_of_run({CONTROLLER: CONTROLLERS['adaptive_nn']})]
RUN = ('-p', 'deterministic_timer:duration:=3.0', '-p', 'vcm_plant:substeps:=3')
SCALARS = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
}
LISTS = {
    bool: ParameterType.PARAMETER_BOOL_ARRAY,
    int: ParameterType.PARAMETER_INTEGER_ARRAY,
    float: ParameterType.PARAMETER_DOUBLE_ARRAY,
    str: ParameterType.PARAMETER_STRING_ARRAY,
}
FIELDS = {
    ParameterType.PARAMETER_BOOL: 'bool_value',
    ParameterType.PARAMETER_INTEGER: 'integer_value',
    ParameterType.PARAMETER_DOUBLE: 'double_value',
    ParameterType.PARAMETER_STRING: 'string_value',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value',
}


def ros_type(declaration):
    return (LISTS if declaration.is_sequence else SCALARS)[declaration.element_type]


def parameter(name, value, kind=ParameterType.PARAMETER_DOUBLE):
    return Parameter(name=name, value=ParameterValue(type=kind, **{FIELDS[kind]: value}))


def service(node, kind):
    name = kind.__name__
    return f'/{node}/' + ''.join('_' + letter.lower() if letter.isupper() else letter for letter in name).lstrip('_')


@pytest.fixture
def run(bench, outside):
    """A slow run that has begun; returns how to ask its nodes, and the seconds that each answer took."""
    process = bench.start('rig', *RUN, '-p', 'deterministic_timer:rate:=0.3', '-p', 'bag_recorder:run_dir:=run')
    heard: list[Vector3Stamped] = []
    outside.create_subscription(Vector3Stamped, '/reference', heard.append, 10)
    outside.spin_until(lambda: heard)
    process.seconds = []

    def ask(node, kind, **request):
        answer, seconds = outside.call(kind, service(node, kind), kind.Request(**request))
        process.seconds.append(seconds)
        return answer

    process.ask = ask
    return process


def expect_slider(described, declaration, value):
    """Expect a range for every number: the declared bounds where there are some, and the present value inside."""
    ranges = [*described.floating_point_range, *described.integer_range]
    is_number = declaration.element_type in (int, float) and not declaration.is_sequence
    assert len(ranges) == is_number, declaration.name
    if is_number:
        (found,) = ranges
        lower, upper = max(declaration.minimum, declaration.above), declaration.maximum
        assert math.isinf(lower) or found.from_value == lower, declaration.name
        assert math.isinf(upper) or found.to_value == upper, declaration.name
        present = value.double_value if declaration.element_type is float else value.integer_value
        assert found.from_value <= present <= found.to_value, declaration.name
        assert found.from_value < found.to_value, declaration.name


def test_numbers_beyond_a_slider_and_integers_for_doubles_are_taken(run):
    """As a command line takes them; a range that is there for a slider alone rejects nothing."""
    for value in (1e9, 4):
        kind = ParameterType.PARAMETER_DOUBLE if isinstance(value, float) else ParameterType.PARAMETER_INTEGER
        changes = [parameter('frequency', value, kind)]
        assert run.ask('reference_generator', SetParameters, parameters=changes).results[0].successful
        (got,) = run.ask('reference_generator', GetParameters, names=['frequency']).values
        assert (got.type, got.double_value) == (ParameterType.PARAMETER_DOUBLE, value)
    (rejected,) = run.ask('reference_generator', SetParameters, parameters=[parameter('frequency', -1.0)]).results
    assert rejected.reason == 'invalid value for parameter frequency: -1.0; expected a finite number at least 0 [Hz]'


def test_every_node_answers_and_what_it_rejects_changes_nothing(bench, run):
    dumped = ('-p', 'use_sim_time:=false', '-p', 'start_type_description_service:=true')  # what a dump holds besides
    simulated = bench.start('simulate', *RUN, *dumped, '-p', 'bag_recorder:run_dir:=simulated')
    for node in NODES:
        declared = {declaration.name: declaration for declaration in node_declarations(node)}
        listed = run.ask(node, ListParameters).result.names
        assert declared.keys() <= set(listed)
        values = dict(zip(listed, run.ask(node, GetParameters, names=listed).values, strict=True))
        described = dict(zip(listed, run.ask(node, DescribeParameters, names=listed).descriptors, strict=True))
        for name, declaration in declared.items():
            # Of an unset one the answer would hold none of the values: `ros2 param dump` wants them all.
            assert values[name].type == described[name].type == ros_type(declaration), name
            assert described[name].read_only == declaration.read_only, name
            assert described[name].description.startswith(declaration.description), name
            assert declaration.unit in described[name].description, name
            assert described[name].additional_constraints == declaration.allowed, name
            expect_slider(described[name], declaration, values[name])

        # What can be changed alone cannot be changed beside something that is rejected.
        good = next((d for d in declared.values() if not d.read_only and d.element_type is float), None)
        if good is not None and not good.is_sequence:
            changes = [parameter(good.name, values[good.name].double_value / 2), parameter(f'{good.name}_', 1.0)]
            result = run.ask(node, SetParametersAtomically, parameters=changes).result
            assert not result.successful
            assert result.reason == f'/{node} has no parameter {good.name}_; did you mean {good.name}?'
        unknown = [parameter('no_such_parameter', 1.0), parameter('use_sim_tim', 1.0)]
        results = run.ask(node, SetParameters, parameters=unknown).results
        assert [result.successful for result in results] == [False, False]
        assert results[0].reason == f'/{node} has no parameter no_such_parameter'
        assert results[1].reason == f'/{node} has no parameter use_sim_tim; did you mean use_sim_time?'
        assert all(descriptor.description for descriptor in described.values())
        assert run.ask(node, GetParameters, names=listed).values == list(values.values())

    for rejected, reason in {
        ('reference_generator', 'frequency', -1.0): 'frequency: -1.0; expected a finite number at least 0 [Hz]',
        ('reference_generator', 'frequency', math.nan): 'a finite number at least 0 [Hz]',
        ('vcm_plant', 'gain', 0.0): 'gain: 0.0; expected a finite number above 0',
        ('deterministic_timer', 'sample_time', 1e-3): 'read-only',
    }.items():
        node, name, value = rejected
        result = run.ask(node, SetParameters, parameters=[parameter(name, value)]).results[0]
        assert not result.successful, rejected
        assert reason in result.reason, rejected
    # A value of another type is rejected in the same words, alone and beside one that could be taken.
    of_other_types: tuple[tuple[str, str, Any, int, str], ...] = (
        ('reference_generator', 'frequency', [1.0], LISTS[float], 'frequency: [1.0]; expected a finite number at'),
        (
            'reference_generator',
            'frequency',
            'fast',
            SCALARS[str],
            "frequency: 'fast'; expected a finite number at",
        ),
        ('vcm_plant', 'substeps', True, SCALARS[bool], 'substeps: True; expected an integer'),
        ('vcm_plant', 'substeps', 2.0, SCALARS[float], 'substeps: 2.0; expected an integer'),
    )
    for node, name, other, kind, reason in of_other_types:
        changes = [parameter(name, other, kind)]
        (result,) = run.ask(node, SetParameters, parameters=changes).results
        together = run.ask(node, SetParametersAtomically, parameters=changes).result
        assert not result.successful
        assert result.reason.startswith(f'invalid value for parameter {reason}')
        assert together == result
    kind = ParameterType.PARAMETER_STRING
    change = parameter('waveform', 'sawtooth', kind)
    result = run.ask('reference_generator', SetParameters, parameters=[change]).results[0]
    assert "waveform: 'sawtooth'; expected one of sine" in result.reason

    for process in (run, simulated):
        assert process.wait() == 0, process.output
    assert statistics.median(run.seconds) < 30.0
    assert len(Run.open(bench.directory / 'run').time) == 30_001
    assert first_difference(bench.directory / 'simulated', bench.directory / 'run') is None


VIBRATION = 'disturbance_generator:vibration.rotational'
UNTENABLE = [
    ('adaptive_nn_controller', 'network.width', [1e-300], ParameterType.PARAMETER_DOUBLE_ARRAY),
    ('adaptive_nn_controller', 'sigma.scale', 5e-324, SCALARS[float]),
    ('reference_generator', 'start_time', 1.7e308, SCALARS[float]),
    ('reference_generator', 'amplitude', 1.797e308, SCALARS[float]),
    ('vcm_plant', 'gain', 1.797e308, SCALARS[float]),
    ('ldv_sensor', 'demodulator_bandwidth', 5e-324, SCALARS[float]),
]


def test_a_value_with_which_a_block_cannot_run_is_rejected_and_changes_nothing(bench, run):
    for node, name, value, kind in UNTENABLE:
        result = run.ask(node, SetParameters, parameters=[parameter(name, value, kind)]).results[0]
        assert not result.successful, name
        assert f'invalid value for parameter {name}: ' in result.reason
        assert f'; {node} cannot run with it: ' in result.reason
    # A change that can be made is made.
    result = run.ask('reference_generator', SetParameters, parameters=[parameter('frequency', 120.0)]).results[0]
    assert result.successful, result.reason
    assert run.wait() == 0, run.output
    changes = Run.open(bench.directory / 'run').parameter_changes
    assert [(change.node, change.name, change.value) for change in changes] == [
        ('/reference_generator', 'frequency', 120.0)
    ]


@pytest.mark.parametrize(
    ('argument', 'named'),
    [
        ('adaptive_nn_controller:network.width:=[1e-300]', 'adaptive_nn_controller:network.width'),
        ('reference_generator:start_time:=1.7e308', 'reference_generator:start_time'),
        ('vcm_plant:length_unit:=m -p adaptive_nn_controller:feedforward.method:=fixed', 'feedforward.method'),
        ('adaptive_nn_controller:feedforward.taps:=400', 'adaptive_nn_controller:feedforward.taps'),
        (f'{VIBRATION}.high:=6000.0 -p {VIBRATION}.enabled:=true', 'vibration.rotational.high'),
        ("deterministic_timer:schedule:=['0.1 vcm_plant gain 1.797e308']", 'gain'),
        ("deterministic_timer:schedule:=['0.1 reference_generator start_time 1.7e308']", 'start_time'),
        ("deterministic_timer:schedule:=['0.1 adaptive_nn_controller network.width [1e-300]']", 'network.width'),
    ],
)
def test_the_same_in_a_file_and_in_a_schedule_before_the_run(bench, argument, named):
    for command in ('rig', 'simulate'):
        options = argument.split(' -p ')
        arguments = [word for option in options for word in ('-p', option)]
        process = bench.start(command, *arguments, '-p', f'bag_recorder:run_dir:={command}')
        assert process.wait() == 2, process.output
        (line,) = process.output.strip().splitlines()
        assert line.startswith(f'{command}: invalid value for parameter ')
        assert named in line
        assert not (bench.directory / command).exists()


def test_whatever_clock_a_user_chooses_the_bag_shows_the_tick(bench, run):
    for name, value, kind in (
        ('use_sim_time', True, ParameterType.PARAMETER_BOOL),
        ('use_sim_time', False, ParameterType.PARAMETER_BOOL),
        ('frequency', 150.0, ParameterType.PARAMETER_DOUBLE),
    ):
        changes = [parameter(name, value, kind)]
        assert run.ask('reference_generator', SetParameters, parameters=changes).results[0].successful
    assert run.wait() == 0, run.output
    stamps, events = Run.open(bench.directory / 'run').messages_by_topic()['/parameter_events']
    names = [deserialize_message(event, ParameterEvent).changed_parameters[0].name for event in events]
    assert names == ['use_sim_time', 'use_sim_time', 'frequency']
    assert all(0 < stamp < 3 * 10**9 for stamp in stamps)
