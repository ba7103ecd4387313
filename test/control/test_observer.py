"""The observer against a time-varying Kalman filter, scipy's discretization, and its own definition."""

from typing import Any

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

from hdd_servo_ros.control.observer import DIGITS, Observer, ObserverParameters, filter_matrices
from hdd_servo_ros.parameters import ParameterError

SAMPLE_TIMES = [1e-4, 37.879e-6]
FREE: dict[str, Any] = {'stiffness': 0.0, 'viscous_coefficient': 0.0}


def drive(parameters, sample_time):
    """Transition of (x, v) over T and its response to a held u, by scipy's matrix exponential."""
    p = parameters
    a = [[0.0, 1.0, 0.0], [-p.gain * p.stiffness, -p.gain * p.viscous_coefficient, p.gain], [0.0, 0.0, 0.0]]
    found = expm(np.array(a) * sample_time)
    return found[:2, :2], found[:2, 2]


@pytest.mark.parametrize('sample_time', SAMPLE_TIMES)
def test_the_steady_state_of_a_kalman_filter(sample_time):
    parameters = ObserverParameters(bandwidth=1500.0)
    a, b = drive(parameters, sample_time)
    # In um and um/s: a white acceleration of density w^4 r, measured with the density r = T.
    density = (2.0 * np.pi * 1500.0) ** 4 * sample_time
    t = sample_time
    process = density * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    shown = np.array([[1.0, 0.0]])
    covariance = np.diag([1e6, 1e12])
    generator = np.random.default_rng(4)
    observer = Observer(parameters, sample_time)
    state = np.zeros(2)
    for k in range(4000):
        u, y = generator.normal(size=2)
        if k == 0:
            state = np.array([y, 0.0])
            observer.step(y, 0.0)
            last = u
            continue
        state = a @ state + b * last
        covariance = a @ covariance @ a.T + process
        gain = covariance @ shown.T / (shown @ covariance @ shown.T + 1.0)
        state = state + gain[:, 0] * (y - state[0])
        covariance = (np.eye(2) - gain @ shown) @ covariance
        found = observer.step(y, last)
        last = u
    np.testing.assert_allclose(found, state, rtol=1e-6, atol=1e-6)


def test_the_poles_of_a_free_body_are_those_of_the_bandwidth():
    sample_time, bandwidth = 1e-6, 1000.0
    found = filter_matrices(ObserverParameters(bandwidth=bandwidth, **FREE), sample_time)
    kept = np.eye(2) - np.outer(found.gains, [1.0, 0.0])
    poles = np.log(np.linalg.eigvals(kept @ found.transition).astype(complex)) / sample_time
    wanted = 2.0 * np.pi * bandwidth * np.exp(np.array([1j, -1j]) * 0.75 * np.pi)
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(wanted), rtol=0.01)


@pytest.mark.parametrize('method', ['kalman', 'difference'])
def test_a_constant_velocity_without_command_is_found_exactly(method):
    observer = Observer(ObserverParameters(method=method, **FREE), 1e-4)
    for k in range(400):
        position, velocity = observer.step(0.3 + 1e-4 * 70.0 * k, 0.0)
    assert velocity == pytest.approx(70.0, rel=1e-9)
    assert position == pytest.approx(0.3 + 1e-4 * 70.0 * 399, rel=1e-9)


def test_the_command_of_the_drive_needs_no_correction():
    """On the drive of the model, the velocity equals that of the drive from the start, for any command."""
    parameters = ObserverParameters(bandwidth=300.0)
    a, b = drive(parameters, 1e-4)
    observer = Observer(parameters, 1e-4)
    state, u = np.zeros(2), 0.0
    for k in range(300):
        state = a @ state + b * u
        _, velocity = observer.step(state[0], u)
        assert velocity == pytest.approx(state[1], abs=1e-6)
        u = np.sin(0.3 * k)


def test_filtered_differences():
    positions = np.random.default_rng(5).normal(size=300)
    observer = Observer(ObserverParameters(method='difference', bandwidth=800.0), 1e-4)
    found = [observer.step(position, 1.0) for position in positions]
    pole = np.exp(-2.0 * np.pi * 800.0 * 1e-4)
    differences = np.diff(positions, prepend=positions[0]) / 1e-4
    np.testing.assert_allclose([velocity for _, velocity in found], signal.lfilter([1 - pole], [1, -pole], differences))
    np.testing.assert_allclose([position for position, _ in found], positions, rtol=1e-9)


@pytest.mark.parametrize('sample_time', SAMPLE_TIMES)
def test_gains_have_twelve_digits(sample_time):
    for gain in filter_matrices(ObserverParameters(), sample_time).gains:
        assert float(f'{gain:.{DIGITS - 1}e}') == gain


def test_other_parameters_keep_position_and_velocity():
    observer = Observer(ObserverParameters(**FREE), 1e-4)
    for k in range(300):
        observer.step(1e-3 * k, 0.0)
    observer.update(ObserverParameters(method='difference', bandwidth=100.0))
    _, velocity = observer.step(0.3, 0.0)
    assert velocity == pytest.approx(10.0)
    assert observer.estimates.tolist() == [0.3, velocity]


def test_an_unknown_method_is_rejected():
    with pytest.raises(ParameterError, match=r"method: 'luenberger'; expected .*kalman, difference"):
        ObserverParameters(method='luenberger')


def test_a_bandwidth_for_which_there_are_no_gains_is_rejected():
    stiff = ObserverParameters(bandwidth=10.0, gain=4e9, stiffness=10.0, viscous_coefficient=0.0)
    with pytest.raises(ParameterError, match=r'observer\.bandwidth: 10\.0; expected a higher value: .* T = 1e-06 s'):
        filter_matrices(stiff, 1e-6)
