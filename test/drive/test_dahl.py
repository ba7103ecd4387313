"""Dahl's model: the closed solution against an integrator, and the properties of section 2.2.2."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.drive.friction.curves import friction_along
from hdd_servo_ros.drive.friction.dahl import dahl_force, dahl_mean_force, dahl_slope
from hdd_servo_ros.drive.friction.parameters import FRICTION, FrictionParameters, friction_constants
from hdd_servo_ros.numerics.records import record


def contact(stiffness: float, coulomb_level: float, exponent: float) -> np.record:
    """Return a contact as the kernels take it."""
    parameters = FrictionParameters(
        model='dahl', stiffness=stiffness, coulomb_level=coulomb_level, dahl_exponent=exponent
    )
    return record(friction_constants(parameters), FRICTION)


EXPONENTS = [0.0, 0.5, 1.0, 1.5, 2.0, 4.0]


@pytest.mark.parametrize('exponent', EXPONENTS)
@pytest.mark.parametrize('start', [-0.9, 0.0, 0.6])
@pytest.mark.parametrize('displacement', [0.3, 2.0, -1.1])
def test_closed_solution_is_the_integral_of_the_slope(exponent: float, start: float, displacement: float) -> None:
    sigma, level = 2.0, 1.0

    def slope(_: float, force: np.ndarray) -> list[float]:
        """(2.15), corrected, by itself."""
        y = 1.0 - force[0] / level * math.copysign(1.0, displacement)
        return [math.copysign(sigma, displacement) * (abs(y) ** exponent if y > 0.0 else 0.0)]

    reference = solve_ivp(
        slope, (0.0, abs(displacement)), [start], method='LSODA', rtol=1e-10, atol=1e-12, max_step=1e-3
    )
    # alpha < 1 reaches f_c in a finite path, where the reference steps over the corner.
    assert dahl_force(contact(sigma, level, exponent), start, displacement) == pytest.approx(
        reference.y[0, -1], abs=3e-3 if exponent < 1.0 else 1e-8
    )


@pytest.mark.parametrize('exponent', EXPONENTS)
def test_slope_is_the_derivative_of_the_closed_solution(exponent: float) -> None:
    step = 1.0e-6
    friction = contact(2.0, 1.0, exponent)
    change = dahl_force(friction, 0.4, step) - 0.4
    assert change / step == pytest.approx(dahl_slope(friction, 0.4, 1.0), rel=1e-4)
    # Unloading is steeper: y = 1.4.
    assert dahl_slope(friction, 0.4, -1.0) == pytest.approx(2.0 * 1.4**exponent)


@given(
    steps=st.lists(st.floats(-1.0e4, 1.0e4), min_size=1, max_size=40),
    exponent=st.floats(0.0, 20.0),
    stiffness=st.floats(1.0e-4, 1.0e3),
    level=st.floats(1.0e-3, 1.0e3),
)
def test_friction_never_exceeds_coulomb(steps: list[float], exponent: float, stiffness: float, level: float) -> None:
    p = FrictionParameters(model='dahl', dahl_exponent=exponent, stiffness=stiffness, coulomb_level=level)
    force = friction_along(p, np.cumsum([0.0, *steps]), 1.0e-4)
    assert np.abs(force).max() <= level * (1.0 + 1e-15)


@given(
    steps=st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=40),
    exponent=st.floats(0.0, 5.0),
    faster=st.floats(1.0e-3, 1.0e3),
)
def test_friction_does_not_depend_on_the_rate(steps: list[float], exponent: float, faster: float) -> None:
    p = FrictionParameters(model='dahl', dahl_exponent=exponent)
    path = np.cumsum([0.0, *steps])
    np.testing.assert_array_equal(friction_along(p, path, 1e-4), friction_along(p, path, 1e-4 * faster))


@given(exponent=st.floats(0.0, 5.0), parts=st.lists(st.floats(0.01, 5.0), min_size=1, max_size=10))
def test_a_path_may_be_cut_anywhere(exponent: float, parts: list[float]) -> None:
    force = 0.0
    friction = contact(0.05, 0.1, exponent)
    for part in parts:
        force = dahl_force(friction, force, part)
    assert force == pytest.approx(dahl_force(friction, 0.0, sum(parts)), rel=1e-9)


@given(
    start=st.floats(-1.0, 1.0),
    displacement=st.floats(-20.0, 20.0),
    exponent=st.one_of(st.floats(0.0, 20.0), st.sampled_from([0.0, 1.0, 2.0, 2.0 + 1e-9])),
)
def test_mean_force_is_the_mean_of_the_closed_solution(start: float, displacement: float, exponent: float) -> None:
    # Nodes that are dense at the start, where a large exponent falls fast.
    part = np.linspace(0.0, 1.0, 1001) ** 3
    friction = contact(1.0, 1.0, exponent)
    force = np.array([dahl_force(friction, start, displacement * x) for x in part])
    trapezoids = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(part)))
    mean = dahl_mean_force(friction, start, displacement, force[-1])
    assert mean == pytest.approx(trapezoids, abs=1e-3)
    assert min(force) - 1e-12 <= mean <= max(force) + 1e-12
