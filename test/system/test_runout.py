"""A run with cancellation of runout: the same bits in separate processes, in `rig`, in `simulate`, replayed."""

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, POSITION_SENSOR, nodes_of_run
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.simulation.run_setup import Simulation

NODES = nodes_of_run({CONTROLLER: CONTROLLERS['pid'], POSITION_SENSOR: 'servo_sensor'})
SECTORS = 84


def seconds(tick):
    """Return the time of a tick [s], as it is written."""
    return tick * 99206 / 1e9


RUNOUT = (
    *(
        '-p',
        'sample_time:=9.9206e-5',
        '-p',
        f'duration:={seconds(12 * SECTORS)}',
        '-p',
        'controller:=pid',
        '-p',
        'sensor:=servo',
    ),
    *('-p', 'plot:=false', '-p', 'reference_generator:amplitude:=0.0'),
    *('-p', f'disturbance_generator:spindle.sectors:={SECTORS}', '-p', f'servo_sensor:sectors:={SECTORS}'),
    *('-p', 'disturbance_generator:runout.repeatable.enabled:=true'),
    *('-p', 'disturbance_generator:runout.repeatable.sequence:=random'),
    *('-p', 'pid_controller:proportional_gain:=0.148', '-p', 'pid_controller:integral_gain:=20.0'),
    *('-p', 'pid_controller:derivative_gain:=1.69e-4', '-p', 'pid_controller:observer.bandwidth:=20000.0'),
    *('-p', 'pid_controller:runout.cutoff:=0.0'),
)
SCHEDULE = (
    '-p',
    f"schedule:=['{seconds(400)} pid_controller runout.enabled false',"
    f" '{seconds(600)} pid_controller runout.enabled true',"
    f" '{seconds(700)} pid_controller runout.gain 0.1', '{seconds(800)} pid_controller proportional_gain 0.12']",
)


def method(name):
    return ('-p', f'pid_controller:runout.method:={name}')


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    for name in ('harmonics', 'repetitive'):
        experiment = Simulation(parse_ros_arguments(['--ros-args', *RUNOUT, *method(name)])).experiment
        experiment.run(0, 2)
        assert experiment.runout is not None
        experiment.runout.step(0, 0.0)


@pytest.mark.parametrize('name', ['harmonics', 'repetitive'])
def test_the_same_bits_however_it_is_run(bench, name):
    arguments = (*RUNOUT, *method(name), *SCHEDULE)
    for executable in ('simulate', 'rig'):
        bench.run(executable, *arguments, '-p', f'run_dir:={executable}')
    nodes = bench.start_nodes('processes', *arguments, nodes=NODES)
    nodes['disturbance_generator'] = bench.start('disturbance_generator', *arguments)
    for process in nodes.values():
        assert process.wait() == 0, process.output
    simulated = bench.directory / 'simulate'
    for run in ('rig', 'processes'):
        assert first_difference(simulated, bench.directory / run) is None
    estimates = Run.open(bench.directory / 'rig').estimates
    u, rms = estimates['u_rro'], estimates['rro_rms']
    waited = u[:SECTORS] if name == 'harmonics' else u[: 2 * SECTORS]
    assert not waited.any()
    assert u[2 * SECTORS : 400].any()
    # It rests while it is not enabled, and goes on with what it has learned.
    assert not u[400:600].any()
    assert np.abs(u[600 : 600 + SECTORS]).max() > 0.5 * np.abs(u[400 - SECTORS : 400]).max()
    assert len(set(rms[6 * SECTORS : 600].tolist())) == 1
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'rig', '--without-ros')
    assert 'bit-identical on every topic' in answer.stdout, answer.stdout + answer.stderr


@pytest.mark.parametrize('name', ['harmonics', 'repetitive'])
def test_a_controller_from_python_has_the_cancellation_of_the_compiled_loop(name):
    arguments = ['--ros-args', *RUNOUT, *method(name)]
    # With the feedforward as well: its estimates come first.
    arguments += ['-p', 'pid_controller:feedforward.method:=fixed']
    whole, stepped = (Simulation(parse_ros_arguments(arguments)).experiment for _ in range(2))
    stepped._kind = None  # the path of a controller that is called tick by tick
    rows, found = whole.run(0, 300), stepped.run(0, 300)
    assert whole.estimate_names[-10:-2] == (
        *('u_ff', 'ff_share', 'ff_rms', 'ff_rms_without', 'ff_weights'),
        *('u_rro', 'rro_rms', 'rro_gain'),
    )
    assert rows.estimates['u_rro'].any()
    for topic in ('head', 'control', 'estimates', 'pes'):
        assert rows[topic].tobytes() == found[topic].tobytes(), topic


def test_without_a_method_nothing_changes():
    usual, named = (
        Simulation(parse_ros_arguments(['--ros-args', *RUNOUT, *more])).experiment.run(0, 300)
        for more in ((), ('-p', 'pid_controller:runout.gain:=0.5', *method('none')))
    )
    assert 'u_rro' not in usual.estimate_names
    for topic in ('head', 'control', 'estimates', 'pes'):
        assert usual[topic].tobytes() == named[topic].tobytes(), topic


def test_a_revolution_without_a_whole_number_of_samples_is_rejected(bench):
    allowed = "runout.method: 'repetitive'; expected harmonics, since repetitive needs an integer number of samples"
    arguments = (*RUNOUT, '-p', 'sample_time:=1e-4', '-p', 'duration:=0.1', *method('repetitive'))
    arguments = (*arguments, '-p', 'disturbance_generator:runout.repeatable.sequence:=none')
    rejected = bench.start('simulate', *arguments)
    assert rejected.wait() == 2
    assert allowed in rejected.output
    nodes = bench.start_nodes('processes', *arguments, nodes=NODES)
    nodes['disturbance_generator'] = bench.start('disturbance_generator', *arguments)
    codes = {node: process.wait() for node, process in nodes.items()}
    assert codes['pid_controller'] == 1
    assert allowed in nodes['pid_controller'].output


@pytest.mark.parametrize('name', ['simulate', 'rig'])
def test_a_controller_without_an_error_has_no_cancellation(bench, name):
    arguments = ('-p', 'controller:=open_loop', '-p', 'open_loop_controller:runout.method:=harmonics')
    rejected = bench.start(name, *arguments, '-p', 'duration:=0.1')
    assert rejected.wait() == 2
    assert "runout.method: 'harmonics'; expected none, because this controller does not follow" in rejected.output


def test_a_drive_in_other_units_is_rejected(bench):
    arguments = ('-p', 'vcm_plant:length_unit:=m', '-p', 'pid_controller:runout.method:=harmonics')
    rejected = bench.start('simulate', *arguments, '-p', 'controller:=pid', '-p', 'duration:=0.1')
    assert rejected.wait() == 2
    assert 'none with a drive in m and V, because its parameters are in um and V' in rejected.output


def test_a_warning_at_the_start(bench):
    arguments = (*RUNOUT, *method('repetitive'), '-p', 'pid_controller:runout.gain:=1.0', '-p', 'record:=false')
    for name in ('simulate', 'rig'):
        ended = bench.run(name, *arguments)
        assert 'cancellation of runout: the loop with it has a peak sensitivity of' in ended.output
