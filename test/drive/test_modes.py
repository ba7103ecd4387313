"""A drive of modes alone, without a rigid body: exact response, transfer functions, and what it rejects."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.analysis.seek_bounds import time_optimal_seek
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

Array = npt.NDArray[np.float64]

T = 60.0 / (7200.0 * 220.0)
GAIN = 9.5e8
FREQUENCIES = (90.0, 4100.0, 8200.0, 3000.0)
DAMPINGS = (0.5, 0.02, 0.01, 0.002)
RESIDUES = (1.0, -1.0, 0.8, 0.02)
GIVEN: dict[str, Any] = {
    'gain': GAIN,
    'friction.model': 'none',
    'resonance.form': 'modes',
    'resonance.frequencies': FREQUENCIES,
    'resonance.damping_ratios': DAMPINGS,
    'resonance.residues': RESIDUES,
}


def drive(**values: Any) -> PlantParameters:
    return from_mapping(PlantParameters, {**GIVEN, **values})


def matrices() -> tuple[Array, Array, Array]:
    """Return the drive as a state space of q and q'/w of each mode, written down from its definition."""
    n = len(FREQUENCIES)
    a, b, c = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 1)), np.zeros((2, 2 * n))
    for i, (f, z, residue) in enumerate(zip(FREQUENCIES, DAMPINGS, RESIDUES, strict=True)):
        w = 2.0 * math.pi * f
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0.0, w], [-w, -2.0 * z * w]]
        b[2 * i + 1, 0] = GAIN / w
        c[0, 2 * i], c[1, 2 * i + 1] = residue, residue * w
    return a, b, c


def expected(frequencies: Array) -> npt.NDArray[np.complex128]:
    s = 2j * np.pi * frequencies
    terms = zip(FREQUENCIES, DAMPINGS, RESIDUES, strict=True)
    found = sum(c / (s * s + 4.0 * np.pi * f * z * s + (2.0 * np.pi * f) ** 2) for f, z, c in terms)
    return np.asarray(GAIN * found)


@pytest.mark.parametrize('substeps', [1, 4])
def test_the_response_to_held_voltages_is_that_of_scipy(substeps: int) -> None:
    voltages = np.random.default_rng(1).normal(0.0, 0.01, 4000)
    a, b, c = matrices()
    ad, bd, *_ = signal.cont2discrete((a, b, c, np.zeros((2, 1))), T)
    state, reference = np.zeros(len(a)), []
    for u in voltages:
        state = ad @ state + bd[:, 0] * u
        reference.append(c @ state)
    plant = Plant(drive(substeps=substeps), T)
    found = np.array([plant.step(tick, u) for tick, u in enumerate(voltages.tolist(), start=1)])
    for column in (0, 1):
        scale = np.abs(np.array(reference)[:, column]).max()
        np.testing.assert_allclose(found[:, column], np.array(reference)[:, column], atol=1e-11 * scale)
    assert not found[:, 2].any()


def test_a_constant_voltage_deflects_the_modes_as_springs() -> None:
    """The head comes to rest at k u times the sum of c/w^2, however long the voltage lasts."""
    plant = Plant(drive(), T)
    for tick in range(1, 200_001):
        position, velocity, _ = plant.step(tick, 0.01)
    rest = sum(c / (2.0 * math.pi * f) ** 2 for f, c in zip(FREQUENCIES, RESIDUES, strict=True))
    assert position == pytest.approx(GAIN * 0.01 * rest, rel=1e-12)
    assert abs(velocity) < 1e-6


def test_the_voltage_is_limited_and_a_disturbance_acts_against_it() -> None:
    limited, held, opposed = Plant(drive(control_limit=0.1), T), Plant(drive(), T), Plant(drive(), T)
    for tick in range(1, 50):
        found = limited.step(tick, 5.0, 0.04)
        assert found == opposed.step(tick, 0.1, 0.04)
        np.testing.assert_allclose(held.step(tick, 0.06), found, rtol=1e-12)


def test_the_sinusoidal_disturbance_is_that_of_scipy() -> None:
    frequency, amplitude, ticks = 500.0, 0.02, 300
    given = {'disturbance.amplitude': amplitude, 'disturbance.angular_frequency': 2.0 * math.pi * frequency}
    errors = []
    for substeps in (2, 4):
        plant = Plant(drive(substeps=substeps, **given), T)
        found = np.array([plant.step(tick, 0.0)[0] for tick in range(1, ticks + 1)])
        fine = np.arange(ticks * 200 + 1) * T / 200
        a, b, c = matrices()
        force = -amplitude * np.sin(2.0 * np.pi * frequency * fine)
        reference = signal.lsim((a, b, c[:1], np.zeros((1, 1))), force, fine)[1]
        errors.append(np.abs(found - np.ravel(reference)[200::200]).max() / np.abs(reference).max())
    assert errors[1] < 3e-5
    assert errors[1] < 0.3 * errors[0]


