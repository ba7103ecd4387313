"""The drive without friction: its sampled response, measured on the block, against scipy's continuous one."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal
from scipy.linalg import expm

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters, modal_form, sections_of

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Run = Callable[..., Array]

NONE = FrictionParameters(model='none')
DEFAULT = PlantParameters(friction=NONE)


def measured_response(run: Run, parameters: PlantParameters, sample_time: float, frequencies: Array) -> Complex:
    """
    Measure head position over control on the block, exactly up to rounding.

    The control [1, -2, 1] leaves the rigid body at rest, so that once the modes have decayed the record is complete and
    its transform over the control's is the sampled response.
    """
    slowest = min(mode.a1 for mode in modal_form(parameters.resonance).modes)
    decay = 50.0 / slowest
    control = np.zeros(math.ceil(decay / sample_time))
    control[:3] = [1.0, -2.0, 1.0]
    head = run(parameters, sample_time, control)[:, 0]
    assert abs(head[-1]) < 1e-8 * np.abs(head).max()
    phase = -2j * np.pi * np.outer(frequencies, np.arange(head.size)) * sample_time
    return (np.exp(phase) @ head) / (np.exp(phase[:, :3]) @ control[:3])


def cascade_response(parameters: PlantParameters, sample_time: float, frequencies: Array) -> Complex:
    """Return the sampled response from a cascade of the sections' own state spaces and a matrix exponential."""
    a = np.array([[0.0, 1.0], [0.0, 0.0]])
    b = np.array([[0.0], [parameters.gain]])
    c = np.array([[1.0, 0.0]])
    for values in sections_of(parameters.resonance):
        w = math.sqrt(values.a0)
        a2 = np.array([[0.0, w], [-w, -values.a1]])
        c2 = np.array([[(values.b0 - values.b2 * values.a0) / w, values.b1 - values.b2 * values.a1]])
        a = np.block([[a, np.zeros((a.shape[0], 2))], [np.array([[0.0], [1.0]]) @ c, a2]])
        b = np.vstack([b, np.zeros((2, 1))])
        c = np.hstack([values.b2 * c, c2])
    n = a.shape[0]
    transition = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * sample_time)
    z = np.exp(2j * np.pi * frequencies * sample_time)
    return np.array(
        [(c @ np.linalg.solve(point * np.eye(n) - transition[:n, :n], transition[:n, n:]))[0, 0] for point in z]
    )


@pytest.mark.parametrize('sample_time', [1.0e-4, 2.0e-5])
@pytest.mark.parametrize('substeps', [1, 4])
def test_sampled_response_is_exact(run: Run, sample_time: float, substeps: int) -> None:
    """At any substeps: the resonances are integrated exactly."""
    frequencies = np.geomspace(50.0, 0.49 / sample_time, 60)
    measured = measured_response(run, replace(DEFAULT, substeps=substeps), sample_time, frequencies)
    np.testing.assert_allclose(measured, cascade_response(DEFAULT, sample_time, frequencies), rtol=1e-7)
    np.testing.assert_allclose(
        measured, transfer.sampled_frequency_response(DEFAULT, sample_time, frequencies), rtol=1e-7
    )


def hold(frequencies: Array, sample_time: float) -> Complex:
    """Return the response of the control's hold."""
    return np.sinc(frequencies * sample_time) * np.exp(-1j * np.pi * frequencies * sample_time)


def decibel_and_degrees(ratio: Complex) -> tuple[float, float]:
    return float(np.abs(20.0 * np.log10(np.abs(ratio))).max()), float(np.abs(np.degrees(np.angle(ratio))).max())


# Aliasing is not an error of the step: at T = 0.1 ms the modes alias to 1.4 kHz and above, at 10 µs not below 20 kHz.
@pytest.mark.parametrize(('sample_time', 'limit'), [(1.0e-4, 1.35e3), (2.0e-5, 1.85e4), (1.0e-5, 2.0e4)])
def test_response_is_the_continuous_one_with_the_hold(run: Run, sample_time: float, limit: float) -> None:
    """Within 0.1 dB and 1 degree from 10 Hz up to aliasing; at T = 10 µs through all four modes up to 20 kHz."""
    peaks = [math.sqrt(section.a0) / (2.0 * math.pi) for section in sections_of(DEFAULT.resonance)]
    frequencies = np.array(sorted([*np.geomspace(10.0, limit, 80), *(f for f in peaks if f < limit)]))
    # Rounding of the record weighs most at low frequency, where the response is 1e7 times its value at 20 kHz.
    _, response = signal.freqresp(transfer.system(transfer.head(DEFAULT)), 2.0 * np.pi * frequencies)
    sampled = transfer.sampled_frequency_response(DEFAULT, sample_time, frequencies)
    high = frequencies > 50.0
    measured = measured_response(run, DEFAULT, sample_time, frequencies[high])
    for discrete, chosen in ((sampled, np.full(frequencies.size, True)), (measured, high)):
        ratio = discrete / (response * hold(frequencies, sample_time))[chosen]
        decibel, degrees = decibel_and_degrees(ratio)
        assert decibel < 0.1
        assert degrees < 1.0


