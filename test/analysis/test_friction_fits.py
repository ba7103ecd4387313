"""Fits and identification on data of known origin, with and without noise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.analysis.friction_fits import TERMS, fit_linear, fit_network, lattice, network_basis, regressor
from hdd_servo_ros.analysis.friction_identification import fit_static_map, identify_lugre
from hdd_servo_ros.drive.friction.curves import friction_along, friction_curve
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters

VELOCITY = np.concatenate([np.geomspace(10.0, 3.0e4, 60), -np.geomspace(10.0, 3.0e4, 60)])


def test_regressor_is_2_14() -> None:
    rows = regressor([0.0, 4.0, -9.0], [2.0, 2.0, 2.0])
    # [x delta(v), sgn v, v, v|v|, sqrt|v| sgn v]
    np.testing.assert_array_equal(rows, [[2, 0, 0, 0, 0], [0, 1, 4, 16, 2], [0, -1, -9, -81, -3]])
    assert regressor([3.0], [2.0], dead_band_velocity=5.0)[0, 0] == 2.0


@given(
    coulomb=st.floats(0.01, 10.0), viscous=st.floats(1e-6, 1e-2), drag=st.floats(1e-10, 1e-7), root=st.floats(0.0, 1e-2)
)
def test_complete_model_is_recovered(coulomb: float, viscous: float, drag: float, root: float) -> None:
    truth = FrictionParameters(
        model='complete',
        coulomb_level=coulomb,
        viscous_coefficient=viscous,
        drag_coefficient=drag,
        square_root_coefficient=root,
    )
    fit = fit_linear(VELOCITY, friction_curve(truth, VELOCITY), TERMS[1:])
    recovered = fit.parameters('complete')
    np.testing.assert_allclose(
        friction_curve(recovered, VELOCITY), friction_curve(truth, VELOCITY), rtol=1e-8, atol=1e-9 * coulomb
    )
    assert fit.coefficients['coulomb_level'] == pytest.approx(coulomb, rel=1e-6)
    assert fit.residual_rms < 1e-9 * max(coulomb, viscous * 3e4)


def test_stiffness_is_fitted_from_what_is_at_rest() -> None:
    position = np.linspace(-2.0, 2.0, 20)
    friction = 0.03 * position
    fit = fit_linear(np.zeros(20), friction, ['stiffness'], position)
    assert fit.coefficients == {'stiffness': pytest.approx(0.03)}


def test_square_root_law_follows_a_stribeck_curve_under_noise() -> None:
    """(2.11) bends downwards for f_r < 0, which is what it is for."""
    speeds = VELOCITY[np.abs(VELOCITY) < 2000.0]
    truth = friction_curve(FrictionParameters(model='tustin', static_level=0.2), speeds)
    noise = 1.0e-3 * np.random.default_rng(1).normal(size=speeds.size)
    fit = fit_linear(speeds, truth + noise)
    assert fit.coefficients['square_root_coefficient'] < 0.0
    assert fit.residual_rms < 0.1 * np.std(np.abs(truth)) + 2.0e-3


@pytest.mark.parametrize('terms', [['coulomb_level', 'stiffness'], ['coulomb_level', 'viscous_coefficient']])
def test_data_that_do_not_determine_the_terms_are_rejected(terms: list[str]) -> None:
    with pytest.raises(ValueError, match='do not determine'):
        fit_linear(np.full(10, 5.0), np.full(10, 0.1), terms)


def test_network_approximates_lugre_sliding() -> None:
    """(2.27): a 9 x 9 lattice leaves an error well below f_c away from v = 0."""
    positions, velocities = lattice(np.linspace(-10, 10, 9).tolist(), np.linspace(-4000, 4000, 9).tolist())
    base = FrictionParameters(
        node_positions=positions, node_velocities=velocities, position_width=2.5, velocity_width=1000.0,
        node_weights=(0.0,) * 81,
    )  # fmt: skip
    random = np.random.default_rng(2)
    x, v = random.uniform(-10, 10, 4000), random.uniform(-4000, 4000, 4000)
    truth = 0.1 * np.tanh(v / 1500.0) + 0.005 * x
    fitted, rms = fit_network(x, v, truth, base)
    assert fitted.model == 'rbf_network'
    assert rms < 0.004
    # What the fit says is what the model does.
    residual = friction_curve(fitted, v, x) - truth
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(rms, rel=1e-9)
    # Least squares: the residual is orthogonal to the regressors.
    assert np.abs(network_basis(x, v, fitted).T @ residual).max() < 1e-9 * 4000


@given(
    coulomb=st.floats(0.05, 1.0),
    ratio=st.floats(1.1, 2.5),
    stribeck=st.floats(50.0, 3000.0),
    viscous=st.floats(0.0, 1.0e-5),
)
def test_static_map_is_recovered(coulomb: float, ratio: float, stribeck: float, viscous: float) -> None:
    truth = FrictionParameters(
        coulomb_level=coulomb,
        static_level=coulomb * ratio,
        stribeck_velocity=stribeck,
        viscous_coefficient=viscous,
    )
    fit = fit_static_map(VELOCITY, friction_curve(truth, VELOCITY))
    assert fit.coulomb_level == pytest.approx(coulomb, rel=1e-4)
    assert fit.static_level == pytest.approx(coulomb * ratio, rel=1e-3)
    assert fit.stribeck_velocity == pytest.approx(stribeck, rel=1e-3)
    assert fit.viscous_coefficient == pytest.approx(viscous, abs=1e-9)
    assert fit.residual_rms < 1e-5 * coulomb


@pytest.mark.parametrize(('noise', 'tolerance'), [(0.0, 1e-3), (0.002, 0.05)])
def test_lugre_is_identified(noise: float, tolerance: float) -> None:
    truth = replace(FrictionParameters(), bristle_damping=2.0e-5, static_level=0.2)
    random = np.random.default_rng(3)
    time = 1.0e-5 * np.arange(6000)
    # Presliding loops that grow into sliding.
    position = (1.0 + 150.0 * time) * np.sin(2.0 * np.pi * 100.0 * time)
    friction = friction_along(truth, position, 1.0e-5)
    sliding = friction_curve(truth, VELOCITY)
    found, rms = identify_lugre(
        VELOCITY,
        sliding + noise * random.normal(size=sliding.size),
        position,
        friction + noise * random.normal(size=friction.size),
        1.0e-5,
    )
    assert found.model == 'lugre'
    for name in ('stiffness', 'coulomb_level', 'static_level'):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=tolerance)
    assert found.bristle_damping == pytest.approx(truth.bristle_damping, rel=5 * tolerance)
    assert found.stribeck_velocity == pytest.approx(truth.stribeck_velocity, rel=5 * tolerance)
    assert rms == pytest.approx(noise, rel=0.1, abs=1e-5)


def independent_data(
    truth: FrictionParameters, amplitude: float, frequency: float, sample_time: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and friction of LuGre under a sine, (2.20)-(2.22) by scipy."""
    w = 2.0 * math.pi * frequency

    def rate(time: float, z: float) -> float:
        v = amplitude * w * math.cos(w * time)
        falling = math.exp(-((v / truth.stribeck_velocity) ** 2))
        g = truth.coulomb_level + (truth.static_level - truth.coulomb_level) * falling
        return v - truth.stiffness * abs(v) / g * z

    time = sample_time * np.arange(round(0.06 / sample_time))
    solution = solve_ivp(
        lambda t, z: [rate(t, z[0])], (0.0, time[-1]), [0.0], 'Radau', time, rtol=1e-9, atol=1e-11, max_step=1e-3
    )
    velocity = amplitude * w * np.cos(w * time)
    rates = np.array([rate(t, z) for t, z in zip(time, solution.y[0], strict=True)])
    friction = truth.stiffness * solution.y[0] + truth.bristle_damping * rates + truth.viscous_coefficient * velocity
    return amplitude * np.sin(w * time), velocity, friction


