"""The linear loop against the simulated one and against closed forms."""

import math

import numpy as np
import pytest

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
SLIDING = {'friction.model': 'none'}


@pytest.mark.parametrize('delay', [0, 1, 2])
def test_poles_tell_what_the_recursion_does(delay):
    """The closed loop stepped by hand grows or decays as its largest pole says."""
    drive = sampled_drive(PlantParameters(), T, presliding=True)
    law = LinearController(0.1, 6e-5, integral=40.0, bandwidth=1500.0, delay=delay)
    radius = law.closed_loop_radius(drive)
    smoothing = 1.0 - math.exp(-2.0 * math.pi * 1500.0 * T)
    state, integral, filtered, waiting = np.ones((len(drive.a), 1)), 0.0, 0.0, [0.0] * delay
    sizes = []
    for _ in range(4000):
        x, v = (drive.c @ state)[:, 0]
        integral += T * x
        filtered += smoothing * (v - filtered)
        waiting.append(-(0.1 * x + 40.0 * integral + 6e-5 * filtered))
        state = drive.a @ state + drive.b * waiting.pop(0)
        sizes.append(abs(x))
    growth = (max(sizes[3500:]) / max(sizes[2500:3000])) ** (1.0 / 1000.0)
    assert radius == pytest.approx(growth, abs=2e-3)


def test_peak_sensitivity_of_a_known_loop():
    """k/s under a hold: |S| = |z - 1|/|z - 1 + kT| peaks at Nyquist with 2/(2 - kT)."""
    parameters = from_mapping(PlantParameters, {'gain': 1.0, 'resonance.form': 'none', **SLIDING})
    margins = LoopMargins(parameters, T)
    # A hair of k_p keeps the free position from counting as a pole at 1.
    peak = margins.peak_sensitivity(LinearController(1e-3, 0.8 / T))
    assert peak == pytest.approx(2.0 / (2.0 - 0.8), rel=1e-3)


def test_an_unstable_loop_has_no_sensitivity():
    margins = LoopMargins(PlantParameters(), T)
    assert margins.peak_sensitivity(LinearController(0.1, 5e-4)) == math.inf
    assert margins.peak_sensitivity(LinearController(0.05, 8e-5)) < 2.0


@pytest.mark.parametrize('gain', [math.inf, math.nan, 1e300])
def test_gains_of_a_run_that_has_diverged(gain):
    margins = LoopMargins(PlantParameters(), T)
    laws = [LinearController(0.05, 8e-5), LinearController(0.05, gain)]
    assert margins.peak_sensitivity(laws[1]) == math.inf
    peaks = margins.peak_sensitivities(laws)
    assert peaks[0] == pytest.approx(margins.peak_sensitivity(laws[0]), rel=1e-3)
    assert peaks[1] == math.inf


def test_many_controllers_at_once():
    margins = LoopMargins(from_mapping(PlantParameters, {'actuator.driver': 'voltage'}), T)
    laws = [
        LinearController(k_p, k_d, k_i, 2500.0, 1, difference=True)
        for k_p, k_d, k_i in [(0.03, 5e-5, 0.0), (0.1, 1e-4, 30.0), (0.2, 2e-4, 5.0), (0.1, 2e-3, 5.0)]
    ]
    expected = [margins.peak_sensitivity(law) for law in laws]
    assert any(map(math.isinf, expected))
    assert margins.peak_sensitivities(laws) == pytest.approx(expected, rel=1e-3)
    with pytest.raises(ValueError, match='may differ only in k_p, k_d and k_i'):
        margins.peak_sensitivities([laws[0], LinearController(0.1, 1e-4)])


def test_a_late_command_costs_margin():
    margins = LoopMargins(PlantParameters(), T)
    peaks = [margins.peak_sensitivity(LinearController(0.03, 5e-5, delay=delay)) for delay in (0, 1, 2)]
    assert peaks[0] < peaks[1] < peaks[2]


SPRING = {'friction.coulomb_level': 1e6, 'friction.static_level': 1e6}


@pytest.mark.parametrize('driver', ['reduced', 'rigid', 'current', 'voltage'])
def test_peak_sensitivity_is_that_of_the_simulated_loop(driver):
    """The impulse response of S, measured on the block under the law, transforms into S."""
    values = {'actuator.driver': driver, 'actuator.amplifier_time_constant': 4e-5, **SPRING, 'substeps': 256}
    if driver == 'voltage':
        values['actuator.amplifier_gain'] = 0.4
    parameters = from_mapping(PlantParameters, values)
    law = LinearController(0.03, 5e-5)
    plant = Plant(parameters, T)
    # u = impulse - law(head): the loop's S from an impulse added to the control to the control itself.
    controls, (x, v, _) = [], plant.output()
    for k in range(6000):
        u = (1e-3 if k == 0 else 0.0) - (law.proportional * x + law.derivative * v)
        controls.append(u)
        x, v, _ = plant.step(k + 1, u)
    assert abs(controls[-1]) < 1e-9
    margins = LoopMargins(parameters, T)
    phases = np.exp(-2j * np.pi * np.outer(margins.frequencies, np.arange(6000)) * T)
    measured = float(np.abs(phases @ np.array(controls) / 1e-3).max())
    (drive, _), (response, _) = margins.drives, margins.responses
    assert law.closed_loop_radius(drive) < 1.0
    loop = (law.response(margins.frequencies, T) * response).sum(axis=1)
    assert float(np.abs(1.0 / (1.0 + loop)).max()) == pytest.approx(measured, rel=2e-3)
    assert margins.peak_sensitivity(law) >= measured * (1.0 - 2e-3)


@pytest.mark.parametrize('driver', ['rigid', 'current', 'voltage'])
def test_a_gain_that_the_driver_does_not_read_does_not_move_the_peak(driver):
    values = {'actuator.driver': driver}
    peaks = {
        LoopMargins(from_mapping(PlantParameters, {**values, 'gain': gain}), T).peak_sensitivity(
            LinearController(0.03, 5e-5)
        )
        for gain in (1e7, 4.0968e7, 8e7)
    }
    assert len(peaks) == 1


def test_a_voltage_driver_of_an_eighth_of_the_gain_has_another_peak():
    law = LinearController(0.03, 5e-5)
    margins = LoopMargins(from_mapping(PlantParameters, {'actuator.driver': 'voltage'}), T)
    assert margins.rigid_gain == pytest.approx(4.0968e7 / 8.0)
    assert margins.peak_sensitivity(law) != pytest.approx(
        LoopMargins(PlantParameters(), T).peak_sensitivity(law), rel=0.05
    )
