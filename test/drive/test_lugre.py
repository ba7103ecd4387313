"""The LuGre model along given motions and on a body: bounds, limits, an independent solver."""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.drive.friction.curves import friction_along, friction_curve
from hdd_servo_ros.drive.friction.lugre import decay_functions, lugre_bristle, lugre_level, lugre_substep
from hdd_servo_ros.drive.friction.parameters import FRICTION, FrictionParameters, friction_constants
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.records import record

Run = Callable[..., npt.NDArray[np.float64]]


@pytest.mark.parametrize('x', [0.0, 1e-9, 1e-4, 0.04999999, 0.05, 0.3, 3.0, 40.0, 800.0])
def test_decay_functions(x: float) -> None:
    first, second = decay_functions(x)
    # -expm1(-x)/x and its successor, by their series where those cancel
    reference = -math.expm1(-x) / x if x else 1.0
    assert first == pytest.approx(reference, rel=2e-14)
    series = sum((-x) ** k / math.factorial(k + 2) for k in range(30)) if x < 1.0 else (1.0 - reference) / x
    assert second == pytest.approx(series, rel=2e-12)


def test_level_of_section_5_4() -> None:
    # f_c = 1, f_s = 1.5, v_s = 0.001: at v = v_s the level is 1 + 0.5/e
    parameters = FrictionParameters(coulomb_level=1.0, static_level=1.5, stribeck_velocity=0.001)
    friction = record(friction_constants(parameters), FRICTION)
    assert lugre_level(friction, 0.0, 0.001) == pytest.approx(1.0 + 0.5 / math.e, rel=1e-14)


@pytest.mark.parametrize('velocity', [3.0, -250.0, 9000.0])
def test_bristle_under_constant_velocity_is_the_solution_of_its_equation(velocity: float) -> None:
    sigma, level, time = 0.02, 0.15, 1.0e-3
    reference = solve_ivp(
        lambda _, y: [velocity - sigma * abs(velocity) / level * y[0], y[0]],
        (0.0, time),
        [2.5, 0.0],
        rtol=1e-11,
        atol=1e-14,
    ).y[:, -1]
    deflection, mean = lugre_bristle(time, velocity, 2.5, sigma, level)
    assert deflection == pytest.approx(reference[0], rel=1e-9)
    assert mean * time == pytest.approx(reference[1], rel=1e-9)


@given(
    controls=st.lists(st.floats(-1.0e3, 1.0e3), min_size=1, max_size=100),
    stiffness=st.floats(1.0e-3, 1.0e6),
    damping=st.floats(0.0, 1.0),
    coulomb=st.floats(1.0e-2, 10.0),
    ratio=st.floats(1.0, 4.0),
    stribeck=st.floats(1.0e-3, 1.0e3),
    substep=st.sampled_from([1.0e-4, 2.5e-5, 1.0e-6]),
)
def test_bristle_stays_in_the_bound_of_lemma_4_1(
    controls: list[float],
    stiffness: float,
    damping: float,
    coulomb: float,
    ratio: float,
    stribeck: float,
    substep: float,
) -> None:
    """|z| <= 1/alpha_min = f_s/sigma_0 and finite motion, whatever the stiffness of the step."""
    limit = coulomb * ratio / stiffness
    parameters = FrictionParameters(
        stiffness=stiffness,
        bristle_damping=damping,
        viscous_coefficient=0.0,
        coulomb_level=coulomb,
        static_level=coulomb * ratio,
        stribeck_velocity=stribeck,
    )
    friction = record(friction_constants(parameters), FRICTION)
    # Without the clamp of the step, which hides the error of the predicted rate.
    friction.bristle_limit = math.inf
    velocity = bristle = force = 0.0
    for control in controls:
        mean, bristle, force = lugre_substep(friction, substep, 1.0, 0.0, velocity, bristle, force, control, 0.0)
        velocity = 2.0 * mean - velocity
        assert abs(bristle) <= limit * (1.0 + 1.0e-5)
        assert math.isfinite(velocity)
        assert math.isfinite(force)


@given(
    speed=st.floats(1.0, 1.0e5),
    coulomb=st.floats(0.01, 1.0),
    ratio=st.floats(1.0, 3.0),
    stribeck=st.floats(10.0, 1.0e4),
    viscous=st.floats(0.0, 1.0e-3),
)
def test_constant_motion_settles_on_the_static_map(
    speed: float, coulomb: float, ratio: float, stribeck: float, viscous: float
) -> None:
    p = FrictionParameters(
        coulomb_level=coulomb, static_level=coulomb * ratio, stribeck_velocity=stribeck, viscous_coefficient=viscous
    )
    travel = 60.0 * p.static_level / p.stiffness
    path = np.linspace(0.0, travel, 400)
    force = friction_along(p, path, travel / 399 / speed)
    assert force[-1] == pytest.approx(float(friction_curve(p, speed)), rel=1e-6)


def radau(p: FrictionParameters, gain: float, time: float, control: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Solve (4.1), (4.5), (4.6) by scipy, restarted at each tick because the control jumps there."""

    def rhs(_: float, y: npt.NDArray[np.float64], u: float) -> list[float]:
        x, v, z = y
        g = p.coulomb_level + (p.static_level - p.coulomb_level) * math.exp(-((v / p.stribeck_velocity) ** 2))
        if p.model == 'lugre_position':
            g *= 1.0 + p.position_ripple * math.sin(2.0 * math.pi * x / p.position_period)
        rate = v - p.stiffness * abs(v) / g * z
        h = p.stiffness * z + p.bristle_damping * rate + p.viscous_coefficient * v
        return [v, gain * (u - h), rate]

    y = np.zeros(3)
    rows = [y]
    for u in control:
        solution = solve_ivp(rhs, (0.0, time), y, method='Radau', args=(u,), rtol=1e-9, atol=[1e-10, 1e-7, 1e-11])
        y = solution.y[:, -1]
        rows.append(y)
    return np.array(rows)


@pytest.mark.parametrize('model', ['lugre', 'lugre_position'])
def test_body_with_friction_against_radau_and_the_order_of_the_step(model: str, run: Run) -> None:
    """Sliding and sticking of the default drive, at the default substeps and more."""
    p = FrictionParameters(model=model, position_ripple=0.5, position_period=20.0)
    control = 0.3 * np.sin(2.0 * np.pi * 70.0 * 1.0e-4 * np.arange(250))
    reference = radau(p, 4.0968e7, 1.0e-4, control)
    assert np.abs(reference[:, 2]).max() > 5.0  # it slides: z near f_c/sigma_0 = 6 µm
    peaks = np.abs(reference).max(axis=0)
    errors = []
    substeps = [4, 8, 16, 32, 64]
    for n in substeps:
        parameters = PlantParameters(friction=p, resonance=ResonanceParameters(form='none'), substeps=n)
        rows = run(parameters, 1.0e-4, control)
        errors.append(np.abs(rows[:, [3, 4, 7]] - reference).max(axis=0) / peaks)
    # Measured at the default 4 substeps: 2e-5, 2e-5, 3e-4, and with the ripple 3e-4, 5e-4, 2.4e-3.
    limits = {'lugre': [5e-5, 5e-5, 6e-4], 'lugre_position': [7e-4, 1e-3, 5e-3]}[model]
    assert np.all(errors[0] < limits)
    # The error scatters with where the reversals fall in a substep: its order is the slope over many.
    slopes = np.polyfit(np.log(substeps), np.log(errors), 1)[0]
    assert np.all(slopes < -1.7)
