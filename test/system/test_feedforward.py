"""A run with accelerometers and feedforward: the same bits in separate processes, in `rig`, in `simulate`, replayed."""

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.simulation.run_setup import Simulation

NODES = nodes_of_run({CONTROLLER: CONTROLLERS['pid']})
SHAKEN = (
    *('-p', 'duration:=0.1', '-p', 'controller:=pid', '-p', 'plot:=false'),
    *('-p', 'disturbance_generator:vibration.rotational.enabled:=true'),
    *('-p', 'disturbance_generator:vibration.rotational.rms:=12.5'),
    *('-p', 'accelerometer:gain_error:=0.125', '-p', 'accelerometer:parasitic_gain:=4.0'),
    *('-p', 'pid_controller:feedforward.method:=network'),
)
SCHEDULE = (
    '-p',
    "schedule:=['0.03 pid_controller feedforward.enabled false', '0.05 pid_controller feedforward.enabled true',"
    " '0.06 accelerometer noise 0.05', '0.07 pid_controller proportional_gain 0.5',"
    " '0.07 pid_controller feedforward.step_size 0.02']",
)


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    experiment = Simulation(parse_ros_arguments(['--ros-args', *SHAKEN])).experiment
    experiment.run(0, 2)
    assert experiment.accelerometer is not None
    assert experiment.feedforward is not None
    experiment.accelerometer.step(2, 0.0, 0.0, 0.0)
    experiment.feedforward.step(0.0, 0.0, 0.0)


def test_the_same_bits_however_it_is_run(bench):
    arguments = (*SHAKEN, *SCHEDULE)
    for name in ('simulate', 'rig'):
        bench.run(name, *arguments, '-p', f'run_dir:={name}')
    nodes = bench.start_nodes('processes', *arguments, nodes=NODES)
    for name in ('disturbance_generator', 'accelerometer'):
        nodes[name] = bench.start(name, *arguments)
    for process in nodes.values():
        assert process.wait() == 0, process.output
    simulated = bench.directory / 'simulate'
    for run in ('rig', 'processes'):
        assert first_difference(simulated, bench.directory / run) is None
    recorded = Run.open(bench.directory / 'rig')
    assert recorded.accelerometer.output_1.std() > 0.01
    # It fades out and in, and adapts all the time.
    share = recorded.estimates['ff_share']
    assert share[299] == 1.0
    assert share[499] == 0.0
    assert share[-1] == 1.0
    assert not recorded.estimates['u_ff'][400:500].any()
    assert len(set(recorded.estimates['ff_weights'][400:500].tolist())) == 100
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'rig', '--without-ros')
    assert 'bit-identical on every topic, ticks 0 to 1000' in answer.stdout, answer.stdout + answer.stderr


def test_a_controller_from_python_has_the_feedforward_of_the_compiled_loop():
    whole, stepped = (Simulation(parse_ros_arguments(['--ros-args', *SHAKEN])).experiment for _ in range(2))
    stepped._kind = None  # the path of a controller that is called tick by tick
    rows, found = whole.run(0, 300), stepped.run(0, 300)
    for topic in ('head', 'control', 'estimates', 'accelerometer'):
        assert rows[topic].tobytes() == found[topic].tobytes(), topic


def test_a_feedforward_without_sensors_is_rejected(bench):
    nodes = bench.start_nodes(
        'processes',
        '-p',
        'duration:=0.1',
        '-p',
        'pid_controller:feedforward.method:=fixed',
        nodes=NODES,
    )
    codes = {name: process.wait() for name, process in nodes.items()}
    assert codes['pid_controller'] == 1
    allowed = "feedforward.method: 'fixed'; expected none, because this run has no accelerometer"
    assert allowed in nodes['pid_controller'].output


@pytest.mark.parametrize('name', ['simulate', 'rig'])
def test_a_controller_without_an_error_has_no_feedforward(bench, name):
    rejected = bench.start(
        name,
        '-p',
        'controller:=open_loop',
        '-p',
        'open_loop_controller:feedforward.method:=fxlms',
        '-p',
        'duration:=0.1',
    )
    assert rejected.wait() == 2
    assert "feedforward.method: 'fxlms'; expected none, because this controller does not follow" in rejected.output
