"""The least error of feedback against closed forms, LQG, another solver, published bounds and real controllers."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

from hdd_servo_ros.analysis.feedback_responses import FeedbackResponses, MeasuredDrive
from hdd_servo_ros.analysis.least_error import DisturbanceSpectra, least_error, white_density
from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.analysis.sampled_sensor import SampledSensor
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.drive.plant import PlantParameters

T = 1e-4
NYQUIST = 5000.0
LINES = np.linspace(0.0, NYQUIST, 20_001)
NONE = np.zeros_like(LINES)
NOISE = (white_density(3e-3, T), white_density(3.0, T))
VIBRATION = np.where((LINES >= 10.0) & (LINES <= 500.0), (50_800.0 * 12.5 / 4.0968e7) ** 2 / 490.0, 0.0)
"""12.5 rad/s^2 rms, 10 to 500 Hz, as force [V^2/Hz]."""


def delay_line():
    """Return x_{k+1} = u_k: as S = 1 - z^-1 Q, it can be any stable S that is 1 at infinity."""
    one = np.ones((1, 1))
    return MeasuredDrive(0.0 * one, one, np.ones(1), one, T)


def two_levels(share, ratio):
    """Return the density of a track that moves with 1 um^2 per line below a share of Nyquist, and ``ratio`` above."""
    return np.where(share * NYQUIST > LINES, 1.0, ratio) / NYQUIST


def test_without_a_limit_it_is_the_geometric_mean_of_the_spectrum():
    """Kolmogorov's formula for the error of the best prediction."""
    pole = 0.9
    density = 2.0 * T * 0.01 / np.abs(1.0 - pole * np.exp(-2j * np.pi * LINES * T)) ** 2
    found = least_error(delay_line(), DisturbanceSpectra(LINES, NONE, density, (0.0,)), 100.0, 64)
    assert found.three_sigma == pytest.approx(3.0 * 0.1, rel=3e-3)
    assert found.floor <= found.three_sigma


@pytest.mark.parametrize(('share', 'limit'), [(0.5, 2.0), (0.5, 1.5), (0.3, 1.2)])
def test_with_a_limit_it_is_what_bodes_integral_allows(share, limit):
    """|S| = Ms where little disturbs, and so ln|S| = -(1 - share)/share ln Ms where much does."""
    low = limit ** (-(1.0 - share) / share)
    ratio = 1e-3
    expected = np.sqrt(share * low**2 + (1.0 - share) * ratio * limit**2)
    found = least_error(delay_line(), DisturbanceSpectra(LINES, NONE, two_levels(share, ratio), (0.0,)), limit, 256)
    assert found.three_sigma == pytest.approx(3.0 * expected, rel=0.02)
    # The edge of the spectrum has no width, and that of 256 taps has one.
    assert found.three_sigma > 3.0 * expected
    assert found.peak_sensitivity < 1.01 * limit


def lqg_error(a, b, c, force, noise):
    """Return sigma of x under LQG control of white force and noise, u from the measurement of the same tick."""
    cost = solve_discrete_are(a, b, c.T @ c, np.array([[1e-10]]))
    gain = np.linalg.solve(b.T @ cost @ b + 1e-10, b.T @ cost @ a)
    disturbed = force**2 * b @ b.T
    spread = solve_discrete_are(a.T, c.T, disturbed, np.array([[noise**2]]))
    filtered = spread - spread @ c.T @ c @ spread / (c @ spread @ c.T + noise**2)
    return float(np.sqrt(np.trace(cost @ disturbed) + np.trace(a.T @ cost @ b @ gain @ filtered)))


