"""
The open loop of section 5.4 against Radau IIA: m = 1, u = 5 sin t held over T = 1e-4 s, 10 s.

The reference is the three-stage Radau IIA method (Hairer and Wanner, Solving Ordinary Differential Equations II, table
IV.5.6) with a full Newton iteration, four steps per tick; scipy's Radau, which would take minutes to restart at each of
the 1e5 jumps of the input, checks it over the times where the friction changes most.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.compiled import jit

Array = npt.NDArray[np.float64]

T = 1.0e-4
SIGMA_0, SIGMA_1, SIGMA_2, F_C, F_S, V_S = 1.0e5, math.sqrt(1.0e5), 0.4, 1.0, 1.5, 0.001
SQRT_6 = math.sqrt(6.0)
RADAU = np.array(
    [
        [(88 - 7 * SQRT_6) / 360, (296 - 169 * SQRT_6) / 1800, (-2 + 3 * SQRT_6) / 225],
        [(296 + 169 * SQRT_6) / 1800, (88 + 7 * SQRT_6) / 360, (-2 - 3 * SQRT_6) / 225],
        [(16 - SQRT_6) / 36, (16 + SQRT_6) / 36, 1 / 9],
    ]
)
PLANT = PlantParameters(
    gain=1.0,
    friction=FrictionParameters(
        stiffness=SIGMA_0,
        bristle_damping=SIGMA_1,
        viscous_coefficient=SIGMA_2,
        coulomb_level=F_C,
        static_level=F_S,
        stribeck_velocity=V_S,
    ),
    resonance=ResonanceParameters(form='none'),
)


@jit
def rates(x: float, v: float, z: float, u: float) -> tuple[float, float, float]:
    """(4.1)-(4.4) as printed."""
    g = F_C + (F_S - F_C) * math.exp(-((v / V_S) ** 2))
    z_rate = v - SIGMA_0 * abs(v) / g * z
    return v, u - (SIGMA_0 * z + SIGMA_1 * z_rate + SIGMA_2 * v), z_rate


@jit
def fill_jacobian(v: float, z: float, jacobian: Array) -> None:
    falling = math.exp(-((v / V_S) ** 2))
    g = F_C + (F_S - F_C) * falling
    g_slope = -(F_S - F_C) * falling * 2.0 * v / V_S**2
    sign = 1.0 if v >= 0.0 else -1.0
    z_v = 1.0 - SIGMA_0 * z * (sign / g - abs(v) / g**2 * g_slope)
    z_z = -SIGMA_0 * abs(v) / g
    jacobian[0, 1] = 1.0
    jacobian[1, 1], jacobian[1, 2] = -SIGMA_1 * z_v - SIGMA_2, -SIGMA_0 - SIGMA_1 * z_z
    jacobian[2, 1], jacobian[2, 2] = z_v, z_z


@jit
def solve(matrix: Array, right: Array) -> None:
    """Solve in place by Gauss's elimination with pivots; LAPACK's takes longer to compile than this test to run."""
    n = right.size
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(k, n):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            if factor != 0.0:
                for j in range(k, n):
                    matrix[i, j] -= factor * matrix[k, j]
                right[i] -= factor * right[k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@jit
def radau_iia(control: Array, steps: int, tableau: Array, result: Array) -> None:
    """Fill the rows of ``result`` with x, v, z after each tick."""
    y, stages, slopes = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    jacobian, matrix, residual = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros(9)
    h = T / steps
    for tick in range(control.size):
        for _ in range(steps):
            for i in range(9):
                stages[i // 3, i % 3] = y[i % 3]
            for _ in range(30):
                for j in range(3):
                    slopes[j, 0], slopes[j, 1], slopes[j, 2] = rates(
                        stages[j, 0], stages[j, 1], stages[j, 2], control[tick]
                    )
                    fill_jacobian(stages[j, 1], stages[j, 2], jacobian)
                    for i in range(9):
                        for k in range(3):
                            matrix[i, 3 * j + k] = -h * tableau[i // 3, j] * jacobian[i % 3, k]
                        matrix[i, i] += i // 3 == j
                for i in range(9):
                    residual[i] = stages[i // 3, i % 3] - y[i % 3]
                    for j in range(3):
                        residual[i] -= h * tableau[i // 3, j] * slopes[j, i % 3]
                solve(matrix, residual)
                for i in range(9):
                    stages[i // 3, i % 3] -= residual[i]
                if abs(residual[7]) < 1.0e-14 and abs(residual[8]) < 1.0e-18:
                    break
            for i in range(3):
                y[i] = stages[2, i]
        for i in range(3):
            result[tick + 1, i] = y[i]


@pytest.fixture(scope='module')
def control() -> Array:
    return 5.0 * np.sin(T * np.arange(100_000))


@pytest.fixture(scope='module')
def reference(control: Array) -> Array:
    result = np.zeros((control.size + 1, 3))
    radau_iia(control, 4, RADAU, result)
    return result


# From rest through breakaway (0.3 s), the first reversal (2 pi s) and fast sliding.
@pytest.mark.parametrize('tick', [0, 3000, 62_800, 35_000])
def test_reference_is_scipys_radau(reference: Array, control: Array, tick: int) -> None:
    y = reference[tick]
    for k in range(tick, tick + 60):
        y = solve_ivp(
            lambda _, y, u: rates(*y, u), (0.0, T), y, method='Radau', args=(control[k],), rtol=1e-10, atol=1e-15
        ).y[:, -1]
    peaks = np.abs(reference).max(axis=0)
    np.testing.assert_array_less(np.abs(y - reference[tick + 60]) / peaks, [1e-9, 1e-8, 1e-5])


def test_rate_of_the_bristle_is_as_stiff_as_said(reference: Array) -> None:
    assert SIGMA_0 * np.abs(reference[:, 1]).max() / F_C == pytest.approx(4.5e5, rel=0.02)


def test_default_substeps(run: Callable[..., Array], reference: Array, control: Array) -> None:
    rows = run(PLANT, T, control)
    errors = np.abs(rows[:, [0, 1, 7]] - reference).max(axis=0) / np.abs(reference).max(axis=0)
    # The requirement is 1e-5, 1e-5, 1e-3; measured 6e-8, 4e-8, 3e-5.
    np.testing.assert_array_less(errors, [2e-7, 2e-7, 1e-4])


def test_second_order(run: Callable[..., Array], reference: Array, control: Array) -> None:
    errors = []
    for substeps in (1, 2, 4, 8):
        rows = run(PlantParameters(**{**PLANT.__dict__, 'substeps': substeps}), T, control)
        errors.append(np.abs(rows[:, [0, 1, 7]] - reference).max(axis=0) / np.abs(reference).max(axis=0))
    slopes = np.polyfit(np.log([1, 2, 4, 8]), np.log(errors), 1)[0]
    np.testing.assert_allclose(slopes, -2.0, atol=0.35)


def test_presliding_below_breakaway_is_a_damped_spring(run: Callable[..., Array]) -> None:
    """0.2 N stays far below f_c = 1 N: position near u/sigma_0, with LuGre's hysteresis, and no net travel."""
    rows = run(PLANT, T, 0.2 * np.sin(2.0 * np.pi * T * np.arange(20_000)))
    cycle = rows[10_000:]
    assert np.abs(cycle[:, 0]).max() == pytest.approx(0.2 / SIGMA_0, rel=0.3)
    assert abs(cycle[-1, 0] - cycle[0, 0]) < 0.02 * np.abs(cycle[:, 0]).max()
    # The loop over one cycle encloses an area: work done against friction.
    work = np.sum(0.5 * (cycle[1:, 2] + cycle[:-1, 2]) * np.diff(cycle[:, 0]))
    assert work > 0.02 * 0.2 * 0.2 / SIGMA_0