@pytest.mark.parametrize('frequency', [10.0, 30.0])
def test_response_at_low_frequency(run: Run, frequency: float) -> None:
    """By a sine that starts where its steady state passes, so that the rigid body does not drift."""
    time = 1.0e-4
    w = 2.0 * math.pi * frequency
    count = round(2.0 / (frequency * time))
    control = np.sin(w * time * (np.arange(count) + 0.5))
    start = replace(DEFAULT, initial_velocity=-DEFAULT.gain / w * (w * time / 2.0) / math.sin(w * time / 2.0))
    head = run(start, time, control)[:-1, 0]
    phase = np.exp(-1j * w * time * np.arange(count))
    response = (phase @ (head - head.mean())) / (phase @ control)
    continuous = transfer.frequency_response(DEFAULT, [frequency])[0]
    decibel, degrees = decibel_and_degrees(np.array([response / continuous / hold(np.array([frequency]), time)[0]]))
    assert decibel < 0.1
    assert degrees < 1.0


def test_velocity_is_the_derivative_of_the_position(run: Run) -> None:
    rows = run(DEFAULT, 1.0e-6, np.sin(2.0 * np.pi * 5500.0 * 1.0e-6 * np.arange(4000)))
    derivative = (rows[2:, 0] - rows[:-2, 0]) / 2.0e-6
    np.testing.assert_allclose(rows[1:-1, 1], derivative, atol=1e-3 * np.abs(derivative).max())


SIXTEEN = ResonanceParameters(
    form='parallel',
    frequencies=tuple(np.linspace(900.0, 20_000.0, 16).tolist()),
    damping_ratios=tuple(np.linspace(0.01, 0.03, 16).tolist()),
    residues=tuple((-1.0) ** i * (0.02 + 0.05 * i) for i in range(16)),
)


@pytest.mark.parametrize('sample_time', [1.0e-4, 2.0e-5])
def test_sixteen_parallel_modes(run: Run, sample_time: float) -> None:
    parameters = PlantParameters(friction=NONE, resonance=SIXTEEN)
    frequencies = np.geomspace(100.0, 0.49 / sample_time, 80)
    measured = measured_response(run, parameters, sample_time, frequencies)
    np.testing.assert_allclose(
        measured, transfer.sampled_frequency_response(parameters, sample_time, frequencies), rtol=1e-6
    )


@pytest.mark.parametrize('driver', ['current', 'voltage'])
def test_driver_dynamics_against_the_matrix_exponential(run: Run, driver: str) -> None:
    """Second order in the substep; 1e-3 at the default four."""
    actuator = ActuatorParameters(driver=driver, amplifier_gain=0.05 if driver == 'current' else 1.0)
    errors = []
    control = np.random.default_rng(1).normal(size=300)
    for substeps in (4, 8, 16):
        parameters = PlantParameters(friction=NONE, actuator=actuator, substeps=substeps)
        a, b, c, d = transfer.head_state_space(parameters)
        discrete = signal.cont2discrete((a, b, c, d), 1.0e-4)
        state = np.zeros((a.shape[0], 1))
        reference = [c @ state]
        for u in control:
            state = discrete[0] @ state + discrete[1] * u
            reference.append(c @ state)
        expected = np.hstack(reference).T
        rows = run(parameters, 1.0e-4, control)
        errors.append(np.abs(rows[:, :2] - expected).max(axis=0) / np.abs(expected).max(axis=0))
    assert np.all(errors[0] < 1e-2)
    assert np.all(np.array(errors[0]) > 3.0 * np.array(errors[1]))
    assert np.all(np.array(errors[1]) > 3.0 * np.array(errors[2]))


def test_control_limit(run: Run) -> None:
    limited = replace(DEFAULT, control_limit=0.5)
    np.testing.assert_array_equal(run(limited, 1e-4, [3.0, -3.0, 0.2]), run(DEFAULT, 1e-4, [0.5, -0.5, 0.2]))