@pytest.mark.parametrize('noise', [0.05, 1.0, 10.0])
def test_without_a_limit_it_is_that_of_lqg(noise):
    a, b, c = np.array([[0.95, 0.1], [0.0, 0.8]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    drive = MeasuredDrive(a, b, c[0], c, T)
    spectra = DisturbanceSpectra(LINES, NONE + white_density(2.0, T), NONE, (white_density(noise, T),))
    found = least_error(drive, spectra, 1e3)
    assert found.three_sigma == pytest.approx(3.0 * lqg_error(a, b, c, 2.0, noise), rel=3e-3)


def test_another_solver_finds_the_same():
    """With Q around a stable drive, without observer, S = 1 - P Q, by sequential least squares."""
    a, b, row = np.array([[0.9, 0.1], [0.0, 0.7]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    count, taps, limit = 128, 24, 1.4
    z = np.exp(1j * np.pi * (np.arange(count) + 0.5) / count)
    p = 0.1 / ((z - 0.9) * (z - 0.7))
    filters = -p[:, None] * z[:, None] ** -np.arange(taps)

    def variance(q):
        s = 1.0 + filters @ q
        slope = 4.0 * np.abs(p) ** 2 * s + 0.25 * (s - 1.0)
        value = np.mean(4.0 * np.abs(p * s) ** 2 + 0.25 * np.abs(s - 1.0) ** 2)
        return value, 2.0 * (filters.conj().T @ slope).real / count

    constraint = {
        'type': 'ineq',
        'fun': lambda q: limit**2 - np.abs(1.0 + filters @ q) ** 2,
        'jac': lambda q: -2.0 * ((1.0 + filters @ q).conj()[:, None] * filters).real,
    }
    options = {'maxiter': 300, 'ftol': 1e-10}
    other = minimize(variance, np.zeros(taps), jac=True, method='SLSQP', constraints=constraint, options=options)
    assert other.success
    spectra = DisturbanceSpectra(LINES, NONE + white_density(2.0, T), NONE, (white_density(0.5, T),))
    drive = MeasuredDrive(a, b, row[0], row, T)
    found = least_error(drive, spectra, limit, 48)
    assert found.three_sigma == pytest.approx(3.0 * np.sqrt(other.fun), rel=5e-3)
    assert found.peak_sensitivity == pytest.approx(limit, rel=0.01)
    # The limit costs something.
    assert found.three_sigma > 1.02 * least_error(drive, spectra, 10.0, 48).three_sigma


@pytest.mark.parametrize(('delay', 'expected'), [(0, 18.0), (1, 122.0)])
def test_rotational_vibration_has_the_bounds_computed_elsewhere(delay, expected):
    drive = MeasuredDrive.of(sampled_drive(PlantParameters(), T, presliding=True), delay)
    found = least_error(drive, DisturbanceSpectra(LINES, VIBRATION, NONE, (0.0,)))
    assert 1e3 * found.three_sigma == pytest.approx(expected, rel=0.1)


def test_a_velocity_output_helps():
    bare = sampled_drive(PlantParameters(), T, presliding=True)
    errors = []
    for has_velocity in (False, True):
        drive = MeasuredDrive.of(bare, has_velocity=has_velocity)
        errors.append(
            least_error(drive, DisturbanceSpectra(LINES, VIBRATION, NONE, NOISE[: 1 + has_velocity]), taps=64)
        )
    assert errors[1].three_sigma < 0.3 * errors[0].three_sigma


def error_of(margins, controller, index):
    """Return 3 sigma of a linear controller with both outputs of the vibrometer under vibration [um]."""
    f = (np.arange(4096) + 0.5) / 4096 * NYQUIST
    law, drive = controller.response(f, T), margins.drives[index].response(f)
    s = 1.0 / (1.0 + margins.loop_gain(controller, index, f))
    power = np.interp(f, LINES, VIBRATION) * np.abs(s * drive[:, 0]) ** 2
    for signal, density in enumerate(NOISE):
        power += density * np.abs(s * drive[:, 0] * law[:, signal]) ** 2
    return 3.0 * float(np.sqrt(power.sum() * NYQUIST / 4096))


@pytest.fixture(scope='module')
def loop():
    return LoopMargins(PlantParameters(), T)


@pytest.fixture(scope='module')
def least(loop):
    spectra = DisturbanceSpectra(LINES, VIBRATION, NONE, NOISE)
    return [least_error(MeasuredDrive.of(drive, has_velocity=True), spectra, taps=96) for drive in loop.drives]


@given(st.floats(0.02, 0.7), st.floats(3e-5, 1.5e-4), st.floats(0.0, 80.0), st.sampled_from([0.0, 3160.0]))
@settings(max_examples=30)
def test_no_pid_is_better(loop, least, k_p, k_d, k_i, bandwidth):
    controller = LinearController(k_p, k_d, k_i, bandwidth)
    assume(loop.peak_sensitivity(controller) <= 2.0)
    for index, bound in enumerate(least):
        assert error_of(loop, controller, index) > bound.floor


@pytest.mark.parametrize('delay', [0, 2])
@pytest.mark.parametrize('sensor', [None, LdvParameters(demodulator_delay=2e-5, demodulator_bandwidth=3e4)])
def test_the_responses_with_q_0_are_those_of_the_observer_in_the_loop(delay, sensor):
    """Against the closed loop of drive, observer and state feedback, built as one state space."""
    found = None if sensor is None else SampledSensor(sensor, T)
    drive = MeasuredDrive.of(sampled_drive(PlantParameters(), T, presliding=True), delay, found, has_velocity=True)
    f = np.array([20.0, 300.0, 2100.0, 4500.0])
    responses = FeedbackResponses(drive, f)
    k, observer = responses._feedback, responses._observer
    n = len(drive.a)
    loop = np.block(
        [[drive.a, drive.b @ k], [observer @ drive.measured, drive.a + drive.b @ k - observer @ drive.measured]]
    )
    assert np.abs(np.linalg.eigvals(loop)).max() < 1.0
    z = np.exp(2j * np.pi * f * T)
    into = np.concatenate([drive.b, 0.0 * drive.b])
    states = np.array([np.linalg.solve(value * np.eye(2 * n) - loop, into)[:, 0] for value in z])
    np.testing.assert_allclose(responses.error_of_force.at_zero, -states[:, :n] @ drive.position, rtol=1e-6)
    np.testing.assert_allclose(responses.sensitivity.at_zero, 1.0 + states[:, n:] @ k[0], rtol=1e-6)
    into = np.concatenate([0.0 * drive.b, observer[:, [1]]])
    states = np.array([np.linalg.solve(value * np.eye(2 * n) - loop, into)[:, 0] for value in z])
    np.testing.assert_allclose(responses.error_of_noise[1].at_zero, states[:, :n] @ drive.position, rtol=1e-6)


def test_what_feedback_cannot_measure_stays():
    """The vibrometer measures the head from the base: the movement of the track is not seen."""
    track = NONE + white_density(0.005, T)
    bare = sampled_drive(PlantParameters(), T, presliding=True)
    drive = MeasuredDrive.of(bare, is_relative=False)
    found = least_error(drive, DisturbanceSpectra(LINES, NONE, track, (1e-15,)), taps=32)
    assert found.three_sigma == pytest.approx(0.015, rel=1e-3)


@pytest.mark.parametrize(
    ('limit', 'noise', 'track', 'message'),
    [
        (1.0, (0.0,), 1.0, 'above 1'),
        (2.0, (0.0, 0.0), 1.0, '2 densities of noise for 1 measured'),
        (2.0, (0.0,), 0.0, 'all disturbance spectra are 0'),
    ],
)
def test_what_makes_no_problem_is_rejected(limit, noise, track, message):
    with pytest.raises(ValueError, match=message):
        least_error(delay_line(), DisturbanceSpectra(LINES, NONE, NONE + track, noise), limit, 16)


def test_a_drive_that_no_such_feedback_stabilises_is_rejected():
    """A pole at 3 needs a mean of ln|S| of ln 3 > ln 2."""
    one = np.ones((1, 1))
    drive = MeasuredDrive(3.0 * one, one, np.ones(1), one, T)
    with pytest.raises(ValueError, match='no feedback found with a peak sensitivity of at most 2'):
        least_error(drive, DisturbanceSpectra(LINES, NONE, NONE + 1.0, (0.0,)), 2.0, 32)
