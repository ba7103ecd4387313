"""Friction of a known motion, against an integration of the LuGre equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hdd_servo_ros.control.lugre_feedforward import BRISTLE, mean_friction
from hdd_servo_ros.numerics.records import record, zeros

T = 1e-4
STIFFNESS, DAMPING, COULOMB, STATIC, STRIBECK = 0.02168, 2.3e-6, 0.13, 0.16, 300.0


@pytest.fixture
def bristle():
    constants = record(zeros(BRISTLE), BRISTLE)
    constants.stiffness, constants.bristle_damping = STIFFNESS, DAMPING
    constants.coulomb_level, constants.static_level = COULOMB, STATIC
    constants.inverse_stribeck_velocity = 1.0 / STRIBECK
    return constants


@pytest.mark.parametrize(('amplitude', 'frequency'), [(0.5, 20.0), (5.0, 50.0), (50.0, 100.0)])
def test_it_follows_the_bristles_of_a_sine(bristle, amplitude, frequency):
    w = 2.0 * np.pi * frequency

    def velocity(t):
        return amplitude * w * np.cos(w * t)

    def rate(t, z):
        v = velocity(t)
        level = COULOMB + (STATIC - COULOMB) * np.exp(-((v / STRIBECK) ** 2))
        return v - STIFFNESS * abs(v) / level * z

    ticks = np.arange(int(1.5 / frequency / T))
    solution = solve_ivp(rate, (0.0, ticks[-1] * T), [0.0], t_eval=ticks * T, rtol=1e-9, atol=1e-12, max_step=T)
    deflection, found = 0.0, [0.0]
    for tick in ticks[:-1]:
        start = tick * T
        rise = amplitude * (np.sin(w * (start + T)) - np.sin(w * start))
        _, deflection = mean_friction(bristle, deflection, T, rise, velocity(start), velocity(start + T))
        found.append(deflection)
    largest = np.abs(solution.y[0]).max()
    assert np.abs(found - solution.y[0]).max() < 0.01 * largest


def test_at_rest_the_friction_is_the_spring(bristle):
    assert mean_friction(bristle, 2.0, T, 0.0, 0.0, 0.0) == (STIFFNESS * 2.0, 2.0)


def test_in_fast_sliding_it_is_the_coulomb_level(bristle):
    mean, deflection = mean_friction(bristle, 0.0, T, 100.0, 1e6, 1e6)
    for _ in range(3):
        mean, deflection = mean_friction(bristle, deflection, T, -100.0, -1e6, -1e6)
    assert mean == pytest.approx(-COULOMB, rel=1e-6)
    assert deflection == pytest.approx(-COULOMB / STIFFNESS, rel=1e-6)
