"""The lattice against (4.7), evaluated node by node."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.control.rbf import activate, largest_square_sum, lattice, lattice_sum


def test_lattice_is_even_and_ends_on_its_ends():
    np.testing.assert_allclose(lattice(-1.0, 1.0, 5), [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_array_equal(lattice(2.0, 4.0, 1), [3.0])


@given(st.floats(-3.0, 3.0), st.floats(-10.0, 10.0), st.floats(0.1, 5.0), st.integers(1, 9))
def test_products_of_the_axes_are_the_gaussians_of_4_7(x, v, width, n):
    positions, velocities = lattice(-1.0, 1.0, n), lattice(-5.0, 5.0, n)
    weights = np.random.default_rng(n).normal(size=(n, n))
    activations = np.zeros((2, n))
    activate(np.stack([positions, velocities]), 1.0 / width**2, 1.0 / width**2, x, v, activations)
    # (4.7): s_i = exp(-(Z - mu_i)'(Z - mu_i) / eta_i^2)
    expected = 0.0
    for i in range(n):
        for j in range(n):
            square = (x - positions[i]) ** 2 + (v - velocities[j]) ** 2
            expected += weights[i, j] * np.exp(-square / width**2)
    assert lattice_sum(weights, activations) == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_largest_square_sum():
    # Two distant nodes: each contributes 1 at its own center, and the other adds exp(-2 d^2/eta^2).
    assert largest_square_sum(np.array([-1.0, 1.0]), 0.5) == pytest.approx(1.0 + np.exp(-2.0 * 16.0))
    assert largest_square_sum(np.array([0.0]), 0.5) == 1.0
