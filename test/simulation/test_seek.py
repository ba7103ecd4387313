"""How fast the head seeks: every run is the compiled loop with drive, vibrometer and controller."""

import itertools

import numpy as np
import pytest

from hdd_servo_ros.control.seek_kernel import SEEK, SETTLE
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.simulation.run_setup import Simulation

T = 1e-4
DWELL = 300
"""Samples from a seek to the next."""
SENSOR = {'displacement_scale': 30.0, 'velocity_scale': 3e4}
WIDE_SENSOR = {'displacement_scale': 200.0, 'velocity_scale': 1.5e5}
TOLERANCE, NARROW = 0.1, 0.025
DEFAULT = PlantParameters()


def drive(friction=1.0, gain=1.0, modes=1.0):
    """Return the parameters of a drive that differs from the nominal one by factors."""
    powers = np.array([1.0, modes, modes**2])
    found = {'gain': DEFAULT.gain * gain}
    for name in ('stiffness', 'coulomb_level', 'static_level'):
        found[f'friction.{name}'] = getattr(DEFAULT.friction, name) * friction
    for name in ('numerators', 'denominators'):
        sections = np.reshape(getattr(DEFAULT.resonance, name), (-1, 3)) * powers
        found[f'resonance.{name}'] = tuple(sections.ravel().tolist())
    return found


def seeks(targets, controller='seek', seed=1, sensor=SENSOR, servo='ldv', **nodes):
    """Run seeks one after the other, DWELL samples each; return head and command by seek, and the estimates."""
    experiment = Experiment(
        T,
        controller,
        {
            'reference_generator': {
                'waveform': 'seek',
                'seek.targets': tuple(map(float, targets)),
                'seek.dwell_times': (DWELL * T,),
                'seek.trajectory': 'step',
            },
            'ldv_sensor': {**sensor, 'seed': seed},
            **nodes,
        },
        sensor=servo,
    )
    rows = experiment.run(0, DWELL * len(targets))
    estimates = dict(zip(experiment.estimate_names, rows['estimates'].T, strict=True))
    return (
        rows.head[:, 0].reshape(-1, DWELL),
        rows.control[:, 0].reshape(-1, DWELL),
        {name: values.reshape(-1, DWELL) for name, values in estimates.items()},
    )


def arrivals(head, targets, tolerance):
    """Return the time from each target's step to the first sample inside that stays, or the dwell [ms]."""
    outside = abs(head - np.array(targets)[:, None]) > tolerance
    last = DWELL - np.argmax(outside[:, ::-1], axis=1)
    return 1e3 * T * np.where(outside.any(axis=1), last, 0)


def overshoot(head, targets):
    """Return by how far the head went beyond any target [um]."""
    steps = np.diff(targets, prepend=0.0)
    return float((np.sign(steps)[:, None] * (head - np.array(targets)[:, None])).max())


def to_and_fro(length, count):
    return [length if index % 2 == 0 else 0.0 for index in range(count)]


@pytest.mark.parametrize(
    ('length', 'bar'), [(1.0, 0.75), (5.0, 0.95), (10.0, 1.1), (50.0, 1.4), (100.0, 1.6), (150.0, 1.8)]
)
def test_the_nominal_drive(length, bar):
    targets = to_and_fro(length, 8)
    for seed in range(1, 11):
        head, u, _ = seeks(targets, seed=seed)
        assert arrivals(head, targets, TOLERANCE).max() <= bar
        assert overshoot(head, targets) <= 0.1
        assert abs(u).max() <= 10.0


@pytest.mark.parametrize(
    ('length', 'bar'), [(1.0, 0.9), (5.0, 1.1), (10.0, 1.5), (50.0, 1.9), (100.0, 2.4), (150.0, 2.7)]
)
def test_drives_with_other_friction_gain_and_modes(length, bar):
    targets = to_and_fro(length, 10)
    for friction, gain, modes in itertools.product((0.8, 1.2), (0.95, 1.05), (0.95, 1.05)):
        head, _, _ = seeks(targets, vcm_plant=drive(friction, gain, modes))
        assert arrivals(head, targets, TOLERANCE).max() <= bar
        assert overshoot(head, targets) <= 0.5


@pytest.mark.parametrize(('length', 'first', 'learned'), [(10.0, 1.5, 1.8), (50.0, 2.1, 2.6)])
def test_into_25_nm(length, first, learned):
    targets = to_and_fro(length, 30)
    head, _, _ = seeks(targets[:10])
    assert arrivals(head, targets[:10], NARROW).max() <= first
    without, _, _ = seeks(targets[:10], seek_controller={'seek.friction.enabled': False})
    assert np.median(arrivals(without, targets[:10], NARROW)) > 10.0
    for friction in (0.8, 1.2):
        head, _, estimates = seeks(targets, vcm_plant=drive(friction))
        assert arrivals(head, targets, NARROW)[20:].max() <= learned
        assert estimates['seek_friction'][-1, -1] == pytest.approx(friction, abs=0.06)


