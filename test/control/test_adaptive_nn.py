"""The adaptive NN controller against a reference implementation of (4.10)-(4.21), and by hand."""

import importlib.util
import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters, adaptive_nn_step
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError, declarations, from_mapping

T = 1e-4
UNIT = SensorScales(1.0, 1.0)
OFF = {'sigma.enabled': False, 'mass.enabled': False, 'phi.enabled': False, 'network.enabled': False}
STUDY = {
    **BARE_LAW,
    'error_filter_lambda': 1.0,
    'feedback_gain': 10.0,
    'control_limit': 1e6,
    'sigma.gain': 1.0,
    'sigma.leakage': 0.1,
    'mass.gain': 1.0,
    'mass.leakage': 0.1,
    'phi.gain': 1.0,
    'phi.leakage': 0.1,
    'network.gain': [1.0],
    'network.leakage': 1.0,
    'network.position_minimum': -1.0,
    'network.position_maximum': 1.0,
    'network.velocity_minimum': -5.0,
    'network.velocity_maximum': 5.0,
    'network.normalize_inputs': False,
    'network.width': [1.0],
    'width.gain': 2.0,
    'width.leakage': 0.1,
}


ESTIMATES = ('sigma_hat', 'm_hat', 'phi_hat', 'W_norm', 'spring_hat', 'hysteresis_hat', 'relaxation_hat')


