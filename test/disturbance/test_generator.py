"""The generator as a block: rows and single ticks, the coupling, live changes, the declared topics."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 1e-4
ALL: dict[str, Any] = {
    'runout.repeatable.enabled': True,
    'flutter.enabled': True,
    'force_noise.enabled': True,
    'vibration.rotational.enabled': True,
    'vibration.linear.enabled': True,
    'vibration.linear.kind': 'swept_sine',
    'shock.enabled': True,
    'shock.time': 0.01,
    'shock.rotational_amplitude': 100.0,
}


def parameters(values):
    return from_mapping(DisturbanceParameters, values)


def generator(values, sample_time=T):
    return DisturbanceGenerator(parameters(values), sample_time)


def stepped(block, first_tick, count):
    """Return the rows of both topics from single steps."""
    steps = [block.step(tick) for tick in range(first_tick, first_tick + count)]
    disturbance = np.array([(force, track_center, 0.0) for force, track_center, _, _ in steps])
    return disturbance, np.array([(*linear, *angular) for _, _, linear, angular in steps])


def same(left, right):
    return all(one.tobytes() == other.tobytes() for one, other in zip(left, right, strict=True))


def test_by_default_nothing_acts():
    assert DisturbanceParameters().enabled_sources == ()
    assert parameters(ALL).enabled_sources == (
        'runout.repeatable',
        'flutter',
        'force_noise',
        'vibration.rotational',
        'vibration.linear',
        'shock',
    )
    for rows in generator({}).rows(0, 100):
        assert not rows.any()


def test_rows_are_the_single_ticks_however_a_run_is_cut():
    expected = generator(ALL).rows(0, 300)
    assert same(stepped(generator(ALL), 0, 300), expected)
    cut = generator(ALL)
    parts = [cut.rows(0, 1), cut.rows(1, 0), stepped(cut, 1, 99), cut.rows(100, 200)]
    assert same([np.concatenate(topic) for topic in zip(*parts, strict=True)], expected)
    assert [rows.shape[1] for rows in expected] == [topic.codec.width for topic in DisturbanceGenerator.topics]


@pytest.mark.parametrize('source', [name for name in ALL if name.endswith('enabled') and 'shock' not in name])
def test_each_source_has_its_own_seed(source):
    seed = f'{source.removesuffix("enabled")}seed'
    linear = {'vibration.linear.kind': 'random'}
    one, again, other = (generator({**linear, source: True, seed: value}).rows(0, 50) for value in (1, 1, 2))
    assert same(one, again)
    assert not same(one, other)


@pytest.mark.parametrize('sample_time', [T, 37879e-9, 19841e-9])
def test_the_density_of_the_force_noise_is_the_same_at_every_sample_time(sample_time):
    values = {'force_noise.enabled': True, 'force_noise.sigma': 2e-3, 'force_noise.reference_rate': 26400.0}
    force = generator(values, sample_time).rows(0, 200_000)[0][:, 0]
    assert force.std() ** 2 * sample_time == pytest.approx(2e-3**2 / 26400.0, rel=0.02)
    assert abs(np.corrcoef(force[1:], force[:-1])[0, 1]) < 0.01


def test_the_default_force_noise_is_that_of_the_benchmark():
    """0.1 m/s^2 at 26.4 kHz, of a drive with 4.0968e7 um/s^2 per volt."""
    assert parameters({}).force_noise.sigma == pytest.approx(0.1e6 / 4.0968e7, rel=1e-3)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.0, 1.0), st.floats(1e-3, 1.0))
def test_the_coupling(linear, angular, cubic, scale):
    values = {
        'vibration.linear.enabled': True,
        'vibration.linear.kind': 'sine',
        'vibration.linear.amplitude': linear,
        'vibration.linear.frequency': 0.0,
        'vibration.linear.phase': 0.25,
        'vibration.rotational.enabled': True,
        'vibration.rotational.kind': 'sine',
        'vibration.rotational.amplitude': angular,
        'vibration.rotational.frequency': 0.0,
        'vibration.rotational.phase': 0.25,
        'coupling.imbalance': 0.02,
        'coupling.cubic': cubic,
        'coupling.cubic_scale': scale,
    }
    force, track_center, accelerations, rotations = generator(values).step(0)
    assert (accelerations, rotations) == ((0.0, linear, 0.0), (0.0, 0.0, angular))
    alone = (50.8e3 * angular + 0.02 * 1e6 * linear) / 4.0968e7
    assert force == pytest.approx(alone * (1.0 + cubic * (alone / scale) ** 2), rel=1e-9, abs=1e-12)
    assert track_center == 0.0


def test_levels_that_were_computed_elsewhere():
    """12.5 rad/s^2 are 0.0155 V, a half-sine of 63 g with 2 % imbalance 0.302 V, one of 300 g 1.44 V."""
    vibration = {'vibration.rotational.enabled': True, 'vibration.rotational.rms': 12.5}
    assert generator(vibration).rows(0, 400_000)[0][:, 0].std() == pytest.approx(0.0155, rel=0.02)
    for level, peak in ((63.0, 0.302), (300.0, 1.44)):
        shock = {'shock.enabled': True, 'shock.linear_amplitude': level, 'coupling.imbalance': 0.02}
        assert generator(shock, 1e-6).rows(0, 103_000)[0][:, 0].max() == pytest.approx(peak, rel=5e-3)


def test_a_change_acts_from_the_next_tick_on_and_filters_keep_their_state():
    block = generator(ALL)
    whole = generator(ALL).rows(0, 200)
    block.rows(0, 100)
    louder = {
        **ALL,
        'vibration.rotational.rms': 3.0,
        'flutter.sigmas': tuple(2.0 * s for s in parameters({}).flutter.sigmas),
    }
    block.update(parameters(louder))
    disturbance, accelerations = block.rows(100, 100)
    shock = generator({**ALL, 'vibration.rotational.enabled': False}).rows(0, 200)[1][100:, 5]
    assert accelerations[:, 5] - shock == pytest.approx(3.0 * (whole[1][100:, 5] - shock), abs=1e-12)
    quiet = {**ALL, 'flutter.enabled': False}
    runout = generator(quiet).rows(0, 200)[0][100:, 1]
    assert disturbance[:, 1] - runout == pytest.approx(2.0 * (whole[0][100:, 1] - runout), abs=1e-15)


def test_a_change_of_the_band_is_continuous():
    on = {'vibration.rotational.enabled': True, 'vibration.rotational.rms': 12.5}
    block = generator(on)
    before = block.rows(0, 5000)[1][:, 5]
    block.update(parameters({**on, 'vibration.rotational.high': 450.0, 'vibration.rotational.low': 12.0}))
    after = block.rows(5000, 5000)[1][:, 5]
    steps = np.abs(np.diff(np.concatenate((before, after))))
    assert steps[4999] <= steps[:4999].max()
    assert after.std() == pytest.approx(12.5, rel=0.15)


@pytest.mark.parametrize(
    ('change', 'topic', 'column'),
    [
        ({'vibration.rotational.high_order': 4}, 1, 5),
        ({'vibration.rotational.low': 0.0}, 1, 5),
        ({'flutter.frequencies': (500.0,), 'flutter.damping_ratios': (0.1,), 'flutter.sigmas': (0.001,)}, 0, 1),
    ],
)
def test_filters_with_another_number_of_states_start_as_new_ones(change, topic, column):
    block = generator(ALL)
    block.rows(0, 10)
    block.update(parameters({**ALL, **change}))
    fresh = generator({**ALL, **change})
    assert block.rows(10, 50)[topic][:, column].tobytes() == fresh.rows(10, 50)[topic][:, column].tobytes()


def test_a_source_that_is_disabled_and_enabled_again_continues():
    on = {'vibration.rotational.enabled': True}
    block = generator(on)
    block.rows(0, 10)
    block.update(parameters({}))
    for rows in block.rows(10, 10):
        assert not rows.any()
    block.update(parameters(on))
    goes_on = generator(on)
    goes_on.rows(0, 10)
    assert same(block.rows(20, 50), goes_on.rows(20, 50))


def test_a_change_that_is_rejected_changes_nothing():
    block, other = generator(ALL), generator(ALL)
    block.rows(0, 10)
    other.rows(0, 10)
    for change in ({'vibration.rotational.high': 6000.0}, {'runout.repeatable.sequence': 'random'}):
        with pytest.raises(ParameterError):
            block.update(parameters({**ALL, **change}))
    assert block.parameters == parameters(ALL)
    assert same(block.rows(10, 50), other.rows(10, 50))


@settings(max_examples=25)
@given(
    st.sampled_from([1e-4, 37879e-9, 19841e-9, 2e-4]),
    st.floats(0.6, 100.0),
    st.integers(1, 32),
    st.integers(1, 32),
    st.floats(1e-4, 0.9),
)
def test_all_is_finite(sample_time, low, low_order, high_order, damping):
    values = {
        **ALL,
        'vibration.rotational.low': low,
        'vibration.rotational.low_order': low_order,
        'vibration.rotational.high_order': high_order,
        'flutter.damping_ratios': (damping,) * 9,
    }
    for rows in generator(values, sample_time).rows(0, 2000):
        assert math.isfinite(float(np.abs(rows).sum()))