STIFFER = replace(FrictionParameters(), bristle_damping=2.0e-5, static_level=0.2)


@pytest.mark.parametrize('truth', [FrictionParameters(), STIFFER])
@pytest.mark.parametrize(('amplitude', 'frequency'), [(3.0, 100.0), (12.0, 50.0), (5.0, 20.0)])
@pytest.mark.parametrize('measured', [False, True])
def test_lugre_is_identified_from_an_integrators_data(
    truth: FrictionParameters, amplitude: float, frequency: float, measured: bool
) -> None:
    """At T = 0.1 ms, presliding (3 um) and sliding; with and without the velocity measured."""
    position, velocity, friction = independent_data(truth, amplitude, frequency, 1.0e-4)
    sliding = friction_curve(truth, VELOCITY)
    found, _ = identify_lugre(
        VELOCITY, sliding, position, friction, 1.0e-4, motion_velocity=velocity if measured else None
    )
    # Measured: within 1e-4 and 3e-3.
    assert found.stiffness == pytest.approx(truth.stiffness, rel=5e-4)
    assert found.bristle_damping == pytest.approx(truth.bristle_damping, rel=5e-3)


def test_friction_along_is_of_second_order() -> None:
    errors = []
    for sample_time in (2.0e-4, 1.0e-4, 5.0e-5, 2.5e-5):
        position, _, friction = independent_data(STIFFER, 12.0, 50.0, sample_time)
        errors.append(np.abs(friction_along(STIFFER, position, sample_time) - friction)[1:].max())
    assert np.polyfit(np.log([8.0, 4.0, 2.0, 1.0]), np.log(errors), 1)[0] > 1.7