def test_the_drive_starts_with_its_first_mode() -> None:
    plant = Plant(drive(initial_position=2.0, initial_velocity=-300.0), T)
    assert plant.output() == (2.0, -300.0, 0.0)
    a, _, c = matrices()
    start = np.zeros(len(a))
    start[:2] = 2.0, -300.0 / (2.0 * math.pi * FREQUENCIES[0])
    (ad, *_) = signal.cont2discrete((a, np.zeros((len(a), 1)), c, np.zeros((2, 1))), 40 * T)
    for tick in range(1, 41):
        found = plant.step(tick, 0.0)
    np.testing.assert_allclose(found[:2], c @ (ad @ start), rtol=1e-10)


@pytest.mark.parametrize('driver', ['current', 'voltage'])
def test_a_driver_without_back_emf_filters_the_force(driver: str) -> None:
    parameters = drive(**{'actuator.driver': driver, 'actuator.back_emf_constant': 0.0, 'substeps': 1})
    plant = Plant(parameters, T)
    a, b, c, d = transfer.head_state_space(parameters)
    voltages = np.random.default_rng(2).normal(0.0, 0.01, 500)
    ad, bd, *_ = signal.cont2discrete((a, b, c, d), T)
    state, reference = np.zeros(len(a)), []
    for u in voltages:
        state = ad @ state + bd[:, 0] * u
        reference.append(c[0] @ state)
    found = [plant.step(tick, u)[0] for tick, u in enumerate(voltages.tolist(), start=1)]
    # The mean force of a sample drives the modes; its shape within the sample is an error of second order in T.
    assert np.abs(np.array(found) - reference).max() < 0.02 * np.abs(reference).max()


FREQUENCY_POINTS = np.array([10.0, 90.0, 500.0, 2990.0, 3000.0, 4100.0, 6000.0, 8200.0, 12000.0])


def test_the_transfer_functions_are_the_sum_of_the_modes() -> None:
    parameters = drive()
    numerator, denominator = transfer.head(parameters)
    s = 2j * np.pi * FREQUENCY_POINTS
    np.testing.assert_allclose(np.polyval(numerator, s) / np.polyval(denominator, s), expected(FREQUENCY_POINTS))
    assert len(denominator) == 2 * len(FREQUENCIES) + 1
    np.testing.assert_allclose(transfer.frequency_response(parameters, FREQUENCY_POINTS), expected(FREQUENCY_POINTS))
    a, b, c, d = transfer.head_state_space(parameters)
    assert a.shape == (2 * len(FREQUENCIES), 2 * len(FREQUENCIES))
    responses = [(c @ np.linalg.solve(point * np.eye(len(a)) - a, b) + d)[0, 0] for point in s]
    np.testing.assert_allclose(responses, expected(FREQUENCY_POINTS), rtol=1e-9)


@pytest.mark.parametrize('driver', ['rigid', 'current', 'voltage'])
def test_the_driver_is_a_factor_of_the_transfer_function(driver: str) -> None:
    parameters = drive(**{'actuator.driver': driver, 'actuator.back_emf_constant': 0.0})
    s = 2j * np.pi * FREQUENCY_POINTS
    numerator, denominator = transfer.head(parameters)
    response = transfer.frequency_response(parameters, FREQUENCY_POINTS)
    np.testing.assert_allclose(np.polyval(numerator, s) / np.polyval(denominator, s), response)
    rigid = transfer.driven_actuator(parameters.actuator)
    factor = s * s * np.polyval(rigid[0], s) / np.polyval(rigid[1], s)
    scale = parameters.actuator.arm_length * parameters.actuator.units_per_meter
    np.testing.assert_allclose(response, factor * scale * expected(FREQUENCY_POINTS) / GAIN)


def test_the_drive_linearized_from_its_step_is_the_sampled_response() -> None:
    sampled = sampled_drive(drive(), T, presliding=False)
    assert len(sampled.a) == 2 * len(FREQUENCIES)
    reference = transfer.sampled_frequency_response(drive(), T, FREQUENCY_POINTS)
    np.testing.assert_allclose(sampled.response(FREQUENCY_POINTS)[:, 0], reference, rtol=1e-9)


@pytest.mark.parametrize(
    ('values', 'name', 'message'),
    [
        ({'friction.model': 'lugre'}, 'friction.model', 'none, because resonance.form is modes'),
        ({'travel.lower': -5.0, 'travel.upper': 5.0}, 'travel.lower', 'no crash stop'),
        ({'travel.upper': 5.0}, 'travel.upper', 'no crash stop'),
        ({'actuator.driver': 'current'}, 'actuator.back_emf_constant', '0 .V s/rad., because'),
        ({'resonance.residues': (0.0, 1.0, 1.0, 1.0), 'initial_position': 1.0}, 'initial_position', 'first mode'),
        ({'resonance.residues': (1.0,)}, 'residues', 'a list of 4 numbers'),
        ({'resonance.frequencies': ()}, 'frequencies', 'not empty'),
    ],
)
def test_what_needs_a_rigid_body_is_rejected(values: dict[str, Any], name: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message) as caught:
        drive(**values)
    assert caught.value.name.endswith(name)


def test_a_drive_without_a_rigid_body_has_no_time_optimal_seek() -> None:
    with pytest.raises(ValueError, match='no rigid body'):
        time_optimal_seek(drive(), 10.0)
