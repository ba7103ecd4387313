"""The graph as a ROS user meets it: topics, namespaces, parameters, outside nodes."""

import signal
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Vector3Stamped
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rclpy.serialization import deserialize_message

from hdd_servo_ros import Run
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.compare_bags import first_difference

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / 'examples' / 'disturbance_node.py'


def double(name, value):
    return Parameter(name=name, value=ParameterValue(type=3, double_value=value))


def test_types_and_default_subscribers(bench, outside):
    received: list[Vector3Stamped] = []
    outside.create_subscription(Vector3Stamped, '/head', received.append, 10)
    process = bench.start('rig', '-p', 'deterministic_timer:duration:=5.0', '-p', 'deterministic_timer:rate:=0.1')
    outside.spin_until(lambda: len(received) > 100)
    types = dict(outside.get_topic_names_and_types())
    for topic in LOOP_TOPICS:
        assert types[f'/{topic.name}'] == [topic.type_name]
    names = {name for name, _ in outside.get_node_names_and_namespaces()}
    assert {'vcm_plant', 'ldv_sensor', 'adaptive_nn_controller', 'reference_generator', 'bag_recorder'} <= names
    message = received[-1]
    assert message.header.frame_id == 'seagate_7200_10'
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    assert stamp % 100_000 == 0
    process.signal(signal.SIGINT)
    assert process.wait() == 130, process.output


def test_slow_and_dying_outside_subscribers_change_nothing(bench):
    # Slow enough for two listeners written in Python to keep up until something happens to them.
    duration = ('-p', 'deterministic_timer:duration:=0.25')
    bench.run('simulate', *duration, '-p', 'bag_recorder:run_dir:=simulated')
    listeners = [bench.start('listener', script=HERE / 'listener.py') for _ in range(2)]
    for listener in listeners:
        listener.wait_for('listening')
    process = bench.start('rig', *duration, '-p', 'deterministic_timer:rate:=0.05', '-p', 'bag_recorder:run_dir:=run')
    for listener in listeners:
        listener.wait_for('heard')
    listeners[0].signal(signal.SIGSTOP)
    listeners[1].signal(signal.SIGKILL)
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'simulated', bench.directory / 'run') is None


def test_two_rigs_side_by_side(bench):
    arguments = ('-p', 'duration:=0.2')
    rigs = [bench.start('rig', *arguments, '-p', f'run_dir:=run{k}', '-r', f'__ns:=/bench{k}') for k in (1, 2)]
    for process in rigs:
        assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run1', bench.directory / 'run2') is None
    for k in (1, 2):
        topics = set(Run.open(bench.directory / f'run{k}').messages_by_topic()) - {'/parameter_events'}
        assert topics == {f'/bench{k}/{topic.name}' for topic in LOOP_TOPICS}


def test_nodes_in_a_namespace_with_a_remapped_topic(bench):
    arguments = ('-p', 'duration:=0.05', '-r', '__ns:=/bench1', '-r', 'ldv:=vibrometer')
    for process in bench.start_nodes('run', '-p', 'run_dir:=run', *arguments).values():
        assert process.wait() == 0, process.output
    assert '/bench1/vibrometer' in Run.open(bench.directory / 'run').messages_by_topic()
    assert len(Run.open(bench.directory / 'run').time) == 501