def test_the_gain_is_estimated_within_the_first_seek():
    for gain in (0.9, 1.1):
        _, _, estimates = seeks([50.0], vcm_plant=drive(gain=gain))
        assert estimates['seek_gain'][0, 8] == pytest.approx(gain, rel=0.02)


def test_a_velocity_beyond_the_sensors_range_does_not_count():
    # +-50 mm/s: the head is twice as fast.
    narrow = {'displacement_scale': 30.0, 'velocity_scale': 5000.0}
    _, _, estimates = seeks([50.0, 0.0], sensor=narrow)
    assert estimates['seek_gain'] == pytest.approx(np.ones((2, DWELL)), rel=0.05)


@pytest.mark.parametrize(('length', 'bar'), [(100.0, 2.5 * 0.987), (150.0, 2.5 * 1.21), (1000.0, 1.7 * 3.15)])
def test_ptos_is_near_the_time_optimal_seek(length, bar):
    targets = to_and_fro(length, 8)
    for seed in range(1, 6):
        sensor = SENSOR if length < 200.0 else WIDE_SENSOR
        head, _, _ = seeks(targets, seed=seed, sensor=sensor, seek_controller={'seek.method': 'ptos'})
        assert arrivals(head, targets, TOLERANCE).max() <= bar


@pytest.mark.parametrize('length', [5.0, 20.0, 50.0, 100.0, 150.0])
def test_cnf_is_20_percent_faster_than_ptos(length):
    targets = to_and_fro(length, 8)
    worst = {}
    for method in ('ptos', 'cnf'):
        every = [seeks(targets, seed=seed, seek_controller={'seek.method': method})[0] for seed in (1, 2, 3)]
        worst[method] = max(arrivals(head, targets, TOLERANCE).max() for head in every)
    assert worst['cnf'] <= 0.8 * worst['ptos']


@pytest.mark.parametrize('method', ['final_state', 'ptos', 'cnf'])
@pytest.mark.parametrize('length', [5.0, 50.0, 150.0])
def test_the_modes_follow_in_order_and_u_has_no_step_at_the_switch(method, length):
    targets = to_and_fro(length, 6)
    _, u, estimates = seeks(targets, seek_controller={'seek.method': method})
    for mode, voltage, added in zip(estimates['seek_mode'], u, estimates['seek_u'], strict=True):
        assert np.all(np.diff(mode)[mode[1:] == SETTLE] >= 0.0)
        switch = int(np.argmax(mode == SETTLE))
        assert np.all(mode[:switch] == SEEK)
        # No more than 1 % of u_max beyond what the trajectory or the law of the seek changes by itself.
        change = abs(voltage[switch] - voltage[switch - 1])
        own = abs(np.diff(added[switch - 3 : switch + 1])).max()
        assert change <= own + 0.1


@pytest.mark.parametrize('method', ['final_state', 'ptos', 'cnf'])
def test_a_servo_sensor_is_enough(method):
    observer = {'observer.stiffness': 0.0, 'observer.bandwidth': 5450.0}
    gains = {'proportional_gain': 0.25, 'derivative_gain': 1.69e-4, 'derivative_bandwidth': 5500.0}
    learning = {'seek.learning.friction_window': 2e-3}
    targets = [1.0, 0.0, 5.0, 0.0, 50.0, 0.0, 150.0, 0.0]
    node = {'seek.method': method, **observer, **gains, **learning}
    head, _, estimates = seeks(targets, servo='servo', seek_controller=node, servo_sensor={'noise': 3e-3})
    assert arrivals(head, targets, TOLERANCE).max() <= 6.0
    if method == 'final_state':
        assert np.median(arrivals(head, targets, TOLERANCE)) <= 1.0
        assert estimates['seek_gain'][:, -1] == pytest.approx(np.ones(8), abs=0.02)
        _, _, estimates = seeks([50.0, 0.0], servo='servo', seek_controller=node, vcm_plant=drive(gain=1.1))
        assert estimates['seek_gain'][:, -1] == pytest.approx(1.1 * np.ones(2), rel=0.02)


