"""Initial value compensation against a Lyapunov equation of the closed loop, and by its effect."""

import math

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov

from hdd_servo_ros.analysis.initial_values import RigidDrive, initial_value_gains, initial_value_responses
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.parameters import ParameterError

T = 1e-4
TAU = 4e-4
SLIDING = RigidDrive(4.0968e7, 0.0, 4.6e-6)
PRESLIDING = RigidDrive(4.0968e7, 0.02168, 6.9e-6)
DRIVES = pytest.mark.parametrize('drive', [SLIDING, PRESLIDING])


def make_pid() -> Controller:
    return Pid(PidParameters(), T)


def closed_loop(drive, decay):
    """
    Return the transition of (position, velocity, integral, slope, fading), for the PID controller with target 0.

    b is the integral's initial value, and the slope's is the velocity, which its first sample takes unfiltered.
    """
    gains = PidParameters()
    dynamics = np.array(
        [
            [0.0, 1.0, 0.0],
            [-drive.gain * drive.stiffness, -drive.gain * drive.viscous_coefficient, drive.gain],
            [0.0, 0.0, 0.0],
        ]
    )
    held = expm(dynamics * T)
    smoothing = 1.0 - math.exp(-2.0 * math.pi * gains.derivative_bandwidth * T)
    integral = np.array([-gains.integral_gain * T, 0.0, 1.0, 0.0, 0.0])
    slope = np.array([0.0, smoothing, 0.0, 1.0 - smoothing, 0.0])
    fading = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    u = integral - gains.derivative_gain * slope + fading
    u[0] -= gains.proportional_gain
    body = np.hstack([held[:2, :2], np.zeros((2, 3))]) + np.outer(held[:2, 2], u)
    return np.vstack([body, integral, slope, decay * fading])


# Columns: e_0, v_0, gap, b; m is the gap less b.
INITIAL = np.array(
    [
        [-1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, -1.0],
    ]
)


@DRIVES
def test_gains_equal_those_of_a_lyapunov_equation(drive):
    # States of about the same size: travel over a sample in place of velocities, and what a volt does in a sample.
    sizes = np.array([1.0, 1.0 / T, 1.0 / (drive.gain * T**2), 1.0 / T, 1.0 / (drive.gain * T**2)])
    transition = closed_loop(drive, math.exp(-T / TAU)) * sizes / sizes[:, None]
    initial = INITIAL / sizes[:, None]
    shown = np.diag([1.0, 0.0, 0.0, 0.0, 0.0])
    cost = initial.T @ solve_discrete_lyapunov(transition.T, shown, method='bilinear') @ initial
    wanted = -cost[3, :3] / cost[3, 3]
    found = initial_value_gains(make_pid, drive, TAU, T, horizon=0.3)
    np.testing.assert_allclose([found.error, found.velocity, found.gap], wanted, rtol=1e-6, atol=0)


@DRIVES
def test_responses_equal_the_closed_loop(drive):
    responses = initial_value_responses(make_pid, drive, TAU, T, 80)
    transition = closed_loop(drive, math.exp(-T / TAU))
    # e_0, v_0, b alone, m alone.
    states = np.column_stack([INITIAL[:, :2], np.eye(5)[:, 2], np.eye(5)[:, 4]])
    for tick in range(80):
        np.testing.assert_allclose(responses[:, tick], -states[0], atol=1e-9)
        states = transition @ states


def sum_of_squares(drive, error, velocity, added, fading):
    """Return the sum of squared errors after a switch with these, by the closed loop's matrices."""
    state = np.array([-error, velocity, added, velocity, fading])
    transition = closed_loop(drive, math.exp(-T / TAU))
    total = 0.0
    for _ in range(100):
        total += state[0] ** 2
        state = transition @ state
    return total


@DRIVES
def test_constant_is_the_best(drive):
    gains = initial_value_gains(make_pid, drive, TAU, T)
    error, velocity, gap = 1.5, 4e3, 0.6
    b = gains.constant(error, velocity, gap)
    least = sum_of_squares(drive, error, velocity, b, gap - b)
    for other in (b - 1e-3, b + 1e-3, 0.0, gap):
        assert sum_of_squares(drive, error, velocity, other, gap - other) > least


def test_constant_is_linear():
    gains = initial_value_gains(make_pid, SLIDING, TAU, T)
    assert gains.constant(2.0, 3.0, 5.0) == 2.0 * gains.error + 3.0 * gains.velocity + 5.0 * gains.gap


def test_gains_have_twelve_digits():
    gains = initial_value_gains(make_pid, SLIDING, TAU, T)
    for gain in (gains.error, gains.velocity, gains.gap):
        assert float(f'{gain:.11e}') == gain


def test_computation_delay_makes_every_answer_late():
    late = initial_value_responses(make_pid, SLIDING, TAU, T, 5, DspParameters(computation_delay=1))
    now = initial_value_responses(make_pid, SLIDING, TAU, T, 5)
    # A voltage added at the switch moves the head a sample later; until then the head coasts.
    np.testing.assert_array_equal(late[2:, :2], 0.0)
    assert now[2, 1] != 0.0
    assert late[2, 2] == pytest.approx(now[2, 1], rel=1e-12)
    assert late[0, 1] == 1.0
    assert late[1, 1] == pytest.approx(-T, rel=0.02)


def test_takes_other_controllers():
    """The adaptive controller adapts hardly at all to so small a kick: its gains do not depend on the horizon's end."""
    gains = [
        initial_value_gains(lambda: AdaptiveNn(AdaptiveNnParameters(), T), SLIDING, TAU, T, horizon)
        for horizon in (0.01, 0.02)
    ]
    assert gains[0].error == pytest.approx(gains[1].error, rel=0.1)
    assert gains[0].velocity == pytest.approx(gains[1].velocity, rel=0.1)


@pytest.mark.parametrize(
    ('time_constant', 'horizon', 'name'),
    [(0.0, 0.01, 'time_constant'), (math.inf, 0.01, 'time_constant'), (TAU, T, 'horizon')],
)
def test_rejects_what_has_no_transient(time_constant, horizon, name):
    with pytest.raises(ParameterError, match=f'parameter {name}: '):
        initial_value_gains(make_pid, SLIDING, time_constant, T, horizon)