@pytest.mark.parametrize('composed', [True, False])
def test_parameters_change_at_a_tick_that_the_bag_shows(bench, outside, composed):
    arguments = ('-p', 'deterministic_timer:duration:=0.3', '-p', 'deterministic_timer:rate:=0.03')
    if composed:
        processes = [bench.start('rig', *arguments, '-p', 'bag_recorder:run_dir:=run')]
    else:
        processes = list(bench.start_nodes('run', *arguments).values())
    heard: list[Vector3Stamped] = []
    outside.create_subscription(Vector3Stamped, '/reference', heard.append, 10)
    outside.spin_until(lambda: heard)

    answer, _ = outside.call(
        DescribeParameters, '/vcm_plant/describe_parameters', DescribeParameters.Request(names=['gain'])
    )
    assert 'um/s^2/V' in answer.descriptors[0].description
    rejected, _ = outside.call(
        SetParameters,
        '/reference_generator/set_parameters',
        SetParameters.Request(parameters=[double('frequency', -1.0)]),
    )
    assert not rejected.results[0].successful
    assert 'frequency: -1.0;' in rejected.results[0].reason
    fixed, _ = outside.call(
        SetParameters,
        '/deterministic_timer/set_parameters',
        SetParameters.Request(parameters=[double('sample_time', 1e-3)]),
    )
    assert not fixed.results[0].successful
    # Two together, or none.
    for frequency, successful in ((-1.0, False), (150.0, True)):
        answer, _ = outside.call(
            SetParametersAtomically,
            '/reference_generator/set_parameters_atomically',
            SetParametersAtomically.Request(parameters=[double('amplitude', 1.0), double('frequency', frequency)]),
        )
        assert answer.result.successful == successful
    answer, _ = outside.call(
        GetParameters,
        '/reference_generator/get_parameters',
        GetParameters.Request(names=['amplitude', 'frequency']),
    )
    assert [value.double_value for value in answer.values] == [1.0, 150.0]
    for process in processes:
        assert process.wait() == 0, process.output

    signals = Run.open(bench.directory / 'run')
    assert len(signals.time) == 3001
    stamps, events = Run.open(bench.directory / 'run').messages_by_topic()['/parameter_events']
    changes = [deserialize_message(event, ParameterEvent) for event in events]
    assert [[p.name for p in change.changed_parameters] for change in changes] == [['amplitude', 'frequency']]
    tick = int(stamps[0]) // 100_000
    assert 0 < tick < 3000
    time_axis = signals.time
    expected = np.where(
        np.arange(3001) < tick, 2.0 * np.sin(2 * np.pi * 100 * time_axis), 1.0 * np.sin(2 * np.pi * 150 * time_axis)
    )
    np.testing.assert_allclose(signals.reference[:, 0], expected, atol=1e-9)


def test_an_ordinary_ros_node_as_controller(bench):
    """A node that knows nothing of this package: it answers each pair of /ldv and /reference, and that is all."""
    controller = bench.start('ordinary_controller', script=HERE / 'ordinary_controller.py')
    nodes = ('bag_recorder', 'ldv_sensor', 'vcm_plant', 'reference_generator', 'deterministic_timer')
    processes = bench.start_nodes('run', '-p', 'deterministic_timer:duration:=0.05', nodes=nodes)
    for process in processes.values():
        assert process.wait() == 0, process.output
    signals = Run.open(bench.directory / 'run')
    assert len(signals.time) == 501
    np.testing.assert_array_equal(signals.control[:, 0], -0.01 * signals.ldv[:, 0])
    controller.signal(signal.SIGKILL)


@pytest.mark.parametrize(
    'scales', [{}, {'displacement_scale': 4.0, 'velocity_scale': 2000.0}], ids=['unknown', 'given']
)
def test_an_ordinary_ros_node_as_sensor(bench, scales):
    """Nothing but the controller's own parameters says by how much its voltages are to be multiplied."""
    sensor = bench.start('ordinary_sensor', script=HERE / 'ordinary_sensor.py')
    nodes = ('bag_recorder', 'pid_controller', 'vcm_plant', 'reference_generator', 'deterministic_timer')
    given = [word for name, value in scales.items() for word in ('-p', f'pid_controller:{name}:={value}')]
    processes = bench.start_nodes('run', '-p', 'deterministic_timer:duration:=0.05', *given, nodes=nodes)
    codes = {name: process.wait() for name, process in processes.items()}
    sensor.signal(signal.SIGKILL)
    if scales:
        assert set(codes.values()) == {0}, [process.output for process in processes.values()]
        signals = Run.open(bench.directory / 'run')
        e = signals.head[:, 0] - signals.reference[:, 0]
        assert np.abs(e[200:]).max() < 0.1
        return
    assert codes['pid_controller'] == 1
    output = processes['pid_controller'].output
    reason = 'parameter displacement_scale: 0.0; expected a value above 0, because this run has no ldv_sensor'
    assert sum(reason in line for line in output.splitlines()) == 1, output
    assert 'Traceback' not in output


@pytest.mark.new_interpreters  # as in test_disturbance.py
def test_disturbance_joins_when_its_node_runs(bench):
    arguments = ('-p', 'deterministic_timer:duration:=0.05')
    disturbance = bench.start('disturbance', script=EXAMPLE)
    processes = bench.start_nodes('run', *arguments)
    for process in [*processes.values(), disturbance]:
        assert process.wait() == 0, process.output
    run = Run.open(bench.directory / 'run')
    assert len(run.disturbance) == 501
    bench.run('simulate', *arguments, '-p', 'bag_recorder:run_dir:=undisturbed')
    undisturbed = Run.open(bench.directory / 'undisturbed')
    assert np.flatnonzero(run.head.position != undisturbed.head.position)[0] == 1
    difference = first_difference(bench.directory / 'run', bench.directory / 'undisturbed')
    assert difference == f'disturbance is missing in {bench.directory / "undisturbed"}'
