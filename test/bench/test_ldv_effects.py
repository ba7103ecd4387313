"""The vibrometer's demodulator, its colored noise and its drop-outs, against scipy.signal and their statistics."""

import math
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from hdd_servo_ros.bench.ldv import LONGEST_DELAY, Ldv, LdvParameters, ldv_step

T = 1e-4
PURE: dict[str, Any] = {
    'noise': False,
    'adc_bits': 0,
    'output_range': 0.0,
    'displacement_scale': 1.0,
    'velocity_scale': 1.0,
}
NOISY = {**PURE, 'noise': True}


def outputs(motion, sample_time=T, **parameters):
    sensor = Ldv(LdvParameters(**{**PURE, **parameters}), sample_time)
    return np.array([sensor.step(k, float(x), float(v)) for k, (x, v) in enumerate(motion)])


def sine(frequency, count=2000, sample_time=T, lag=0.0):
    w, t = 2.0 * math.pi * frequency, np.arange(count) * sample_time - lag
    return np.stack([np.sin(w * t), w * np.cos(w * t)], axis=1)


def welch(x):
    return signal.welch(x, fs=1.0 / T, nperseg=1024, detrend=False)


class TestDemodulator:
    @pytest.mark.parametrize('whole', [1, 2, 7, 10])
    def test_whole_samples_are_exact(self, whole):
        motion = np.random.default_rng(whole).normal(size=(100, 2))
        found = outputs(motion, demodulator_delay=whole * T)
        np.testing.assert_array_equal(found[whole:], motion[:-whole])
        # Before that, the head was at rest at its first measured position.
        assert np.all(found[:whole, 0] == motion[0, 0])
        assert np.all(found[:whole, 1] == 0.0)

    @given(st.floats(0.0, LONGEST_DELAY), st.floats(10.0, 500.0))
    @settings(max_examples=30)
    def test_any_delay_of_a_sine(self, delay, frequency):
        """The interpolation's error is of fourth order in w T for the position, of third for the velocity."""
        w = 2.0 * math.pi * frequency
        found, expected = outputs(sine(frequency, 200), demodulator_delay=delay), sine(frequency, 200, lag=delay)
        settled = math.ceil(delay / T) + 1
        np.testing.assert_allclose(found[settled:, 0], expected[settled:, 0], atol=(w * T) ** 4 / 384 * 1.1 + 1e-12)
        np.testing.assert_allclose(found[settled:, 1] / w, expected[settled:, 1] / w, atol=(w * T) ** 3 / 100 + 1e-12)

    @given(st.floats(0.0, LONGEST_DELAY), st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
    @settings(max_examples=30)
    def test_a_cubic_is_delayed_exactly(self, delay, coefficients):
        cubic, t = np.polynomial.Polynomial(coefficients), np.arange(40) * T * 1e3
        found = outputs(np.stack([cubic(t), 1e3 * cubic.deriv()(t)], axis=1), demodulator_delay=delay)[13:]
        late = t[13:] - delay * 1e3
        np.testing.assert_allclose(found, np.stack([cubic(late), 1e3 * cubic.deriv()(late)], axis=1), atol=1e-8)

    @pytest.mark.parametrize('frequency', [100.0, 2000.0, 30000.0])
    def test_the_low_pass_is_that_of_scipy(self, frequency):
        """First order, discretized with a first-order hold."""
        motion = np.cumsum(np.random.default_rng(2).normal(size=(500, 2)), axis=0)
        motion -= motion[0]
        system = signal.TransferFunction([1.0], [1.0 / (2.0 * math.pi * frequency), 1.0])
        discrete = system.to_ss().to_discrete(T, method='foh')
        found = outputs(motion, demodulator_bandwidth=frequency)
        for column in (0, 1):
            _, expected, _ = signal.dlsim(discrete, motion[:, column])
            np.testing.assert_allclose(found[:, column], expected[:, 0], atol=1e-9 * np.abs(motion).max())

    def test_the_low_pass_starts_where_the_head_is(self):
        found = outputs(np.full((50, 2), (3.0, 0.0)), demodulator_bandwidth=500.0)
        np.testing.assert_allclose(found[:, 0], 3.0, rtol=1e-12)

    def test_delay_and_low_pass_have_their_phase(self):
        """At 200 Hz: tau and the low pass's own lag, atan(f/f_c)."""
        found = outputs(sine(200.0), demodulator_delay=2.5e-5, demodulator_bandwidth=5000.0)[1000:, 0]
        t = np.arange(1000, 2000) * T
        phase = np.angle(np.sum(found * np.exp(-2j * math.pi * 200.0 * t)) * 1j)
        assert -phase == pytest.approx(2.0 * math.pi * 200.0 * 2.5e-5 + math.atan(200.0 / 5000.0), abs=2e-4)

    def test_a_delay_set_during_a_run_finds_the_past(self):
        sensor = Ldv(LdvParameters(**PURE), T)
        for k in range(20):
            sensor.step(k, float(k), 1.0 / T)
        sensor.update(LdvParameters(**PURE, demodulator_delay=3.5e-4))
        assert sensor.step(20, 20.0, 1.0 / T) == pytest.approx((16.5, 1.0 / T))


class TestNoise:
    COUNT = 60000

    def test_white_density(self):
        """Without a bandwidth the density is flat up to half the sampling frequency, at any sample time."""
        for sample_time in (1e-4, 2e-5):
            found = outputs(np.zeros((20000, 2)), sample_time, noise=True, noise_measure='density')
            expected = np.array([4.24e-5, 4.24e-2]) * math.sqrt(0.5 / sample_time)
            np.testing.assert_allclose(found.std(axis=0), expected, rtol=0.02)

    @pytest.mark.parametrize('bandwidth', [300.0, 3000.0])
    def test_density_with_a_bandwidth(self, bandwidth):
        """The spectrum of the sampled noise is D^2/(1 + (f/f_c)^2) with all that folds down, summed term by term."""
        found = outputs(np.zeros((self.COUNT, 2)), noise=True, noise_measure='density', noise_bandwidth=bandwidth)
        frequencies, power = welch(found[:, 0])
        folded = sum(1.0 / (1.0 + ((frequencies + m / T) / bandwidth) ** 2) for m in range(-2000, 2001))
        ratio = power[1:-1] / (4.24e-5**2 * folded[1:-1])
        # 117 averaged, overlapping segments scatter by some 10 % each; bands of 50 by a few percent.
        bands = ratio[: 500 // 50 * 50].reshape(-1, 50).mean(axis=1)
        np.testing.assert_allclose(bands, 1.0, atol=0.08)
        rms = 4.24e-5 * math.sqrt(math.pi / 2.0 * bandwidth)
        assert found[:, 0].std() == pytest.approx(rms, rel=0.04)

    def test_rms_with_a_bandwidth_keeps_its_rms_and_its_memory(self):
        found = outputs(np.zeros((self.COUNT, 2)), noise=True, noise_bandwidth=500.0)
        np.testing.assert_allclose(found.std(axis=0), [3e-3, 3.0], rtol=0.04)
        for column in found.T:
            for lag in (1, 3, 8):
                correlation = np.mean(column[lag:] * column[:-lag]) / np.mean(column**2)
                assert correlation == pytest.approx(math.exp(-2.0 * math.pi * 500.0 * lag * T), abs=0.04)

    def test_the_first_sample_is_no_exception(self):
        """Over many seeds the noise of tick 0 has the full rms: it does not grow from zero."""
        first = [
            Ldv(LdvParameters(**NOISY, noise_bandwidth=10.0, seed=seed), T).step(0, 0.0, 0.0)[0] for seed in range(2000)
        ]
        assert np.std(first) == pytest.approx(3e-3, rel=0.06)

    def test_a_very_wide_band_is_white(self):
        wide = outputs(np.zeros((50, 2)), noise=True, noise_bandwidth=1e9)
        np.testing.assert_array_equal(wide, outputs(np.zeros((50, 2)), noise=True))


class TestDropouts:
    RATE, DURATION = 200.0, 4e-4
    COUNT = 60000

    def dropped(self, **parameters):
        """Return where the outputs show no motion, of a head that always moves."""
        motion = np.stack([1.0 + np.arange(self.COUNT), np.ones(self.COUNT)], axis=1)
        sensor = Ldv(
            LdvParameters(
                **{
                    **PURE,
                    'dropout_rate': self.RATE,
                    'dropout_duration': self.DURATION,
                    'dropout_effect': 'zero',
                    **parameters,
                }
            ),
            T,
        )
        shown = np.array([sensor.step(k, x, v) for k, (x, v) in enumerate(motion.tolist())])
        return shown[:, 0] == 0.0, sensor

    def test_rate_and_duration(self):
        dark, sensor = self.dropped()
        starts = np.count_nonzero(np.diff(dark.astype(int)) == 1)
        chance = 1.0 - math.exp(-self.RATE * T)
        # A drop-out may follow the last at once, so that a dark stretch goes on with the chance of a new one.
        mean = 1.0 / (1.0 - math.exp(-T / self.DURATION)) / (1.0 - chance)
        assert starts / np.count_nonzero(~dark) == pytest.approx(chance, rel=0.1)
        assert np.count_nonzero(dark) / starts == pytest.approx(mean, rel=0.1)
        assert sensor.dropped_samples == np.count_nonzero(dark)

    def test_lengths_are_geometric(self):
        """The durations are exponential, so that the share of stretches longer than n samples falls by a factor."""
        dark, _ = self.dropped()
        edges = np.diff(np.concatenate([[0], dark.astype(int), [0]]))
        lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
        stays = 1.0 - (1.0 - math.exp(-T / self.DURATION)) * math.exp(-self.RATE * T)
        for n in (1, 3, 6):
            assert np.mean(lengths > n) == pytest.approx(stays**n, abs=0.05)

    def test_seeded(self):
        first, again, other = self.dropped()[0], self.dropped()[0], self.dropped(seed=2)[0]
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)

    def test_hold_shows_the_last_motion_seen(self):
        motion = np.stack([np.arange(3000.0), np.arange(3000.0) + 0.5], axis=1)
        shown = outputs(motion, dropout_rate=300.0)
        dark = np.flatnonzero(shown[:, 0] != motion[:, 0])
        assert 20 < len(dark) < 300
        np.testing.assert_array_equal(shown[dark], shown[dark - 1])

    def test_the_noise_goes_on(self):
        shown = outputs(np.ones((2000, 2)), dropout_rate=300.0, noise=True)
        assert len(set(shown[:, 0])) == 2000


class TestSaturation:
    def test_it_is_told_where_it_began(self):
        sensor = Ldv(LdvParameters(noise=False), T)
        assert sensor.saturation_warnings() == {}
        assert sensor.first_saturated_tick == {'displacement': None, 'velocity': None}
        for k, x in enumerate([0.0, 79.0, 81.0, 90.0, 0.0]):
            sensor.step(k, x, 0.0)
        assert sensor.saturated_samples == {'displacement': 2, 'velocity': 0}
        assert sensor.first_saturated_tick == {'displacement': 2, 'velocity': None}
        assert list(sensor.saturation_warnings()) == ['displacement']
        assert 'displacement output saturates at tick 2' in sensor.saturation_warnings()['displacement']

    def test_the_converter_alone_saturates_visibly(self):
        sensor = Ldv(LdvParameters(noise=False, output_range=0.0, adc_range=5.0), T)
        assert sensor.step(0, 0.0, -30000.0) == (0.0, -5.0)
        assert sensor.saturated_samples == {'displacement': 0, 'velocity': 1}

    @given(st.floats(0.0, 20.0), st.integers(0, 20), st.floats(0.1, 20.0))
    def test_the_levels_are_the_extremes(self, output_range, bits, adc_range):
        parameters = LdvParameters(noise=False, output_range=output_range, adc_bits=bits, adc_range=adc_range)
        sensor = Ldv(parameters, T)
        if output_range > 0.0 or bits > 0:
            assert parameters.levels() == (sensor.step(0, -1e6, 0.0)[0], sensor.step(1, 1e6, 0.0)[0])
        else:
            assert parameters.levels() == (-math.inf, math.inf)


def test_compiling_changes_no_bit():
    parameters = LdvParameters(
        noise_measure='density',
        noise_bandwidth=2000.0,
        demodulator_delay=1.234e-4,
        demodulator_bandwidth=3000.0,
        dropout_rate=500.0,
        output_range=0.2,
        adc_bits=12,
    )
    compiled, plain = Ldv(parameters, T), Ldv(parameters, T)
    for k, (x, v) in enumerate((2.0 * sine(150.0, 400)).tolist()):
        expected = cast(Any, ldv_step).py_func(*plain.arrays, k, x, v)
        assert compiled.step(k, x, v) == tuple(float(value) for value in expected)
    assert compiled.state.tolist() == plain.state.tolist()
    assert compiled.history.tolist() == plain.history.tolist()
    assert min(compiled.saturated_samples['displacement'], compiled.dropped_samples) > 0
