"""The loop with the cancellation of runout: its path, peak sensitivity and stability against loops that are run."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.feedforward_path import feedforward_path, runout_path
from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.linear_laws import pid_law
from hdd_servo_ros.analysis.runout_sensitivity import linear_law, runout_margin, runout_warnings, speed_warnings
from hdd_servo_ros.analysis.sensitivity import LoopMargins
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.observer import Observer, ObserverParameters
from hdd_servo_ros.control.open_loop import OpenLoop, OpenLoopParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.control.runout import RunoutCancellation
from hdd_servo_ros.control.runout_parameters import RunoutModelParameters, RunoutParameters
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.parameters import from_mapping

SECTORS = 84
T = 99206e-9
GAINS = PidParameters(
    proportional_gain=0.2, integral_gain=20.0, derivative_gain=6e-5, derivative_bandwidth=3000.0, control_limit=100.0
)
PLANT = PlantParameters()
MODEL = RunoutModelParameters()


@pytest.fixture(scope='module')
def margins():
    return LoopMargins(PLANT, T)


def path_of(runout, delay=0):
    return runout_path(runout, Pid(GAINS, T), DspParameters(computation_delay=delay), T)


def run_loop(margins, runout, path, forces, delay=0):
    """
    Return the errors of the linear drive with the very blocks of controller and cancellation, under a force [V].

    The drive is that in presliding.
    """
    drive, law = margins.drives[0], Pid(GAINS, T)
    cancellation = None if runout is None else RunoutCancellation(runout, T, path)
    states, late, errors = np.zeros(len(drive.a)), [0.0] * delay, np.zeros(len(forces))
    for tick, force in enumerate(forces):
        position, velocity = drive.c @ states
        errors[tick] = position
        u, _, _ = law.step(ControllerInputs(tick, position, velocity, 0.0, 0.0, 0.0, 0.0, 0.0))
        late.append(u + (0.0 if cancellation is None else cancellation.step(tick, position)))
        states = drive.a @ states + drive.b[:, 0] * (late.pop(0) + force)
    return errors


@pytest.mark.parametrize('delay', [0, 1])
def test_the_path_is_the_response_of_the_sampled_drive_with_its_resonances(margins, delay):
    path = path_of(RunoutParameters(method='harmonics'), delay)
    frequencies = np.array([240.0, 800.0, 2160.0, 3480.0, 4560.0])
    found = path @ np.exp(-2j * np.pi * np.outer(np.arange(len(path)), frequencies * T))
    wanted = margins.path(pid_law(GAINS, delay), 0, frequencies)
    np.testing.assert_allclose(found, wanted, rtol=0.02)
    pulse = np.zeros(len(path))
    pulse[0] = 1.0
    simulated = run_loop(margins, None, path, np.concatenate([np.zeros(delay), pulse])[: len(path)], delay)
    np.testing.assert_allclose(path, simulated, atol=2e-3 * np.abs(path).max())


def test_the_path_without_feedback_is_the_transfer_function_of_scipy():
    """Rigid body, spring and one resonance, and no controller."""
    section = ((0.9, 500.0, 1.2e9), (1.0, 2000.0, 1.184e9))
    none = Pid(PidParameters(proportional_gain=0.0, integral_gain=0.0, derivative_gain=0.0), T)
    found = feedforward_path(none, DspParameters(), MODEL, T, 200, resonances=section)
    g = MODEL.gain
    system = signal.TransferFunction(
        g * np.array(section[0]), np.polymul([1.0, g * MODEL.viscous_coefficient, g * MODEL.stiffness], section[1])
    )
    numerator, denominator, _ = signal.cont2discrete((system.num, system.den), T, 'zoh')
    pulse = np.zeros(200)
    pulse[0] = 1.0
    wanted = signal.lfilter(numerator[0], denominator, pulse)
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


def test_the_path_knows_the_observer():
    observer = ObserverParameters(bandwidth=5000.0)
    seen = LoopMargins(PLANT, T, observer=observer)
    gains = dataclasses.replace(GAINS, proportional_gain=0.1, derivative_gain=1e-4)
    path = runout_path(
        RunoutParameters(method='harmonics'), Pid(gains, T), DspParameters(), T, observer=Observer(observer, T)
    )
    frequencies = np.array([240.0, 800.0, 2160.0, 4560.0])
    found = path @ np.exp(-2j * np.pi * np.outer(np.arange(len(path)), frequencies * T))
    np.testing.assert_allclose(found, seen.path(pid_law(gains), 0, frequencies), rtol=0.02)


@pytest.mark.parametrize(('order', 'beside'), [(3, 0.01), (3, -0.1), (5, 0.3)])
def test_sensitivity_of_harmonics_is_that_of_a_sine(margins, order, beside):
    """A force near an order: the error with the cancellation over that without is 1/|1 + H C|."""
    runout = RunoutParameters(method='harmonics', orders=(1, 3, 5), gain=0.3, initial_gain=0.3, wait=0)
    path = path_of(runout)
    turns = (order + beside) / SECTORS
    ticks = 150 * SECTORS
    forces = 1e-3 * np.sin(2.0 * np.pi * turns * np.arange(ticks))
    carrier = np.exp(-2j * np.pi * turns * np.arange(ticks))[-100 * SECTORS :]
    without, found = (
        abs(carrier @ run_loop(margins, given, path, forces)[-100 * SECTORS :]) for given in (None, runout)
    )
    law = pid_law(GAINS)
    model = np.array([path @ np.exp(-2j * np.pi * n / SECTORS * np.arange(len(path))) for n in runout.orders])
    # In Laplace's variable, near an order, and far from the others: g e/(s T N/1) of the resonator in baseband.
    z = np.exp(2j * np.pi * turns)
    steps = np.exp(2j * np.pi * np.array(runout.orders) / SECTORS)
    resonators = (
        0.3 / SECTORS / model / (1.0 - steps / z) + 0.3 / SECTORS / model.conj() / (1.0 - steps.conj() / z)
    ).sum()
    wanted = 1.0 / abs(1.0 + margins.path(law, 0, np.array([turns / T]))[0] * resonators)
    assert found / without == pytest.approx(wanted, rel=0.02)
    assert runout_margin(margins, law, runout, path).peak >= wanted * abs(
        margins.sensitivity(law, 0, np.array([turns / T]))[0]
    )


def test_harmonics_is_stable_where_the_poles_are_and_diverges_where_not(margins):
    law = pid_law(GAINS)
    few = RunoutParameters(method='harmonics', orders=(1, 2, 3), gain=0.3, initial_gain=0.3, wait=0)
    many = dataclasses.replace(few, orders=tuple(range(1, 31)), gain=0.5, initial_gain=0.5)
    path = path_of(few)
    force = np.zeros(60 * SECTORS)
    # So small that the limit of the error does not count.
    force[0] = 1e-12
    assert math.isfinite(runout_margin(margins, law, few, path).peak)
    assert math.isinf(runout_margin(margins, law, many, path).peak)
    decayed, grown = (
        np.abs(run_loop(margins, given, path, force).reshape(60, -1)).max(axis=1) for given in (few, many)
    )
    assert decayed[-1] < 1e-2 * decayed[0]
    assert grown[20] > 3.0 * grown[5]


@pytest.mark.parametrize('gain', [0.1, 0.5])
def test_peak_of_repetitive_bounds_what_sines_between_the_orders_have(margins, gain):
    """Half way between two orders the sensitivity is larger by 1/(1 - gain/2), and nowhere by more than the peak."""
    law = pid_law(GAINS)
    runout = RunoutParameters(method='repetitive', cutoff=0.0, gain=gain, wait=0)
    path = path_of(runout)
    found = runout_margin(margins, law, runout, path)
    assert found.slowest == pytest.approx(1.0 - gain, abs=0.03)
    without = margins.peak_sensitivity(law)
    assert found.peak == pytest.approx(without * 2.0 / (2.0 - gain), rel=0.05)
    ticks = 130 * SECTORS
    ratios = []
    for order in (8.5, 20.5):
        forces = 1e-3 * np.sin(2.0 * np.pi * order / SECTORS * np.arange(ticks))
        carrier = np.exp(-2j * np.pi * order / SECTORS * np.arange(ticks))[-60 * SECTORS :]
        pair = [abs(carrier @ run_loop(margins, given, path, forces)[-60 * SECTORS :]) for given in (None, runout)]
        ratios.append(pair[1] / pair[0])
    # The cancellation holds one frequency's share of a step between revolutions, so that not all is at this frequency.
    assert min(ratios) > 1.0
    assert max(ratios) <= found.peak / without * 1.03


@pytest.mark.parametrize('scale', [0.5, 3.0, -1.0])
def test_an_order_of_repetitive_changes_by_the_factor_that_is_told(margins, scale):
    """The error of an order decays or grows by it from revolution to revolution, with a model that is wrong."""
    runout = RunoutParameters(method='repetitive', cutoff=0.0, gain=0.1, wait=0)
    wrong = path_of(runout) / scale
    found = runout_margin(margins, pid_law(GAINS), runout, wrong)
    assert math.isinf(found.peak) == (scale < 0.0)
    forces = 1e-9 * np.sin(2.0 * np.pi * 12 / SECTORS * np.arange(80 * SECTORS))
    errors = run_loop(margins, runout, wrong, forces).reshape(80, SECTORS)
    order = np.abs(np.fft.rfft(errors, axis=1)[:, 12])
    wanted = abs(1.0 - 0.1 * scale)
    # After the larger gains of the first revolutions, and before rounding or the limits.
    assert (order[32] / order[22]) ** 0.1 == pytest.approx(wanted, rel=0.05)


def test_warnings():
    runout = RunoutParameters(method='repetitive', cutoff=0.0)
    path, controller = path_of(runout), Pid(GAINS, T)
    loop = LoopSurroundings(PLANT, T)
    assert runout_warnings(controller, loop, runout, path) == ()
    (low,) = runout_warnings(controller, loop, dataclasses.replace(runout, gain=1.0), path)
    assert 'has a peak sensitivity of' in low
    assert 'above 2.2 (runout.method repetitive, at T = 9.9206e-05 s): lower runout.gain' in low
    rigid = dataclasses.replace(runout, model=dataclasses.replace(MODEL, numerators=(), denominators=()))
    (wrong,) = runout_warnings(controller, loop, rigid, path_of(rigid))
    assert wrong.startswith('cancellation of runout: order ')
    assert wrong.endswith('correct runout.model, or lower runout.cutoff')
    assert runout_warnings(controller, loop, dataclasses.replace(rigid, cutoff=1500.0), path_of(rigid)) == ()
    many = RunoutParameters(method='harmonics', orders=tuple(range(1, 31)), initial_gain=0.6)
    (first,) = runout_warnings(controller, loop, many, path_of(many))
    assert 'unstable with the gain of the first revolutions' in first
    (always,) = runout_warnings(controller, loop, dataclasses.replace(many, gain=0.6), path_of(many))
    assert 'the loop with it is unstable' in always


def test_a_loop_that_is_unstable_without_it_has_one_warning_alone():
    runout = RunoutParameters(method='repetitive')
    late, path = LoopSurroundings(PLANT, T, delay=1), path_of(runout, 1)
    gains = dataclasses.replace(GAINS, derivative_gain=4e-4)
    assert math.isinf(late.margins.peak_sensitivity(pid_law(gains, 1)))
    assert runout_warnings(Pid(gains, T), late, runout, path) == ()
    assert math.isinf(runout_margin(late.margins, pid_law(gains, 1), runout, path).peak)


def test_only_controllers_of_this_package_are_linear_ones():
    assert linear_law(Pid(GAINS, T), 1) == pid_law(GAINS, 1)
    adaptive = linear_law(AdaptiveNn(AdaptiveNnParameters(), T), 0)
    assert adaptive is not None
    assert adaptive.derivative > 0.0
    assert linear_law(OpenLoop(OpenLoopParameters(), T), 0) is None
    loop, runout = LoopSurroundings(PLANT, T), RunoutParameters(method='repetitive')
    assert runout_warnings(OpenLoop(OpenLoopParameters(), T), loop, runout, path_of(runout)) == ()


def test_a_drive_without_a_presliding_spring_has_one_state():
    plant = dataclasses.replace(PLANT, friction=FrictionParameters(model='none'))
    free = LoopMargins(plant, T)
    assert len(free.drives) == 1
    runout = RunoutParameters(method='repetitive', gain=0.1)
    found = runout_margin(free, pid_law(GAINS), runout, path_of(runout))
    assert math.isfinite(found.peak)


def test_another_speed_than_that_of_the_spindle_is_warned_of():
    shaken = from_mapping(
        DisturbanceParameters,
        {'runout.repeatable.enabled': True, 'spindle.revolutions_per_minute': 5400.0},
    )
    (line,) = speed_warnings(RunoutParameters(method='harmonics'), shaken)
    assert 'runout.revolutions_per_minute is 7200' in line
    assert 'turns at 5400 1/min' in line
    assert not speed_warnings(RunoutParameters(method='harmonics', revolutions_per_minute=5400.0), shaken)
    assert not speed_warnings(RunoutParameters(method='harmonics'), DisturbanceParameters())
    assert not speed_warnings(RunoutParameters(method='harmonics'), None)
