"""The linear loop against the simulated one and against closed forms."""

import math

import numpy as np
import pytest

from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins, sampled_drive
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
SLIDING = {'friction.model': 'none'}
# So much static friction that it never leaves its linear spring.
SPRING = {'friction.coulomb_level': 1e6, 'friction.static_level': 1e6}


@pytest.mark.parametrize(('presliding', 'values'), [(False, SLIDING), (True, SPRING)])
def test_follows_the_plant_sample_by_sample(presliding, values):
    parameters = from_mapping(PlantParameters, {**values, 'substeps': 64})
    plant, drive = Plant(parameters, T), sampled_drive(parameters, T, presliding)
    state = np.zeros((len(drive.a), 1))
    rng = np.random.default_rng(1)
    found, expected = [], []
    u = 0.0
    for k in range(300):
        if k > 0:
            found.append(plant.step(k, u)[:2])
            state = drive.a @ state + drive.b * u
            expected.append((drive.c @ state)[:, 0])
        u = float(rng.normal()) * 0.1
    found, expected = np.array(found), np.array(expected)
    np.testing.assert_allclose(found / np.abs(expected).max(axis=0), expected / np.abs(expected).max(axis=0), atol=2e-3)


def test_response_of_a_rigid_body():
    parameters = from_mapping(PlantParameters, {'resonance.form': 'none', **SLIDING})
    frequencies = np.array([10.0, 100.0, 1000.0])
    z = np.exp(2j * np.pi * frequencies * T)
    response = sampled_drive(parameters, T, presliding=False).response(frequencies)
    # Double integrator under a hold, from any table of z transforms.
    np.testing.assert_allclose(response[:, 0], parameters.gain * T**2 * (z + 1) / (2 * (z - 1) ** 2), rtol=1e-9)
    np.testing.assert_allclose(response[:, 1], parameters.gain * T / (z - 1), rtol=1e-9)


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


def test_a_late_command_costs_margin():
    margins = LoopMargins(PlantParameters(), T)
    peaks = [margins.peak_sensitivity(LinearController(0.03, 5e-5, delay=delay)) for delay in (0, 1, 2)]
    assert peaks[0] < peaks[1] < peaks[2]
