"""The transition over a sample against scipy's matrix exponential and a closed form."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import linalg

from hdd_servo_ros.numerics.transition import held_input_transition

ENTRIES = st.floats(-3.0, 3.0)


@given(arrays(np.float64, (4, 4), elements=ENTRIES), arrays(np.float64, (4,), elements=ENTRIES), st.floats(0.01, 3.0))
def test_equals_the_matrix_exponential_of_the_augmented_system(dynamics, inputs, time_step):
    transition, response = held_input_transition(dynamics.tolist(), inputs.tolist(), time_step)
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[:4, 4] = dynamics, inputs
    exact = linalg.expm(augmented * time_step)
    scale = np.abs(exact).max()
    np.testing.assert_allclose(transition, exact[:4, :4], atol=1e-11 * scale)
    np.testing.assert_allclose(response, exact[:4, 4], atol=1e-11 * scale)


def test_an_integrator_and_a_decay():
    transition, response = held_input_transition([[0.0, 1.0], [0.0, -2.0]], [0.0, 1.0], 0.7)
    decay = math.exp(-1.4)
    np.testing.assert_allclose(transition, [[1.0, (1.0 - decay) / 2.0], [0.0, decay]], rtol=1e-14)
    np.testing.assert_allclose(response, [0.7 / 2.0 - (1.0 - decay) / 4.0, (1.0 - decay) / 2.0], rtol=1e-14)


def test_samples_in_turn_equal_one_of_their_sum():
    dynamics = [[0.0, 600.0], [-600.0, -24.0]]
    half, _ = held_input_transition(dynamics, [0.0, 600.0], 1e-3)
    whole, _ = held_input_transition(dynamics, [0.0, 600.0], 2e-3)
    np.testing.assert_allclose(np.array(half) @ np.array(half), whole, atol=1e-14)
