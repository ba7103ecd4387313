"""The static maps against the equations as corrected, and the properties that the models have."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.drive.friction.curves import friction_along, friction_curve
from hdd_servo_ros.drive.friction.parameters import MODELS, STRIBECK_MODELS, FrictionParameters

LEVELS = st.floats(0.01, 10.0)
SPEEDS = st.floats(1.0e-6, 1.0e5)
BASE = FrictionParameters(
    stiffness=0.02,
    viscous_coefficient=2.0e-5,
    coulomb_level=0.1,
    static_level=0.25,
    stribeck_velocity=400.0,
    stribeck_exponent=1.5,
    second_break_level=0.03,
    second_stribeck_velocity=2500.0,
    first_offset_velocity=100.0,
    second_offset_velocity=900.0,
    drag_coefficient=3.0e-9,
    square_root_coefficient=4.0e-4,
)


def expected(model: str, v: float) -> float:
    """Return the corrected equations, written out for v > 0."""
    p = BASE
    fc, fs1, fs2, fv = 0.1, 0.15, 0.03, 2.0e-5
    vs, vs2, v10, v20 = 400.0, 2500.0, 100.0, 900.0
    return {
        'none': 0.0,
        'stiction': 0.0,  # (2.1) does not define sliding
        'tangential_stiffness': 0.25,  # (2.2) at breakaway
        'coulomb': fc,  # (2.3)
        'viscous': fv * v,  # (2.4)
        'coulomb_viscous': fc + fv * v,  # fig. 2.1 (b)
        'drag': 3.0e-9 * v * v,  # (2.5)
        'exponential': fc + fs1 * math.exp(-((v / vs) ** 1.5)) + fv * v,  # (2.6)
        'gaussian': fc + fs1 * math.exp(-((v / vs) ** 2)) + fv * v,  # (2.7)
        'gaussian_two_breaks': fc + fs1 * math.exp(-((v / vs) ** 2)) + fs2 * math.exp(-((v / vs2) ** 2)) + fv * v,
        'gaussian_two_breaks_offsets': fc
        + fs1 * math.exp(-(((v - v10) / vs) ** 2))
        + fs2 * math.exp(-(((v - v20) / vs2) ** 2))
        + fv * v,  # (2.9)
        'tustin': fc + fs1 * math.exp(-v / vs) + fv * v,  # (2.10)
        'square_root': fc + 4.0e-4 * math.sqrt(v) + fv * v,  # (2.11)
        'lorentzian': fc + fs1 / (1 + (v / vs) ** 2) + fv * v,  # (2.12)
        'lorentzian_two_breaks': fc + fs1 / (1 + (v / vs) ** 2) + fs2 / (1 + (v / vs2) ** 2) + fv * v,
        'lorentzian_two_breaks_offsets': fc
        + fs1 / (1 + ((v - v10) / vs) ** 2)
        + fs2 / (1 + ((v - v20) / vs2) ** 2)
        + fv * v,
        'complete': fc + fv * v + 3.0e-9 * v * v + 4.0e-4 * math.sqrt(v),  # (2.13)
        'dahl': fc,  # where (2.16) settles
        'lugre': fc + fs1 * math.exp(-((v / vs) ** 2)) + fv * v,  # (2.20)-(2.22) at dz/dt = 0
        'lugre_position': (fc + fs1 * math.exp(-((v / vs) ** 2))) * (1.0 + p.position_ripple) + fv * v,
    }[model]


@pytest.mark.parametrize('model', [model for model in MODELS if model != 'rbf_network'])
@pytest.mark.parametrize('velocity', [0.5, 90.0, 400.0, 7000.0])
def test_curve_is_the_corrected_equation(model: str, velocity: float) -> None:
    # A quarter of the period: where the ripple of alpha(x, v) is deepest.
    curve = friction_curve(replace(BASE, model=model), [velocity, -velocity], [2.5, 2.5])
    value = expected(model, velocity)
    np.testing.assert_allclose(curve, [value, -value], rtol=1.0e-12)


def test_curve_has_the_shape_of_its_arguments_and_is_zero_at_rest() -> None:
    curve = friction_curve(replace(BASE, model='gaussian'), np.zeros((3, 2)))
    assert curve.shape == (3, 2)
    assert not curve.any()


def test_network_curve_is_its_sum_of_gaussians() -> None:
    p = FrictionParameters(
        model='rbf_network',
        node_positions=(0.0, 3.0),
        node_velocities=(-100.0, 500.0),
        node_weights=(0.2, -0.7),
        position_width=2.0,
        velocity_width=300.0,
    )
    x, v = 1.3, 220.0
    # (2.25), (2.26) with one width per axis
    value = 0.2 * math.exp(-((x / 2) ** 2) - ((v + 100) / 300) ** 2)
    value -= 0.7 * math.exp(-(((x - 3) / 2) ** 2) - ((v - 500) / 300) ** 2)
    assert friction_curve(p, v, x) == pytest.approx(value, rel=1e-13)


@pytest.mark.parametrize('model', STRIBECK_MODELS)
@given(coulomb=LEVELS, rise=st.floats(0.0, 5.0), stribeck=st.floats(1.0, 1.0e4), viscous=st.floats(0.0, 1.0))
def test_stribeck_limits(model: str, coulomb: float, rise: float, stribeck: float, viscous: float) -> None:
    """F -> f_s (and f_s2) at v -> 0+, and F -> f_c + f_v v at large v."""
    p = FrictionParameters(
        model=model,
        coulomb_level=coulomb,
        static_level=coulomb + rise,
        stribeck_velocity=stribeck,
        second_stribeck_velocity=stribeck,
        first_offset_velocity=0.0,
        second_offset_velocity=0.0,
        viscous_coefficient=viscous,
    )
    start = p.static_level + (p.second_break_level if 'two' in model else 0.0)
    slow, fast = 1.0e-9 * stribeck, 1.0e7 * stribeck
    assert friction_curve(p, slow) == pytest.approx(start + viscous * slow, rel=1e-6)
    assert friction_curve(p, fast) == pytest.approx(coulomb + viscous * fast, rel=1e-6)


@pytest.mark.parametrize('model', [model for model in MODELS if model != 'rbf_network'])
@given(speed=SPEEDS, coulomb=LEVELS, rise=st.floats(0.0, 5.0), viscous=st.floats(0.0, 1.0), offset=st.floats(0.0, 1e4))
def test_sliding_friction_is_odd_and_dissipates(
    model: str, speed: float, coulomb: float, rise: float, viscous: float, offset: float
) -> None:
    p = FrictionParameters(
        model=model,
        coulomb_level=coulomb,
        static_level=coulomb + rise,
        viscous_coefficient=viscous,
        first_offset_velocity=offset,
        square_root_coefficient=-2.0 * math.sqrt(coulomb * viscous),
    )
    forward, backward = friction_curve(p, [speed, -speed], [1.0, 1.0])
    assert backward == -forward
    assert forward * speed >= -1.0e-12 * coulomb * speed


@pytest.mark.parametrize('model', ['lugre', 'dahl', 'tangential_stiffness', 'complete', 'coulomb', 'gaussian'])
@given(steps=st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=60))
def test_friction_along_a_motion_is_odd(model: str, steps: list[float]) -> None:
    path = np.cumsum([0.0, *steps])
    p = FrictionParameters(model=model)
    np.testing.assert_array_equal(friction_along(p, -path, 1e-4), -friction_along(p, path, 1e-4))


@pytest.mark.parametrize('model', ['lugre', 'lugre_position', 'dahl', 'tangential_stiffness', 'complete'])
@given(
    steps=st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=60),
    ratio=st.floats(1.0, 3.0),
    exponent=st.sampled_from([0.0, 0.5, 1.0, 1.5, 2.0, 3.0]),
)
def test_dynamic_friction_is_passive(model: str, steps: list[float], ratio: float, exponent: float) -> None:
    """The work done against friction is never below minus the energy that was stored: at no time below zero."""
    p = FrictionParameters(
        model=model, static_level=0.13 * ratio, dahl_exponent=exponent, bristle_damping=0.0, viscous_coefficient=0.0
    )
    # Finely sampled and smooth, so that the sum equals the integral within the tolerance.
    part = 0.5 - 0.5 * np.cos(np.pi * np.arange(0.005, 1.0025, 0.005))
    starts = np.cumsum([0.0, *steps[:-1]])
    path = np.concatenate([[0.0], *(start + step * part for start, step in zip(starts, steps, strict=True))])
    force = friction_along(p, path, 1.0e-4 * 0.005)
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(path))
    assert work.min(initial=0.0) >= -2.0e-3 * p.static_level * np.abs(np.diff(path)).max()
