"""Feedforward of the reference: bristles against an integrator, and conditions of adaptation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.control.desired_compensation import bristle_after
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 1e-4
SCALES = SensorScales(8.0, 5000.0)
BRISTLES = ('spring_hat', 'hysteresis_hat', 'relaxation_hat')


def controller_of(**values):
    return AdaptiveNn(from_mapping(AdaptiveNnParameters, values), T)


def estimate(controller, name):
    return float(controller.estimates[controller.estimate_names.index(name)])


def follow(controller, reference, first_tick=0, error=0.01):
    """Step along rows of x_d, x_d', x_d'' with a constant error [um]; return the commands."""
    return [
        controller.step(SCALES.inputs(first_tick + k, (x_d + error) / 8.0, dx_d / 5000.0, x_d, dx_d, ddx_d))
        for k, (x_d, dx_d, ddx_d) in enumerate(reference)
    ]


def sine(count, frequency=100.0, amplitude=2.0):
    w, t = 2.0 * math.pi * frequency, T * np.arange(count)
    return np.stack([np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)], axis=1) * amplitude


@pytest.mark.parametrize('change', [-3.0, 0.2, 11.0])
@pytest.mark.parametrize('deflection', [-5.0, 0.0, 4.0])
def test_a_bristle_follows_its_equation(deflection, change):
    """z' = x' - |x'| z/d, which is (2.21) of LuGre with g = sigma_0 d, over a second of constant velocity."""
    d = 6.0
    solved = solve_ivp(lambda _, z: change - abs(change) * z / d, (0.0, 1.0), [deflection], rtol=1e-10, atol=1e-12)
    assert bristle_after(deflection, change, d) == pytest.approx(solved.y[0, -1], abs=1e-8)


@given(
    distance=st.floats(0.01, 100.0),
    moves=st.lists(st.floats(-1e4, 1e4), max_size=30),
)
def test_a_bristle_never_exceeds_its_distance(distance, moves):
    z = 0.0
    for change in moves:
        z = bristle_after(z, change, distance)
        assert abs(z) <= distance


def test_estimates_rest_with_the_reference():
    controller = controller_of()
    follow(controller, sine(100))
    first = [estimate(controller, name) for name in (*BRISTLES, 'sigma_hat', 'm_hat')]
    follow(controller, [(1.0, 0.0, 0.0)] * 200, 100)
    rested = [estimate(controller, name) for name in (*BRISTLES, 'sigma_hat', 'm_hat')]
    # One more sample is used: the last one in motion, whose effect these estimates are the first to show.
    follow(controller, [(1.0, 0.0, 0.0)], 300)
    assert [estimate(controller, name) for name in (*BRISTLES, 'sigma_hat', 'm_hat')] == rested
    assert rested != first


def test_a_step_of_the_reference_leaves_the_bristles_alone():
    controller = controller_of(**{'shaping.share': 0.0})
    follow(controller, [(0.0, 0.0, 0.0)] * 5)
    follow(controller, [(5.0, 0.0, 0.0)] * 5, 5)
    assert estimate(controller, 'bristles') == 0.0
    follow(controller, np.array([5.0, 0.0, 0.0]) + sine(25), 10)
    assert estimate(controller, 'bristles') > 0.01


def test_the_feedback_is_the_same_whatever_was_learnt():
    """The derivative of u by the measurement contains no estimate: the estimates are outside the feedback loop."""
    slopes = []
    for initial in (1.4e-8, 3.5e-8):
        low, high = (
            follow(
                controller_of(**{'mass.initial': initial, 'bristle.spring.initial': 1e6 * initial}), sine(1), error=e
            )
            for e in (0.01, 0.02)
        )
        slopes.append(high[0][1] - low[0][1])
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-9)
    assert slopes[0] == pytest.approx(-0.01 * 9.59e-5 * (2450.0 + 4.6e5 * T), rel=1e-6)


def test_learning_saturates_with_the_excitation():
    """With a hundred times the amplitude and the same error, m_hat changes by a hundredth."""
    changes = []
    for factor in (1.0, 100.0):
        controller = controller_of(**{'r_limit': 0.0, 'mass.scale': 1.0, 'mass.leakage': 0.0, 'projection': False})
        before = controller.parameters.mass.initial
        follow(controller, factor * sine(20), error=1e-3)
        changes.append(estimate(controller, 'm_hat') - before)
    assert changes[1] == pytest.approx(changes[0] / 100.0, rel=0.1)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'desired.enabled': False}, r'bristle\.enabled.*false, as desired\.enabled is false'),
        ({'bristle.distance': 40.0}, r'spring_distance.*above distance = 40'),
        ({'bristle.spring.minimum': 0.06}, r'bristle\.spring.*minimum.*at most maximum'),
        ({'bristle.spring.initial': 0.06}, r'bristle\.spring\.initial.*with projection'),
    ],
)
def test_what_is_rejected(values, message):
    with pytest.raises(ParameterError, match=message):
        from_mapping(AdaptiveNnParameters, values)


def test_the_lag_is_fixed_for_a_run():
    controller = controller_of()
    with pytest.raises(ParameterError, match=r'desired\.lag.*expected 0\.0003, which is fixed'):
        controller.update(from_mapping(AdaptiveNnParameters, {'desired.lag': 1e-3}))


def test_a_reset_returns_to_the_initial_estimates():
    controller = controller_of()
    follow(controller, sine(400), error=0.2)
    controller.update(from_mapping(AdaptiveNnParameters, {'reset_count': 1}))
    follow(controller, sine(1), 400)
    found = [estimate(controller, name) for name in (*BRISTLES, 'sigma_hat', 'm_hat')]
    assert found == [0.0217, 0.0217, 2.3e-6, 6.9e-6, 2.44e-8]


def test_the_bare_law_has_none_of_it():
    controller = controller_of(**BARE_LAW)
    commands = follow(controller, sine(50))
    assert estimate(controller, 'bristles') == 0.0
    assert [estimate(controller, name) for name in BRISTLES] == [0.0217, 0.0217, 2.3e-6]
    assert commands[0][1] != follow(controller_of(), sine(1))[0][1]