@pytest.mark.parametrize(
    ('targets', 'after', 'bar'), [((100.0, 0.0), 3, 2.0), ((60.0, 60.5), 2, 1.5), ((50.0, -50.0), 2, 3.0)]
)
def test_a_target_that_changes_on_the_way_teaches_nothing_wrong(targets, after, bar):
    experiment = Experiment(
        T,
        'seek',
        {
            'reference_generator': {
                'waveform': 'seek',
                'seek.targets': targets,
                'seek.dwell_times': (after * T, DWELL * T),
                'seek.trajectory': 'step',
                'seek.repeat': False,
            },
            'ldv_sensor': SENSOR,
        },
    )
    rows = experiment.run(0, DWELL)
    estimates = dict(zip(experiment.estimate_names, rows['estimates'].T, strict=True))
    outside = np.flatnonzero(abs(rows.head[:, 0] - targets[-1]) > TOLERANCE)
    assert 1e3 * T * (outside[-1] + 1 - after) <= bar
    assert estimates['seek_gain'] == pytest.approx(1.0, abs=0.01)
    assert estimates['seek_friction'] == pytest.approx(1.0, abs=0.05)


def test_targets_that_change_all_the_time_keep_the_head_between_them():
    targets = np.random.default_rng(5).uniform(-50.0, 50.0, 200)
    experiment = Experiment(
        T,
        'seek',
        {
            'reference_generator': {
                'waveform': 'seek',
                'seek.targets': tuple(targets.tolist()),
                'seek.dwell_times': (2.0 * T,),
                'seek.trajectory': 'step',
                'seek.repeat': False,
            },
            'ldv_sensor': {'displacement_scale': 60.0, 'velocity_scale': 6e4},
        },
    )
    head = experiment.run(0, 600).head[:, 0]
    assert abs(head).max() < 60.0
    assert head[-1] == pytest.approx(targets[-1], abs=0.1)


@pytest.mark.parametrize('bounds', [{'seek.jerk': 0.0}, {'seek.jerk': 1e13, 'seek.acceleration': 3e8}])
def test_a_trajectory_with_steps_of_acceleration_is_no_new_target(bounds):
    reference = {'waveform': 'seek', 'seek.targets': (40.0, 0.0), 'seek.trajectory': 'time_optimal', **bounds}
    experiment = Experiment(T, 'seek', {'reference_generator': reference, 'ldv_sensor': SENSOR})
    rows = experiment.run(0, 800)
    mode = rows['estimates'][:, experiment.estimate_names.index('seek_mode')]
    assert not mode.any()


@pytest.mark.parametrize('method', ['final_state', 'ptos', 'cnf'])
def test_an_observer_with_a_spring_is_no_obstacle(method):
    targets = [100.0, -40.0, 106.0, 0.0]
    experiment = Experiment(
        T,
        'seek',
        {
            'reference_generator': {
                'waveform': 'seek',
                'seek.targets': tuple(targets),
                'seek.dwell_times': (DWELL * T,),
                'seek.trajectory': 'step',
            },
            'seek_controller': {'seek.method': method},
        },
        sensor='servo',
    )
    head = experiment.run(0, DWELL * len(targets)).head[:, 0].reshape(-1, DWELL)
    assert arrivals(head, targets, TOLERANCE).max() <= 3.0


def test_a_weak_drive_gets_plans_that_it_can_follow():
    targets = to_and_fro(100.0, 4)
    head, u, _ = seeks(targets, vcm_plant={'control_limit': 2.0})
    assert abs(u).max() <= 2.0
    assert arrivals(head, targets, TOLERANCE).max() <= 4.0


@pytest.mark.parametrize('method', ['ptos', 'cnf'])
def test_a_late_command_is_allowed_for(method):
    targets = to_and_fro(50.0, 6)
    delayed = {
        'seek.method': method,
        'dsp.computation_delay': 1,
        'proportional_gain': 0.146,
        'integral_gain': 8.68,
        'derivative_gain': 8.67e-5,
        'derivative_bandwidth': 0.0,
    }
    head, _, _ = seeks(targets, seek_controller=delayed)
    assert arrivals(head, targets, TOLERANCE).max() <= 4.0


def test_plans_of_too_many_samples_are_rejected():
    with pytest.raises(ParameterError, match=r'seek_controller.seek.longest_plan: 0.0064; expected at most 0.001 s'):
        Experiment(1e-6, 'seek', {})


def test_other_nodes_may_change_during_a_seek():
    arguments = ['--ros-args', '-p', 'controller:=seek', '-p', 'duration:=0.02', '-p', 'record:=false']
    arguments += ['-p', "schedule:=['0.001 vcm_plant gain 4.0e7', '0.002 reference_generator waveform constant']"]
    simulation = Simulation(parse_ros_arguments(arguments))
    for tick in (10, 20):
        assert list(simulation.apply_schedule(tick))
