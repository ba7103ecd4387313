"""The feedforward against a reference implementation in numpy, and the properties of its parts."""

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings
from hypothesis import strategies as st

from hdd_servo_ros.control.feedforward import AccelerometerScales, Feedforward
from hdd_servo_ros.control.feedforward_kernel import CONSTANTS, STATE
from hdd_servo_ros.control.feedforward_parameters import (
    FeedforwardModelParameters,
    FeedforwardParameters,
    IirParameters,
    NetworkParameters,
    SupervisorParameters,
)
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError

SAMPLE_TIME = 1e-4
SCALES = AccelerometerScales(0.1, 0.1)
MODEL = FeedforwardModelParameters()
ROTATION = MODEL.arm_radius / (MODEL.gain * 0.1 * 0.05)
LINEAR = MODEL.imbalance * 1e6 / (MODEL.gain * 0.1)
UNSUPERVISED = SupervisorParameters(enabled=False)


def path_of_a_loop(length=64):
    """A pulse response like that of a servo loop [um/V]."""
    samples = np.arange(length)
    path = 0.6 * np.exp(-samples / 5.0) * np.sin(samples / 3.0)
    path[0] = 0.0
    return path


def make(method, *, path=None, **parameters):
    parameters.setdefault('supervisor', UNSUPERVISED)
    path = path_of_a_loop() if path is None else path
    return Feedforward(FeedforwardParameters(method=method, **parameters), SAMPLE_TIME, path, SCALES)


def closed_loop(feedforward, disturbance, volts, path=None):
    """
    Run a loop in which force minus feedforward passes a path [V, um]; return errors and outputs.

    The sensors' volts are those of each tick, shape (n, 2).
    """
    path = path_of_a_loop() if path is None else path
    acting = np.zeros(len(disturbance) + len(path))
    errors, outputs = np.zeros(len(disturbance)), np.zeros(len(disturbance))
    for tick in range(len(disturbance)):
        # acting[tick + p - i] is the output applied i samples ago.
        errors[tick] = path @ acting[tick + len(path) - np.arange(len(path))] if tick else 0.0
        outputs[tick] = feedforward.step(errors[tick], *volts[tick])
        acting[tick + len(path)] = outputs[tick] - disturbance[tick]
    return errors, outputs


def volts_of(force):
    """Outputs of ideal sensors [V], shape (n, 2), under the rotation that acts like a force [V]."""
    half = force / ROTATION
    return np.stack([half, -half], axis=1)


def vibration(count, seed=1, smoothing=8):
    noise = np.random.default_rng(seed).normal(size=count + smoothing)
    smooth = np.convolve(noise, np.hanning(smoothing + 2)[1:-1], 'valid')[:count]
    return 0.02 * smooth / smooth.std()


class Twin:
    """Array implementation of the law: modified filtered-x LMS in the coordinates of scipy's cosine transform."""

    def __init__(self, parameters, path):
        self.p, self.path, n = parameters, path, parameters.taps
        self.nominal = np.zeros((2, n))
        self.nominal[:, 0] = 1.0
        self.weights, self.powers = self.nominal.copy(), np.zeros((2, n))
        self.raw, self.acting = np.zeros((2, 4000)), np.zeros(4000)
        self.filtered = np.zeros((2, 4000))
        self.tick = 0

    def step(self, error, x, y):
        p, n, k = self.p, self.p.taps, self.tick
        length = len(self.path)
        self.raw[:, k] = ROTATION * 0.5 * (x - y), LINEAR * 0.5 * (x + y)
        past = lambda values: self.path[: k + 1] @ values[k::-1][:length]  # noqa: E731
        self.filtered[:, k] = [past(row) for row in self.raw]
        latest = range(k, k - n, -1)
        window = lambda rows: np.array([[row[i] if i >= 0 else 0.0 for i in latest] for row in rows])  # noqa: E731
        regressors = window(self.filtered)
        expected = error - past(self.acting) + (self.weights * regressors).sum()
        error = np.clip(expected, -p.error_limit, p.error_limit)
        transformed = scipy.fft.dct(regressors, axis=1, norm='ortho')
        decay = np.exp(-SAMPLE_TIME / p.power_time)
        self.powers = decay * self.powers + (1.0 - decay) * transformed**2
        total = (transformed**2 / (self.powers + p.regularization)).sum()
        gains = self.powers / (self.powers + p.regularization) ** 2
        step = p.step_size * error / (n + max(total, 1.0)) * transformed * gains
        rest = self.nominal
        self.weights = rest + (1.0 - p.leakage) * (self.weights - rest) - scipy.fft.idct(step, axis=1, norm='ortho')
        self.acting[k] = (self.weights * window(self.raw)).sum()
        self.tick += 1
        return self.acting[k]


