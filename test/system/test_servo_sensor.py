"""A run with the servo sensor: the same bits in separate processes, in `rig`, in `simulate` and replayed; no /ldv."""

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.linear_laws import pid_law
from hdd_servo_ros.analysis.sensitivity import LoopMargins
from hdd_servo_ros.control.observer import ObserverParameters
from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, POSITION_SENSOR, nodes_of_run
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.reporting.run_sensitivity import run_sensitivity

TICKS = 400
PARAMETERS = (
    *('-p', f'deterministic_timer:duration:={TICKS / 10_000}'),
    *(
        '-p',
        'servo_sensor:sectors:=84',
        '-p',
        'servo_sensor:missing.sectors:=[3]',
        '-p',
        'servo_sensor:nonlinearity:=3.0',
    ),
    *('-p', 'disturbance_generator:flutter.enabled:=true', '-p', 'disturbance_generator:force_noise.enabled:=true'),
    *('-p', 'pid_controller:proportional_gain:=0.1', '-p', 'pid_controller:derivative_gain:=1.2e-4'),
)
SERVO = ('-p', 'controller:=pid', '-p', 'sensor:=servo')


def nodes(**roles):
    found = {CONTROLLER: CONTROLLERS['pid'], POSITION_SENSOR: 'servo_sensor', **roles}
    return (*nodes_of_run(found), 'disturbance_generator')


def test_the_same_bits_however_it_is_run(bench):
    processes = bench.start_nodes('processes', *PARAMETERS, nodes=nodes())
    for process in processes.values():
        assert process.wait() == 0, process.output
    recorded = bench.directory / 'processes'
    run = Run.open(recorded)
    assert 'ldv' not in run
    assert run.pes.sector.tolist() == [tick % 84 for tick in range(TICKS + 1)]
    assert run.estimate_names[-2:] == ('observed_position', 'observed_velocity')
    for name in ('rig', 'simulate'):
        bench.run(name, *SERVO, *PARAMETERS, '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
        assert list(bench.run_yaml(name)['topics']) == list(bench.run_yaml('processes')['topics'])
    for how in ((), ('--without-ros',)):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded), *how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert f'ticks 0 to {TICKS}' in ended.stdout


@pytest.mark.parametrize('controller', ['pid', 'adaptive_nn'])
def test_the_same_bits_with_feedforward_from_accelerometers(bench, controller):
    node = CONTROLLERS[controller]
    arguments = (
        *('-p', f'deterministic_timer:duration:={TICKS / 10_000}', '-p', f'controller:={controller}'),
        *('-p', 'sensor:=servo', '-p', 'disturbance_generator:vibration.rotational.enabled:=true'),
        *('-p', 'disturbance_generator:flutter.enabled:=true', '-p', f'{node}:feedforward.method:=network'),
        *('-p', f"schedule:=['0.02 {node} feedforward.enabled false', '0.03 {node} observer.bandwidth 900.0']"),
    )
    for name in ('rig', 'simulate'):
        bench.run(name, *arguments, '-p', f'run_dir:={name}')
    own = nodes_of_run({CONTROLLER: node, POSITION_SENSOR: 'servo_sensor'})
    own = (*own, 'disturbance_generator', 'accelerometer')
    for process in bench.start_nodes('processes', *arguments, nodes=own).values():
        assert process.wait() == 0, process.output
    for name in ('simulate', 'processes'):
        assert first_difference(bench.directory / 'rig', bench.directory / name) is None
    run = Run.open(bench.directory / 'rig')
    assert run.estimate_names[-7:-2] == ('u_ff', 'ff_share', 'ff_rms', 'ff_rms_without', 'ff_weights')
    assert run.estimate_names[-2:] == ('observed_position', 'observed_velocity')
    assert run.estimates['u_ff'][100:200].any()
    ended = bench.python('-m', 'hdd_servo_ros.tools.replay', 'rig', '--without-ros')
    assert f'bit-identical on every topic, ticks 0 to {TICKS}' in ended.stdout, ended.stdout + ended.stderr


def test_a_live_change_of_the_observer_and_the_sensor_by_schedule(bench):
    schedule = "['0.01 pid_controller observer.bandwidth 900.0', '0.02 servo_sensor noise 0.02']"
    changed = ('-p', f'deterministic_timer:schedule:={schedule}')
    for name in ('rig', 'simulate'):
        bench.run(name, *SERVO, *PARAMETERS, *changed, '-p', f'run_dir:={name}')
    assert first_difference(bench.directory / 'rig', bench.directory / 'simulate') is None
    bench.run('simulate', *SERVO, *PARAMETERS, '-p', 'run_dir:=unchanged')
    changed_run, unchanged = (Run.open(bench.directory / name) for name in ('rig', 'unchanged'))
    same = (changed_run.control.voltage == unchanged.control.voltage).tolist()
    assert all(same[:100])
    assert not any(same[102:])


def test_report_compare_and_checks_of_a_run_without_ldv(bench):
    bench.run('simulate', *SERVO, *PARAMETERS, '-p', 'run_dir:=servo')
    ended = bench.python('-m', 'hdd_servo_ros.tools.report', 'servo')
    assert ended.returncode == 0, ended.stdout + ended.stderr
    page = (bench.directory / 'servo' / 'report.html').read_text()
    assert 'servo_sensor' in page
    run = Run.open(bench.directory / 'servo')
    run.check.finished().samples(TICKS + 1).unsaturated().bounded('pes.error', at_most=0.508)
    found = run_sensitivity(run)
    assert found is not None
    loop = LoopMargins(PlantParameters(), 1e-4, observer=ObserverParameters())
    wanted = loop.peak_sensitivity(pid_law(PidParameters(proportional_gain=0.1, derivative_gain=1.2e-4)))
    assert found.largest == wanted
    rejected = bench.python('-m', 'hdd_servo_ros.studies.stability_certificate', 'servo')
    assert rejected.returncode == 3
    assert 'adaptive_nn_controller' in rejected.stderr


@pytest.mark.parametrize('name', ['rig', 'simulate'])
def test_the_signal_analyzer_is_rejected(bench, name):
    process = bench.start(name, '-p', 'controller:=signal_analyzer', '-p', 'sensor:=servo')
    assert process.wait() == 2, process.output
    assert "sensor: 'servo'; expected ldv, because signal_analyzer measures /ldv" in process.output


def test_a_vibrometer_and_a_servo_sensor_at_once_are_rejected(bench):
    processes = bench.start_nodes('both', *PARAMETERS, nodes=(*nodes(), 'ldv_sensor'))
    codes = [process.wait() for process in processes.values()]
    assert 1 in codes
    assert any(
        '/pes is published by /servo_sensor and /ldv by /ldv_sensor; a run must have only one of them' in process.output
        for process in processes.values()
    )