def test_lugre_is_identified_from_the_plant() -> None:
    """By the signals of /head of the block at T = 0.1 ms: 0.1 V at 80 Hz, in presliding."""
    truth = FrictionParameters()
    plant = Plant(PlantParameters(friction=truth, resonance=ResonanceParameters(form='none')), 1.0e-4)
    rows = [plant.output()]
    for tick in range(1, 1000):
        control = 0.1 * math.sin(2.0 * math.pi * 80.0 * 1.0e-4 * (tick - 1)) * min(1.0, tick / 300.0)
        rows.append(plant.step(tick, control))
    position, velocity, friction = np.array(rows).T
    for motion_velocity in (None, velocity):
        found, _ = identify_lugre(
            VELOCITY, friction_curve(truth, VELOCITY), position, friction, 1.0e-4, motion_velocity=motion_velocity
        )
        assert found.stiffness == pytest.approx(truth.stiffness, rel=5e-4)
        assert found.bristle_damping == pytest.approx(truth.bristle_damping, rel=1e-2)


@pytest.mark.parametrize('seed', range(6))
def test_a_friction_without_a_stribeck_fall_is_identified(seed: int) -> None:
    truth = replace(FrictionParameters(), static_level=0.13, viscous_coefficient=0.0)
    noise = 1.0e-4 * np.random.default_rng(seed).normal(size=VELOCITY.size)
    position, _, friction = independent_data(truth, 12.0, 50.0, 1.0e-4)
    found, _ = identify_lugre(VELOCITY, friction_curve(truth, VELOCITY) + noise, position, friction, 1.0e-4)
    # A fall that is not there may be fitted to the noise: slow, and then it takes from f_c.
    assert found.coulomb_level == pytest.approx(0.13, rel=1e-2)
    assert found.static_level == pytest.approx(0.13, rel=1e-2)
    assert found.static_level >= found.coulomb_level
    assert found.stiffness == pytest.approx(truth.stiffness, rel=5e-3)


def test_data_that_cannot_be_are_rejected() -> None:
    p = FrictionParameters()
    path = np.linspace(0.0, 1.0, 10)
    for sample_time in (0.0, -1.0e-4, math.nan, math.inf):
        with pytest.raises(ValueError, match='sample_time'):
            friction_along(p, path, sample_time)
    with pytest.raises(ValueError, match=r'position has the shape \(2, 5\)'):
        friction_along(p, path.reshape(2, 5), 1e-4)
    with pytest.raises(ValueError, match=r'position .* not finite, the first at index 3'):
        friction_along(p, np.where(np.arange(10) == 3, np.nan, path), 1e-4)
    with pytest.raises(ValueError, match='velocity has 9 samples'):
        friction_along(p, path, 1e-4, path[1:])
    with pytest.raises(ValueError, match='friction has 119 samples'):
        fit_static_map(VELOCITY, VELOCITY[1:])
    with pytest.raises(ValueError, match='not finite'):
        identify_lugre(VELOCITY, friction_curve(p, VELOCITY), path, np.full(10, math.nan), 1e-4)
    with pytest.raises(ValueError, match="unknown term 'mass'; expected stiffness"):
        fit_linear(VELOCITY, VELOCITY, ['mass'])
    with pytest.raises(ValueError, match='not finite'):
        fit_linear(VELOCITY, np.full(VELOCITY.size, math.inf))
    with pytest.raises(ValueError, match='at least one'):
        fit_network(path, path, path, p)


def test_a_static_map_needs_sliding() -> None:
    with pytest.raises(ValueError, match='with nonzero velocity'):
        fit_static_map([0.0, 1.0, 2.0, 3.0], [0.0, 0.1, 0.1, 0.1])
    with pytest.raises(ValueError, match='the position is constant'):
        identify_lugre(VELOCITY, friction_curve(FrictionParameters(), VELOCITY), np.zeros(10), np.zeros(10), 1e-4)