@pytest.mark.parametrize('taps', [1, 16])
def test_fxlms_equals_its_twin(taps):
    parameters = {'taps': taps, 'step_size': 0.1, 'leakage': 1e-4}
    count = 1500
    volts = np.random.default_rng(3).normal(size=(count, 2)) * 0.02
    errors = np.random.default_rng(4).normal(size=count) * 0.01
    law = make('fxlms', **parameters)
    twin = Twin(FeedforwardParameters(method='fxlms', **parameters), path_of_a_loop())
    found = [law.step(error, *pair) for error, pair in zip(errors, volts, strict=True)]
    wanted = [twin.step(error, *pair) for error, pair in zip(errors, volts, strict=True)]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_fixed_is_the_model_of_drive_and_sensors():
    law = make('fixed')
    rotation, linear = 12.5, 3.0
    x = 0.1 * (linear + rotation * 0.05)
    y = 0.1 * (linear - rotation * 0.05)
    wanted = (MODEL.arm_radius * rotation + MODEL.imbalance * 1e6 * linear) / MODEL.gain
    assert law.step(0.0, x, y) == pytest.approx(wanted)


def test_a_lead_extrapolates_a_ramp():
    law = make('fixed', lead=1.5e-4)
    force = 1e-3 * np.arange(20)
    outputs = [law.step(0.0, *pair) for pair in volts_of(force)]
    np.testing.assert_allclose(outputs[1:], force[1:] + 1.5e-3, rtol=1e-12)


@pytest.mark.parametrize('method', ['fxlms', 'iir', 'network'])
@pytest.mark.parametrize('gain', [0.5, 1.5])
def test_adaptation_removes_a_gain_error(method, gain):
    force = vibration(20_000)
    errors, _ = closed_loop(make(method), force, gain * volts_of(force))
    fixed, _ = closed_loop(make('fixed'), force, gain * volts_of(force))
    assert errors[-5000:].std() < 0.1 * fixed[-5000:].std()


def test_a_network_learns_a_path_that_is_not_linear():
    acceleration = vibration(60_000)
    force = acceleration * (1.0 + 0.075 * (acceleration / 0.02) ** 2)
    remaining = {
        method: closed_loop(make(method), force, volts_of(acceleration))[0][-10_000:].std()
        for method in ('fxlms', 'network')
    }
    assert remaining['network'] < 0.75 * remaining['fxlms']


def test_the_recursive_weights_stay_where_the_poles_are_inside_the_circle():
    law = make('iir', iir=IirParameters(step_size=1.0, pole_radius=0.8))
    random = np.random.default_rng(5)
    largest = 0.0
    for _ in range(3000):
        law.step(0.3 * random.normal(), *random.normal(size=2))
        state = record(law._named.state, STATE)
        largest = max(largest, *np.abs(np.roots([1.0, -state.a1, -state.a2])))
    assert 0.5 < largest <= 0.8 + 1e-9


@settings(max_examples=20)
@given(st.sampled_from(['fxlms', 'iir', 'network']), st.integers(0, 2**31), st.floats(-3.0, 1.0))
def test_weights_and_output_are_bounded_whatever_comes(method, seed, decade):
    law = make(
        method,
        step_size=1.0,
        weight_limit=3.0,
        control_limit=0.5,
        network=NetworkParameters(maximum=0.1, step_size=1.0),
    )
    random = np.random.default_rng(seed)
    for _ in range(400):
        output = law.step(10.0**decade * random.normal(), *(10.0**decade * random.normal(size=2)))
        assert abs(output) <= 0.5
    assert np.abs(law._named.weights).max() <= 3.0
    assert np.abs(law._named.network[0]).max() <= 0.1


