"""Seek and settle around a controller, in the loop with drive and vibrometer."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from hdd_servo_ros.analysis.seek_plans import seek_plans
from hdd_servo_ros.analysis.seek_surroundings import seek_surroundings
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.observer import Observer, ObserverParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.control.seek import Seek, SeekSurroundings
from hdd_servo_ros.control.seek_kernel import ESTIMATES, FOLLOW, SEEK, SETTLE, STATE
from hdd_servo_ros.control.seek_parameters import SeekLearningParameters, SeekParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales
from hdd_servo_ros.numerics.records import record

T = 1e-4
PARAMETERS = SeekParameters(method='final_state')
PLAIN = dataclasses.replace(
    PARAMETERS,
    friction=dataclasses.replace(PARAMETERS.friction, enabled=False),
    learning=SeekLearningParameters(gain=False, friction=False),
)


class PerfectHead:
    """Head that follows the trajectory exactly: the remaining voltage is that of the seek part."""

    def __init__(self, parameters=PLAIN, delay=0):
        self.seek = Seek(parameters, T, SeekSurroundings(seek_plans(parameters, T), delay))
        self.tick = 0
        self.position = 0.0
        self.velocity = 0.0

    def step(self, x_d, dx_d=0.0, ddx_d=0.0):
        """Return offset and added voltage of a tick, and its estimates by name."""
        inputs = ControllerInputs(self.tick, self.position, self.velocity, 0.0, 0.0, x_d, dx_d, ddx_d)
        shifted = self.seek.before_law(inputs, 0.0)
        u, _, _ = self.seek.after_law(0.0, 0.0, 0.0)
        self.tick += 1
        found = record(self.seek.estimates, ESTIMATES)
        estimates = {name: float(found[name]) for name in self.seek.estimate_names}
        self.position = estimates['seek_trajectory']
        return self.position - x_d, u, estimates, shifted

    def run(self, targets):
        return [self.step(float(x_d)) for x_d in targets]


def test_a_target_is_reached_by_the_trajectory_and_the_modes_follow_each_other():
    found = PerfectHead().run([0.0] * 3 + [50.0] * 90)
    offsets = np.array([offset for offset, *_ in found])
    modes = [estimates['seek_mode'] for _, _, estimates, _ in found]
    assert modes[:3] == [FOLLOW] * 3
    assert offsets[2] == 0.0
    assert offsets[3] == -50.0
    changes = [mode for before, mode in itertools.pairwise(modes) if mode != before]
    assert changes == [SEEK, SETTLE, FOLLOW]
    samples = modes.index(SETTLE) - 3
    assert 8 <= samples <= 13
    assert abs(offsets[3 + samples :]).max() <= PLAIN.vibration_limit
    assert not offsets[-20:].any()
    u = np.array([u for _, u, _, _ in found])
    assert abs(u).max() <= PLAIN.control_limit
    assert not u[3 + samples :].any()


def test_the_controller_sees_the_deviation_from_the_trajectory():
    head = PerfectHead()
    head.step(0.0)
    head.position += 0.25
    _, _, estimates, shifted = head.step(20.0)
    assert estimates['seek_trajectory'] == 0.0
    assert shifted.position - shifted.desired_position == pytest.approx(0.25)
    assert estimates['seek_distance'] == pytest.approx(19.75)
    assert estimates['seek_target'] == 20.0


def test_the_volts_of_the_sensor_are_shifted_as_well():
    scales = SensorScales(30.0, 3e4)
    seek = Seek(PLAIN, T, SeekSurroundings(seek_plans(PLAIN, T)), scales)
    for tick in range(8):
        inputs = scales.inputs(tick, 0.1, 0.2, 3.0 if tick < 2 else 33.0, 0.0, 0.0)
        shifted = seek.before_law(inputs, 0.0)
        seek.after_law(0.0, 0.0, 0.0)
        assert shifted.displacement_volts * 30.0 == pytest.approx(shifted.position)
        assert shifted.velocity_volts * 3e4 == pytest.approx(shifted.velocity)


def test_a_target_that_changes_on_the_way_is_reached_without_a_stop():
    one = np.array([offset + 60.0 for offset, *_ in PerfectHead().run([0.0] + [60.0] * 80)])
    other = PerfectHead().run([0.0] + [40.0] * 4 + [60.0] * 76)
    positions = np.array([estimates['seek_trajectory'] for _, _, estimates, _ in other])
    assert abs(positions[-30:] - 60.0).max() < 1e-3
    u = np.array([u for _, u, _, _ in other])
    assert abs(u).max() <= PLAIN.control_limit
    # The second plan starts during the first one: the head arrives sooner than by two successive seeks.
    arrived = np.flatnonzero(abs(positions - 60.0) > 0.1)[-1]
    alone = np.flatnonzero(abs(one - 60.0) > 0.1)[-1]
    assert alone < arrived < 2 * alone


def test_from_any_state_also_back_again():
    found = PerfectHead().run([0.0] + [100.0] * 6 + [-20.0] * 90)
    positions = np.array([estimates['seek_trajectory'] for _, _, estimates, _ in found])
    assert positions.max() < 100.0
    assert abs(positions[-20:] + 20.0).max() < 1e-3
    assert max(abs(u) for _, u, _, _ in found) <= PLAIN.control_limit


def test_a_seek_that_is_too_long_for_one_plan_is_made_in_pieces():
    short = dataclasses.replace(PLAIN, longest_plan=1e-3)
    found = PerfectHead(short).run([0.0] + [500.0] * 400)
    positions = np.array([estimates['seek_trajectory'] for _, _, estimates, _ in found])
    assert abs(positions[-50:] - 500.0).max() < 1e-3
    assert max(abs(u) for _, u, _, _ in found) <= 1.0001 * PLAIN.control_limit
    modes = [estimates['seek_mode'] for _, _, estimates, _ in found]
    assert modes.count(SETTLE) <= 4
    assert modes[-1] == FOLLOW


@pytest.mark.parametrize('length', [0.1, 1.0, 5.0, 10.0, 50.0, 100.0, 150.0, 1000.0])
def test_the_voltage_keeps_to_its_limit_and_the_vibration_to_its_own(length):
    found = PerfectHead().run([0.0] + [length] * 120)
    u = np.array([u for _, u, _, _ in found])
    last = np.flatnonzero(u)[-1]
    offsets = np.array([offset for offset, *_ in found])
    assert abs(u).max() <= PLAIN.control_limit
    assert abs(offsets[last + 1 :]).max() <= PLAIN.vibration_limit + 1e-9


def test_with_a_delay_the_trajectory_comes_a_sample_later():
    targets = [0.0] * 2 + [30.0] * 60
    prompt = np.array([offset for offset, *_ in PerfectHead().run(targets)])
    late = np.array([offset for offset, *_ in PerfectHead(delay=1).run(targets)])
    assert late[2] == -30.0
    assert late[3:40] == pytest.approx(prompt[2:39], abs=1e-12)


@pytest.mark.parametrize('frequency', [10.0, 100.0, 700.0])
def test_a_sine_is_followed_and_no_target(frequency):
    head = PerfectHead()
    w = 2.0 * math.pi * frequency
    for tick in range(300):
        t = max(tick - 20, 0) * T
        moves = tick >= 20
        offset, u, estimates, _ = head.step(
            2.0 * math.sin(w * t) * moves, 2.0 * w * math.cos(w * t) * moves, -2.0 * w * w * math.sin(w * t) * moves
        )
        assert estimates['seek_mode'] == FOLLOW
        assert (offset, u) == (0.0, 0.0)


def test_a_head_that_is_not_on_the_reference_at_the_start_is_brought_there():
    head = PerfectHead()
    head.position = 7.0
    found = head.run([-3.0] * 60)
    assert found[0][0] == pytest.approx(10.0)
    assert found[0][2]['seek_mode'] == SEEK
    assert abs(found[-1][0]) < 1e-9


def test_what_is_not_finite_is_passed_on():
    head = PerfectHead()
    head.position = math.nan
    _, u, _, shifted = head.step(0.0)
    assert math.isnan(shifted.position)
    assert u == 0.0


def test_new_parameters_leave_a_seek_under_way():
    parameters = dataclasses.replace(PLAIN, control_limit=5.0)
    head, other = PerfectHead(), PerfectHead()
    targets = [0.0] + [80.0] * 5
    head.run(targets)
    other.run(targets)
    other.seek.update(parameters, SeekSurroundings(seek_plans(parameters, T)))
    assert [u for _, u, _, _ in other.run([80.0] * 20)] == [u for _, u, _, _ in head.run([80.0] * 20)]
    assert max(abs(u) for _, u, _, _ in other.run([-80.0] * 40)) <= 5.0


def test_the_sensors_velocity_limit_is_known():
    sensor = LdvParameters(velocity_scale=5000.0)

    def make():
        return Pid(PidParameters(), T)

    scales = SensorScales(8.0, 5000.0)
    found = seek_surroundings(PLAIN, make, T, Dsp(DspParameters(computation_delay=1), T, 10.0), scales, sensor)
    assert found.velocity_limit == pytest.approx(50000.0, rel=1e-3)
    assert found.delay == 1
    assert found.output_limit == 10.0
    assert seek_surroundings(PLAIN, make, T, Dsp(DspParameters(), T), scales, None).velocity_limit == math.inf


@pytest.mark.parametrize('delay', [0, 1])
@pytest.mark.parametrize('method', ['kalman', 'difference'])
def test_an_observer_shows_the_law_no_deviation_of_a_head_on_its_trajectory(method, delay):
    targets = [0.0] * 3 + [50.0] * 60 + [45.0] * 40
    known = dataclasses.replace(PLAIN, friction=dataclasses.replace(PARAMETERS.friction, range='always'))
    planned = PerfectHead(known, delay).run(targets)
    positions = [estimates['seek_trajectory'] for _, _, estimates, _ in planned]
    held = [0.0] * (1 + delay) + [u for _, u, _, _ in planned]
    parameters = ObserverParameters(method=method, stiffness=0.0)
    observer = Observer(parameters, T)
    seek = Seek(known, T, SeekSurroundings(seek_plans(known, T), delay, observer=observer.arrays[0]))
    velocities = []
    for tick, (x_d, position) in enumerate(zip(targets, positions, strict=True)):
        _, velocity = observer.step(position, held[tick])
        shifted = seek.before_law(ControllerInputs(tick, position, velocity, 0.0, 0.0, x_d, 0.0, 0.0), held[tick])
        assert seek.after_law(0.0, 0.0, 0.0)[0] == held[tick + 1 + delay]
        assert shifted.position == pytest.approx(x_d, abs=1e-9)
        velocities.append((velocity, shifted.velocity))
    shown, deviation = np.abs(velocities).max(axis=0)
    assert shown > 5e4
    # At the end the model is put to rest on the target, a correction of some nanometers.
    assert deviation < 1e-3 * shown


def test_an_observer_takes_no_held_friction_for_velocity_after_a_seek_by_feedback():
    parameters = dataclasses.replace(PARAMETERS, method='ptos')
    observer = Observer(ObserverParameters(stiffness=0.0), T)
    surroundings = seek_surroundings(
        parameters,
        lambda: Pid(PidParameters(), T),
        T,
        Dsp(DspParameters(), T),
        SensorScales.none(),
        None,
        observer.parameters,
    )
    assert surroundings.observer is not None
    seek, held, shown = Seek(parameters, T, surroundings), 0.0, []
    for tick in range(60):
        # The head overshoots by 2 um, and then rests on the target, held by the friction.
        position = 0.1 * min(tick, 20)
        _, velocity = observer.step(position, held)
        shifted = seek.before_law(ControllerInputs(tick, position, velocity, 0.0, 0.0, 2.0, 0.0, 0.0), held)
        seek.after_law(0.0, 0.0, 0.0)
        held = record(seek.arrays[1], STATE).friction
        shown.append((velocity, shifted.velocity))
    assert held > 0.01
    assert shown[-1][0] > 5.0
    assert shown[-1][1] == pytest.approx(0.0, abs=0.01 * shown[-1][0])
