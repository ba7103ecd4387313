"""The ideal values satisfy the conditions of the proof, and no other values have a smaller c2."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.drive.friction.lugre import lugre_friction
from hdd_servo_ros.drive.friction.parameters import FRICTION, FrictionParameters, friction_constants
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError, from_mapping
from hdd_servo_ros.stability.ideal_values import KnownPlant, NetworkAt, _least_distance, run_values, theorem_values

SMALL = from_mapping(
    AdaptiveNnParameters,
    {
        **BARE_LAW,
        'network.nodes': 2,
        'network.position_minimum': -1.0,
        'network.position_maximum': 1.0,
        'network.velocity_minimum': -1.0,
        'network.velocity_maximum': 1.0,
        'network.leakage': 0.5,
        'phi.leakage': 2.0,
        'sigma.leakage': 0.1,
        'mass.leakage': 0.3,
    },
)


def cost(values, p):
    """Return twice c2 without the part of the mass."""
    return (
        p.sigma.leakage * values.sigma**2
        + p.phi.leakage * values.phi**2
        + p.network.leakage * np.sum(values.weights**2)
    )


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_least_distance_against_a_general_solver(seed):
    generator = np.random.default_rng(seed)
    rows = generator.uniform(0.1, 1.0, (12, 3))
    bounds = generator.uniform(0.5, 2.0, 12)
    found = _least_distance(rows, bounds)
    assert (rows @ found >= bounds * (1.0 - 1e-9)).all()
    constraint = {'type': 'ineq', 'fun': lambda y: rows @ y - bounds, 'jac': lambda y: rows}
    reference = minimize(
        lambda y: y @ y, np.full(3, 30.0), jac=lambda y: 2.0 * y, constraints=[constraint], options={'ftol': 1e-12}
    )
    assert reference.success
    np.testing.assert_allclose(found, reference.x, rtol=1e-4, atol=1e-5)


@given(
    velocity=st.floats(-2.0, 2.0), deflection=st.floats(-1.0, 1.0), damping=st.floats(0.0, 5.0), extra=st.floats(0.0, 2)
)
def test_the_bound_holds_for_every_deflection(velocity, deflection, damping, extra):
    plant = KnownPlant(
        stiffness=7.0,
        bristle_damping=damping,
        viscous_coefficient=0.4,
        coulomb_level=0.5,
        static_level=0.5 + extra,
        stribeck_velocity=0.3,
    )
    z = deflection * plant.static_level / plant.stiffness
    parameters = FrictionParameters(
        stiffness=plant.stiffness,
        bristle_damping=damping,
        viscous_coefficient=plant.viscous_coefficient,
        coulomb_level=plant.coulomb_level,
        static_level=plant.static_level,
        stribeck_velocity=plant.stribeck_velocity,
    )
    h = lugre_friction(record(friction_constants(parameters), FRICTION), 0.0, velocity, z)
    rest = h - (damping + plant.viscous_coefficient) * velocity
    assert abs(rest) <= plant.bristle_bound(np.array([velocity]))[0] * (1.0 + 1e-12)


def test_network_output_is_that_of_the_controller():
    weights = np.array([0.3, -0.2, 0.5, 1.0])
    p = dataclasses.replace(SMALL, network=dataclasses.replace(SMALL.network, initial=tuple(weights)))
    controller = AdaptiveNn(p, 1e-4)
    controller.step(SensorScales(1.0, 1.0).inputs(0, 0.2, -0.7, 0.0, 0.0, 0.0))
    network = NetworkAt(p, (np.array([0.2]), np.array([-0.7])))
    assert network.output(weights)[0] == pytest.approx(
        controller.estimates[controller.estimate_names.index('network')], rel=1e-12
    )
    assert network.activations(np.array([0])) @ weights == pytest.approx(network.output(weights), rel=1e-12)


def test_theorem_values_bound_the_friction_over_the_region():
    plant = KnownPlant(
        bristle_damping=0.5, viscous_coefficient=0.2, static_level=1.5, stribeck_velocity=0.05, disturbance_bound=0.1
    )
    values = theorem_values(plant, SMALL, ((-0.8, 0.9), (-0.7, 1.0)))
    assert values.sigma == 0.7
    generator = np.random.default_rng(1)
    x, v = generator.uniform(-0.8, 0.9, 20_000), generator.uniform(-0.7, 1.0, 20_000)
    demand = plant.bristle_bound(v) + 0.1
    slack = NetworkAt(SMALL, (x, v)).output(values.weights) + values.phi - demand
    assert slack.min() > -1e-3
    # The bound is active somewhere, and the network reduces c2 compared with phi alone.
    assert slack.min() < 1e-2
    alone = dataclasses.replace(values, phi=float(demand.max()), weights=np.zeros(4))
    assert cost(values, SMALL) < cost(alone, SMALL)


def test_run_values_against_a_general_solver():
    generator = np.random.default_rng(2)
    x, v = generator.uniform(-1, 1, 400), generator.uniform(-1, 1, 400)
    friction = np.sign(v) * (1.0 + 0.3 * np.cos(3.0 * x)) + 0.6 * v
    values = run_values(1.0, SMALL, friction, v, (x, v), 0.2)
    network = NetworkAt(SMALL, (x, v))
    activations = network.activations(np.arange(400))

    def slack(y):
        bound = activations @ y[2:] + y[1] - 0.2
        return np.concatenate((bound - (friction - y[0] * v), bound + (friction - y[0] * v)))

    assert slack(np.array([values.sigma, values.phi, *values.weights])).min() >= -1e-12
    scale = np.array([SMALL.sigma.leakage, SMALL.phi.leakage, *[SMALL.network.leakage] * 4])
    reference = minimize(
        lambda y: scale @ y**2,
        np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0]),
        constraints=[{'type': 'ineq', 'fun': slack}],
        options={'ftol': 1e-12, 'maxiter': 500},
    )
    assert reference.success
    assert cost(values, SMALL) == pytest.approx(reference.fun, rel=1e-4)


@pytest.mark.parametrize(
    'change', [{'width.enabled': True}, {'network.enabled': False}], ids=['adaptive widths', 'no network']
)
def test_phi_bounds_it_all_where_the_network_cannot(change):
    p = from_mapping(AdaptiveNnParameters, {**BARE_LAW, **change})
    v = np.array([-2.0, 1.0, 3.0])
    values = run_values(1.0, p, np.array([-1.0, 1.5, 1.2]), v, (np.zeros(3), v), 0.25)
    assert not values.weights.any()
    np.testing.assert_array_less(np.abs(np.array([-1.0, 1.5, 1.2]) - values.sigma * v) + 0.25, values.phi + 1e-9)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('mass.enabled', False),
        ('desired.enabled', True),
        ('phi.enabled', False),
        ('sigma.gain', 0.0),
        ('phi.leakage', 0.0),
        ('network.gain', (0.0,)),
        ('feedback_gain', 0.0),
    ],
)
def test_what_the_theorem_does_not_cover_is_rejected(name, value):
    p = from_mapping(AdaptiveNnParameters, {**BARE_LAW, name: value})
    one = np.ones(1)
    with pytest.raises(ParameterError, match=name):
        run_values(1.0, p, one, one, (one, one), 0.0)
    with pytest.raises(ParameterError, match=name):
        theorem_values(KnownPlant(), p, ((-1.0, 1.0), (-1.0, 1.0)))