def test_weights_leak_to_the_initial_ones_in_quiet():
    law = make('fxlms', leakage=1e-3)
    force = vibration(3000)
    closed_loop(law, force, 0.5 * volts_of(force))
    assert law._named.weights[0, 0] > 1.2
    for _ in range(20_000):
        law.step(0.0, 0.0, 0.0)
    np.testing.assert_allclose(law._named.weights, law._named.nominal, atol=1e-6)


def test_weights_without_signal_do_not_walk():
    law = make('fxlms')
    random = np.random.default_rng(6)
    for _ in range(20_000):
        law.step(0.003 * random.normal(), *(1e-5 * random.normal(size=2)))
    np.testing.assert_allclose(law._named.weights, law._named.nominal, atol=0.02)


def test_the_supervisor_switches_off_what_harms_and_on_what_helps():
    law = make('fixed', supervisor=SupervisorParameters(averaging_time=0.05, pause=0.1))
    force = vibration(20_000)
    noise = np.random.default_rng(7).normal(size=20_000) * 0.05
    # First the sensors measure no vibration, then all of it.
    seen = np.where(np.arange(20_000) < 10_000, noise, force)
    errors, outputs = closed_loop(law, force, volts_of(seen))
    assert law.times_switched_off >= 1
    without = closed_loop(make('fixed', enabled=False), force, volts_of(seen))[0]
    assert errors[5000:10_000].std() < 1.05 * without[5000:10_000].std()
    assert not law.is_switched_off
    assert errors[-2000:].std() < 0.1 * without[-2000:].std()
    assert np.abs(outputs[5000:10_000]).max() == 0.0 or law.times_switched_off > 1


def test_the_supervisor_cuts_off_an_instability_within_milliseconds():
    law = make('fixed', supervisor=SupervisorParameters(pause=1.0))
    path = path_of_a_loop()
    acting = np.zeros(3000 + len(path))
    errors = np.zeros(3000)
    coupling = -1.5 / ROTATION
    random = np.random.default_rng(8)
    for tick in range(3000):
        errors[tick] = path @ acting[tick + len(path) - np.arange(len(path))] if tick else 0.0
        errors[tick] += 0.003 * random.normal()
        # The sensors measure the last command: the output grows by half per sample.
        volts = coupling * acting[tick + len(path) - 1]
        acting[tick + len(path)] = law.step(errors[tick], volts + 1e-6, -volts)
    assert law.times_switched_off == 1
    assert np.abs(errors[500:]).max() < 0.02


def test_a_switched_off_feedforward_goes_on_learning():
    law = make('fxlms', enabled=False)
    force = vibration(10_000)
    _, outputs = closed_loop(law, force, 0.5 * volts_of(force))
    assert not outputs.any()
    assert law._named.weights[0].sum() == pytest.approx(2.0, abs=0.1)


def test_what_is_not_finite_passes():
    assert np.isnan(make('fxlms').step(np.nan, 0.0, 0.0))
    assert np.isnan(make('fxlms').step(0.0, np.inf, 0.0))


def test_an_update_keeps_the_weights():
    law = make('fxlms')
    force = vibration(3000)
    closed_loop(law, force, 0.5 * volts_of(force))
    before = law._named.weights.copy()
    law.update(FeedforwardParameters(method='fxlms', step_size=0.0, supervisor=UNSUPERVISED), path_of_a_loop(), SCALES)
    np.testing.assert_array_equal(law._named.weights, before)
    assert record(law._named.constants, CONSTANTS).step_size == 0.0


def test_a_path_must_be_a_multiple_of_four_samples():
    with pytest.raises(ParameterError, match='path_length: 30; expected a multiple of 4'):
        FeedforwardParameters(path_length=30)