def twin_of(parameters, sample_time):
    path = Path(__file__).with_name('adaptive_nn_twin.py')
    spec = importlib.util.spec_from_file_location('adaptive_nn_twin', path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Twin(parameters, sample_time)


def parameters_of(**values):
    return from_mapping(AdaptiveNnParameters, {**STUDY, **values})


def controller_of(**values):
    return AdaptiveNn(parameters_of(**values), T)


def step(controller, tick, *signals):
    """Step with both outputs of the sensor, position and velocity at 1 um/V and 1 um/s/V, and the reference."""
    return controller.step(UNIT.inputs(tick, *signals))


def named(controller):
    return dict(zip(controller.estimate_names, controller.estimates.tolist(), strict=True))


def signals(count, seed=0):
    """Return smooth motion about a reference, of the size in section 4.4."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) * 1e-2
    x_d, dx_d, ddx_d = np.sin(5.0 * t), 5.0 * np.cos(5.0 * t), -25.0 * np.sin(5.0 * t)
    return np.stack([x_d + 0.3 * rng.normal(size=count), dx_d + rng.normal(size=count), x_d, dx_d, ddx_d], axis=1)


DESIRED: dict[str, Any] = {
    'desired.enabled': True,
    'desired.lag': 0.03,
    'desired.peak_decay': 1.0,
    'sigma.scale': 2.0,
    'mass.scale': 10.0,
    'bristle.enabled': True,
    'bristle.distance': 0.3,
    'bristle.spring_distance': 2.0,
    **{
        f'bristle.{name}.{key}': value
        for name in ('spring', 'hysteresis', 'relaxation')
        for key, value in {'gain': 3.0, 'leakage': 0.2, 'initial': 0.5, 'scale': 0.4}.items()
    },
}
OPTIONS: dict[str, dict[str, Any]] = {
    'thesis': {},
    'other lattice': {'network.nodes': 3, 'network.normalize_inputs': True, 'network.width': [0.4, 0.9]},
    'diagonal gamma': {
        'network.nodes': 2,
        'network.gain': [0.5, 1.0, 2.0, 4.0],
        'network.initial': [0.1, 0.2, 0.3, 0.4],
    },
    'initial values': {'sigma.initial': 1.0, 'mass.initial': -2.0, 'phi.initial': 0.5, 'network.initial': [0.1]},
    'no leakage': {'sigma.leakage': 0.0, 'mass.leakage': 0.0, 'phi.leakage': 0.0, 'network.leakage': 0.0},
    'boundary layer': {'boundary_layer': 0.5},
    'integral': {'integral_gain': 2.0},
    'projection': {
        'projection': True,
        'sigma.minimum': -0.01,
        'sigma.maximum': 0.01,
        'mass.minimum': -0.02,
        'mass.maximum': 0.02,
        'phi.maximum': 0.01,
        'network.maximum': 0.005,
    },
    'r limit': {'r_limit': 0.2},
    'reference input': {'network.input': 'reference'},
    'widths': {'width.enabled': True, 'network.initial': [0.5]},
    'saturation': {'control_limit': 12.0},
    'desired compensation': DESIRED,
    'desired compensation without normalization': {**DESIRED, 'sigma.scale': 0.0, 'bristle.spring.scale': 0.0},
    'desired compensation without bristles': {**DESIRED, 'bristle.enabled': False},
    'desired compensation with projection': {
        **DESIRED,
        'projection': True,
        'sigma.minimum': -1.0,
        'sigma.maximum': 1.0,
        'mass.minimum': -1.0,
        'mass.maximum': 1.0,
        'phi.maximum': 10.0,
        'network.maximum': 10.0,
        'bristle.spring.minimum': 0.0,
        'bristle.spring.maximum': 0.52,
        'bristle.hysteresis.maximum': 0.52,
        'bristle.relaxation.maximum': 0.52,
    },
    'saturation without freezing': {'control_limit': 12.0, 'freeze_when_saturated': False},
}


@pytest.mark.parametrize('name', OPTIONS)
def test_follows_the_law_written_out(name):
    parameters = parameters_of(**OPTIONS[name])
    sample_time = 1e-2
    controller, twin = AdaptiveNn(parameters, sample_time), twin_of(parameters, sample_time)
    # The reference implementation integrates the bristles numerically.
    tolerance = 1e-4 if parameters.bristle.enabled else 1e-7
    for k, row in enumerate(signals(400).tolist()):
        before = twin.sigma, twin.mass, twin.phi, float(np.linalg.norm(twin.W)), *twin.bristles
        result = step(controller, k, *row)
        np.testing.assert_allclose(result, twin.step(*row), rtol=tolerance, atol=tolerance)
        estimates = named(controller)
        found = [estimates[key] for key in ESTIMATES]
        np.testing.assert_allclose(found, before, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(controller.weights, twin.W, rtol=1e-7, atol=1e-9)
    expected = np.array(parameters.network.axis_widths) * np.exp(twin.widths)
    step(controller, 400, *row)
    np.testing.assert_allclose(
        [named(controller)['position_width'], named(controller)['velocity_width']], expected, rtol=1e-5
    )
    if name.startswith('saturation'):
        assert 10 < twin.saturated < 390
    if name == 'widths':
        assert np.abs(twin.widths).min() > 0.05


def test_follows_the_law_written_out_on_jumps_in_two_parts():
    parameters = parameters_of(**{'shaping.share': 0.3, 'shaping.delay': 0.05, 'integral_gain': 2.0})
    controller, twin = AdaptiveNn(parameters, 1e-2), twin_of(parameters, 1e-2)
    differs = 0
    for k, (x, v, _, _, _) in enumerate(signals(400).tolist()):
        row = (x, v, 0.5 if k % 40 < 20 else -0.5, 0.0, 0.0)
        result = step(controller, k, *row)
        np.testing.assert_allclose(result, twin.step(*row), rtol=1e-7, atol=1e-9)
        differs += named(controller)['e'] != x - row[2]
    assert differs == 20 * 5


def test_by_hand():
    """Check (4.10), (4.11) and (4.16) with round numbers."""
    controller = controller_of(
        **{'sigma.initial': 0.5, 'mass.initial': 2.0, 'phi.initial': 0.25, 'network.enabled': False}
    )
    # e = 0.25, e' = 1, r = 1.25, a_r = 3 - 1 = 2: u = -12.5 + 0.5 v + 2 a_r - 0.25 with v = 4
    assert step(controller, 0, 1.25, 4.0, 1.0, 3.0, 3.0) == (-12.5 + 2.0 + 4.0 - 0.25,) * 2 + (-12.5,)


def test_only_feedback():
    assert step(controller_of(**OFF), 0, 0.5, 2.0, 0.0, 0.0, 9.0) == (-25.0, -25.0, -25.0)


@pytest.mark.parametrize(
    ('part', 'estimate'), [('sigma', 'sigma_hat'), ('mass', 'm_hat'), ('phi', 'phi_hat'), ('network', 'W_norm')]
)
def test_each_part_alone_moves_its_estimate_alone(part, estimate):
    controller = controller_of(**{**OFF, f'{part}.enabled': True})
    for k, row in enumerate(signals(50).tolist()):
        step(controller, k, *row)
    moved = {key for key in ('sigma_hat', 'm_hat', 'phi_hat', 'W_norm') if named(controller)[key] != 0.0}
    assert moved == {estimate}


def test_sign_of_zero_is_zero():
    controller = controller_of(**{'phi.initial': 1.0, 'network.initial': [1.0]})
    assert step(controller, 0, 0.0, 0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)
    assert step(controller, 1, 1e-12, 0.0, 0.0, 0.0, 0.0)[0] < -1.0


def test_estimates_start_as_given_and_are_those_used():
    controller = controller_of(**{'mass.initial': 3.0})
    step(controller, 0, 0.1, 0.0, 0.0, 0.0, 1.0)
    assert named(controller)['m_hat'] == 3.0
    step(controller, 1, 0.1, 0.0, 0.0, 0.0, 1.0)
    assert named(controller)['m_hat'] != 3.0
    assert named(controller)['t'] == T


def test_what_counts_is_position_and_velocity_and_no_voltage():
    scaled, plain = controller_of(), controller_of()
    inputs = SensorScales(8.0, 5000.0).inputs(0, 0.125, 0.001, 0.5, 1.0, 2.0)
    assert scaled.step(inputs) == step(plain, 0, 1.0, 5.0, 0.5, 1.0, 2.0)


def test_difference_as_velocity_source_is_blind_to_the_velocity_output():
    values = {**OFF, 'velocity_source': 'difference', 'velocity_bandwidth': 500.0}
    controller = controller_of(**values)
    rng = np.random.default_rng(4)
    x, x_d = np.cumsum(rng.normal(size=(2, 200)), axis=1) * 1e-3
    u = np.array([step(controller, k, x[k], 1e9, x_d[k], 7.0, 0.0)[0] for k in range(200)])
    # r = F (e_k - e_{k-1})/T + lambda e: the reference passes the same filter as the head.
    a = math.exp(-2.0 * math.pi * 500.0 * T)
    e, rate, expected = x - x_d, 0.0, []
    for k in range(200):
        if k > 0:
            rate = a * rate + (1.0 - a) * (e[k] - e[k - 1]) / T
        expected.append(-10.0 * (rate + e[k]))
    np.testing.assert_allclose(u, expected, rtol=1e-9, atol=1e-9)


def test_without_the_reference_filter_the_filters_lag_is_an_error():
    """On the reference r is zero with the filter on both, and the lag of the filter without it."""
    values = {**OFF, 'velocity_source': 'difference', 'velocity_bandwidth': 500.0, 'error_filter_lambda': 0.0}
    w, t = 2.0 * math.pi * 50.0, np.arange(3000) * T
    x, v = np.sin(w * t), w * np.cos(w * t)
    rows = {}
    for filtered in (True, False):
        controller = controller_of(**values, filter_reference=filtered)
        rows[filtered] = np.array(
            [step(controller, k, x[k], 0.0, x[k], v[k], 0.0) and controller.estimates[1] for k in range(len(t))]
        )
    assert np.all(rows[True] == 0.0)
    z, pole = np.exp(1j * w * T), math.exp(-2.0 * math.pi * 500.0 * T)
    response = (1.0 - pole) / (1.0 - pole / z) * (1.0 - 1.0 / z) / (1j * w * T)
    expected = (w * (response - 1.0) * np.exp(1j * w * t)).real
    np.testing.assert_allclose(rows[False][1000:], expected[1000:], atol=1e-6 * w)


def test_the_estimates_freeze_at_the_limit_of_what_comes_behind():
    told, own = controller_of(), controller_of(control_limit=12.0)
    told.limit_output(12.0)
    inputs = signals(400, seed=4)
    for k, row in enumerate(inputs):
        assert step(told, k, *row) == step(own, k, *row)
        assert told.estimates.tolist() == own.estimates.tolist()
    assert step(told, 400, 100.0, 0.0, 0.0, 0.0, 0.0)[0] == -12.0


def test_compensator_learns_a_friction_on_the_reference():
    """The law moves W_c against r, so that the compensator takes over a constant force from the feedback."""
    values = {**OFF, 'compensator.enabled': True, 'compensator.gain': 50.0, 'compensator.leakage': 1e-3}
    controller = controller_of(**values)
    position = velocity = 0.0
    for k in range(20000):
        u = step(controller, k, position, velocity, 0.0, 0.0, 0.0)[0]
        # Body with a constant force of -3, under the loop's own feedback.
        velocity += T * (u - 3.0)
        position += T * velocity
    assert named(controller)['compensator'] == pytest.approx(3.0, rel=0.01)
    assert abs(position) < 0.02
    assert np.linalg.norm(controller.compensator_weights) > 0.0


def test_compensator_learns_with_the_reference_of_a_lag_ago():
    """Compare with a slow implementation of the law, on a reference of constant acceleration."""
    lag = 0.3
    values = {
        **OFF,
        'compensator.enabled': True,
        'compensator.gain': 50.0,
        'compensator.leakage': 1e-3,
        'compensator.lag': lag,
        'compensator.nodes': 3,
        'compensator.width': 1.0,
        'compensator.velocity_minimum': -50.0,
        'compensator.velocity_maximum': 50.0,
    }
    controller = controller_of(**values)
    p = controller.parameters.compensator
    x_centers = np.linspace(p.position_minimum, p.position_maximum, 3)
    v_centers = np.linspace(p.velocity_minimum, p.velocity_maximum, 3)

    def activations(x, v):
        s_x = np.exp(-(((x - x_centers) / (0.5 * p.width * (p.position_maximum - p.position_minimum))) ** 2))
        s_v = np.exp(-(((v - v_centers) / (0.5 * p.width * (p.velocity_maximum - p.velocity_minimum))) ** 2))
        return np.outer(s_x, s_v).ravel()

    weights = np.zeros(9)
    a = math.exp(-p.gain * p.leakage * T)
    for k in range(500):
        t = k * T
        x_d, dx_d, ddx_d = -1.0 + 20.0 * t + 200.0 * t * t, 20.0 + 400.0 * t, 400.0
        step(controller, k, 0.0, 0.0, x_d, dx_d, ddx_d)
        assert named(controller)['compensator'] == pytest.approx(weights @ activations(x_d, dx_d), rel=1e-9, abs=1e-12)
        r = named(controller)['r']
        weights = a * weights - (1.0 - a) / p.leakage * r * activations(x_d - lag * dx_d, dx_d - lag * ddx_d)
    np.testing.assert_allclose(controller.compensator_weights, weights, rtol=1e-9, atol=1e-12)
    assert np.abs(weights).max() > 0.01


@pytest.mark.parametrize('law', ['sigma', 'mass'])
def test_a_negative_learning_gain_is_warned_of(law):
    negative = {f'{law}.enabled': True, f'{law}.gain': -2.0, f'{law}.leakage': 0.5}
    (warning,) = controller_of(**{**OFF, **negative, 'safe_gain': 0.0}).warnings()
    assert f'{law}.gain = -2 is negative' in warning
    assert 'grow by 1 1/s' in warning


@settings(max_examples=60)
@given(
    st.lists(st.floats(0.0, 1e20), min_size=8, max_size=8),
    st.floats(1e-6, 1.0),
    st.integers(0, 10**6),
)
def test_laws_are_stable_for_any_constants(constants, sample_time, seed):
    """Under bounded signals the estimates stay below the equilibrium |drive|/leakage of their law."""
    keys = ('sigma', 'mass', 'phi', 'network')
    values: dict[str, Any] = {}
    for i, key in enumerate(keys):
        gain = constants[2 * i]
        values[f'{key}.gain'] = [gain] if key == 'network' else gain
        values[f'{key}.leakage'] = 1e-3 + constants[2 * i + 1]
    parameters = parameters_of(**values)
    controller = AdaptiveNn(parameters, sample_time)
    largest = dict.fromkeys(keys, 0.0)
    for k, row in enumerate(signals(40, seed).tolist()):
        step(controller, k, *row)
        r, v = named(controller)['r'], row[1]
        a_r = row[4] - (v - row[3])
        for key, drive in zip(keys, (v * r, a_r * r, r, r), strict=True):
            largest[key] = max(largest[key], abs(drive))
    step(controller, 40, *row)
    for key, estimate in zip(keys, ('sigma_hat', 'm_hat', 'phi_hat', 'W_norm'), strict=True):
        bound = largest[key] / values[f'{key}.leakage'] * (5.0 if key == 'network' else 1.0)
        assert abs(named(controller)[estimate]) <= bound * (1.0 + 1e-9)


@pytest.mark.parametrize('offset', range(5))
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_not_hidden(offset, value):
    inputs = [0.1, 0.1, 0.1, 0.1, 0.1]
    inputs[offset] = value
    assert not math.isfinite(step(controller_of(**OFF, control_limit=1.0), 0, *inputs)[0])
    assert not math.isfinite(step(controller_of(), 0, *inputs)[0])


def test_gain_on_r_is_what_the_law_comes_to():
    """Held at one point of the lattice under a steady r, u/r settles at gain_on_r, where S'S is largest."""
    controller = controller_of(
        **{'sigma.enabled': False, 'mass.enabled': False, 'phi.gain': 1e6, 'network.gain': [1e6]}
    )
    for k in range(50):
        u, _, _ = step(controller, k, 0.0, 0.0, -0.01, 0.0, 0.0)
    assert -u / 0.01 == pytest.approx(controller.gain_on_r, rel=1e-6)


def test_adapting_widths_count_at_their_widest():
    wide = controller_of(**{'network.width': [2.0]}).gain_on_r
    assert controller_of(**{'width.enabled': True, 'width.factor': 2.0}).gain_on_r == pytest.approx(wide)
    assert wide > controller_of().gain_on_r + 0.1


def test_warns_of_a_low_stability_margin_only():
    # k + 1/sigma_phi + max(S'S)/sigma_w = 10 + 10 + something above 1
    assert controller_of(safe_gain=25.0).warnings() == ()
    (warning,) = controller_of(safe_gain=20.0).warnings()
    assert 'low stability margin' in warning
    assert controller_of(**{'safe_gain': 20.0, 'phi.enabled': False}).warnings() == ()
    assert controller_of(safe_gain=0.0).warnings() == ()


def test_the_default_is_safe():
    assert AdaptiveNn(AdaptiveNnParameters(), T).warnings() == ()


def test_update_keeps_what_was_learnt():
    controller = controller_of()
    for k, row in enumerate(signals(50).tolist()):
        step(controller, k, *row)
    learned = controller.state.copy()
    controller.update(parameters_of(feedback_gain=20.0))
    np.testing.assert_array_equal(controller.state, learned)
    result = step(controller, 50, *row)
    assert result[2] == -20.0 * named(controller)['r']
    with pytest.raises(ParameterError, match=r'network\.nodes'):
        controller.update(parameters_of(**{'network.nodes': 4}))


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('network.gain', {'network.gain': [1.0, 2.0]}),
        ('network.initial', {'network.initial': []}),
        ('network.width', {'network.width': [1.0, 1.0, 1.0]}),
        ('network.width', {'network.width': [0.0]}),
        ('network.position_maximum', {'network.position_maximum': -1.0}),
        ('network.velocity_maximum', {'network.velocity_maximum': -6.0}),
        ('compensator.position_maximum', {'compensator.position_maximum': -6.0}),
        ('sigma.minimum', {'sigma.minimum': 2.0}),
        ('mass.minimum', {'mass.minimum': 2.0}),
        ('phi.minimum', {'phi.minimum': 2.0}),
        ('sigma.initial', {'projection': True, 'sigma.initial': 2.0}),
        ('mass.initial', {'projection': True, 'mass.initial': -2.0}),
        ('phi.initial', {'projection': True, 'phi.initial': 2.0}),
        ('network.initial', {'projection': True, 'network.initial': [-2.0]}),
        ('feedback_gain', {'feedback_gain': -1.0}),
        ('phi.leakage', {'phi.leakage': -0.1}),
    ],
)
def test_what_is_rejected(name, values):
    with pytest.raises(ParameterError, match=name.replace('.', r'\.')):
        parameters_of(**values)


def test_a_rejected_range_names_both_of_its_ends():
    """Either of the two may have changed, for example by a service call that sets the minimum alone."""
    allowed = 'network.velocity_maximum: 5.0; expected above velocity_minimum = 7'
    with pytest.raises(ParameterError, match=allowed.replace('.', r'\.')):
        parameters_of(**{'network.velocity_minimum': 7.0})


def test_every_parameter_says_what_it_is():
    for declaration in declarations(AdaptiveNnParameters):
        assert declaration.description


def test_compiling_changes_no_bit():
    parameters = parameters_of(**{'width.enabled': True, 'compensator.enabled': True, 'integral_gain': 1.0})
    compiled, plain = AdaptiveNn(parameters, 1e-2), AdaptiveNn(parameters, 1e-2)
    for k, row in enumerate(signals(100).tolist()):
        expected = cast(Any, adaptive_nn_step).py_func(*plain.arrays, *UNIT.inputs(k, *row))
        assert step(compiled, k, *row) == tuple(float(value) for value in expected)
    assert compiled.state.tolist() == plain.state.tolist()
    assert compiled.estimates.tolist() == plain.estimates.tolist()
