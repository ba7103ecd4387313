"""The linear drive of every driver against the simulated one and against closed forms."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
SLIDING = {'friction.model': 'none'}
# So much static friction that it never leaves its linear spring.
SPRING = {'friction.coulomb_level': 1e6, 'friction.static_level': 1e6}
DRIVERS: dict[str, dict[str, Any]] = {
    'reduced': {},
    'rigid': {'actuator.driver': 'rigid', 'actuator.inertia': 9.0e-6},
    'current': {'actuator.driver': 'current', 'actuator.source_resistance': 60.0},
    'current, slow amplifier': {'actuator.driver': 'current', 'actuator.amplifier_time_constant': 8.0e-5},
    'voltage': {'actuator.driver': 'voltage', 'actuator.amplifier_gain': 1.0},
    'voltage, default gain': {'actuator.driver': 'voltage'},
    'voltage, instant amplifier': {
        'actuator.driver': 'voltage',
        'actuator.amplifier_gain': 1.0,
        'actuator.amplifier_time_constant': 0.0,
    },
    'voltage, no inductance': {
        'actuator.driver': 'voltage',
        'actuator.amplifier_gain': 1.0,
        'actuator.coil_inductance': 0.0,
    },
    'voltage, instant': {
        'actuator.driver': 'voltage',
        'actuator.amplifier_gain': 1.0,
        'actuator.amplifier_time_constant': 0.0,
        'actuator.coil_inductance': 0.0,
    },
}
EVERY_DRIVER = pytest.mark.parametrize('driver', DRIVERS.values(), ids=DRIVERS)


def error_against_the_plant(parameters, presliding, amplitude):
    """Return the largest errors of position and velocity over their peaks, under a random control."""
    plant, drive = Plant(parameters, T), sampled_drive(parameters, T, presliding)
    state = np.zeros((len(drive.a), 1))
    rng = np.random.default_rng(1)
    found, expected = [], []
    for k in range(1, 300):
        u = float(rng.normal()) * amplitude
        found.append(plant.step(k, u)[:2])
        state = drive.a @ state + drive.b * u
        expected.append((drive.c @ state)[:, 0])
    outputs = np.array(expected)
    return np.abs(np.array(found) - outputs).max(axis=0) / np.abs(outputs).max(axis=0)


@EVERY_DRIVER
@pytest.mark.parametrize(('presliding', 'values'), [(False, SLIDING), (True, SPRING)], ids=['sliding', 'presliding'])
def test_follows_the_plant_sample_by_sample(driver, presliding, values):
    parameters = from_mapping(PlantParameters, {**driver, **values, 'substeps': 256})
    assert error_against_the_plant(parameters, presliding, 0.1).max() < 1e-3


@EVERY_DRIVER
def test_follows_tiny_motion_in_the_default_friction(driver):
    parameters = from_mapping(PlantParameters, {**driver, 'substeps': 256})
    assert error_against_the_plant(parameters, True, 1e-4).max() < 2e-3


@EVERY_DRIVER
def test_response_is_that_of_the_transfer_function(driver):
    """The sliding drive without friction: discretized by scipy from a state space written independently."""
    parameters = from_mapping(PlantParameters, {**driver, **SLIDING, 'substeps': 1024})
    frequencies = np.geomspace(20.0, 4999.0, 60)
    response = sampled_drive(parameters, T, presliding=False).response(frequencies)[:, 0]
    np.testing.assert_allclose(response, transfer.sampled_frequency_response(parameters, T, frequencies), rtol=1e-4)


@EVERY_DRIVER
@pytest.mark.parametrize('presliding', [False, True])
def test_a_gain_that_the_driver_does_not_read_changes_nothing(driver, presliding):
    one, other = (
        sampled_drive(from_mapping(PlantParameters, {**driver, 'gain': gain}), T, presliding)
        for gain in (4.0968e7, 1.0e7)
    )
    assert np.array_equal(one.a, other.a) == (driver != {})
    assert np.array_equal(one.b, other.b) == (driver != {})


def test_a_response_of_a_rigid_body():
    parameters = from_mapping(PlantParameters, {'resonance.form': 'none', **SLIDING})
    frequencies = np.array([10.0, 100.0, 1000.0])
    z = np.exp(2j * np.pi * frequencies * T)
    response = sampled_drive(parameters, T, presliding=False).response(frequencies)
    # Double integrator under a hold, from any table of z transforms.
    np.testing.assert_allclose(response[:, 0], parameters.gain * T**2 * (z + 1) / (2 * (z - 1) ** 2), rtol=1e-9)
    np.testing.assert_allclose(response[:, 1], parameters.gain * T / (z - 1), rtol=1e-9)


def test_back_emf_damps_a_voltage_driven_body():
    """Without lags it is a first-order lag of the velocity: K(1 - p)/(z - p) with p = exp(-gain kappa T)."""
    values = {**DRIVERS['voltage, instant'], 'resonance.form': 'none', **SLIDING, 'substeps': 1024}
    parameters = from_mapping(PlantParameters, values)
    frequencies = np.array([10.0, 100.0, 1000.0])
    z = np.exp(2j * np.pi * frequencies * T)
    kappa = 0.08 / (0.05 * 1e6)
    p = np.exp(-parameters.rigid_gain * kappa * T)
    velocity = sampled_drive(parameters, T, presliding=False).response(frequencies)[:, 1]
    np.testing.assert_allclose(velocity, (1.0 - p) / kappa / (z - p), rtol=1e-9)
