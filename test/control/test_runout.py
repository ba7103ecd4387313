"""Cancellation of repeatable runout against reference implementations in numpy, and effects of its parameters."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdd_servo_ros.control.runout import RunoutCancellation, path_length, samples_per_revolution
from hdd_servo_ros.control.runout_kernel import learning_filter, response_at
from hdd_servo_ros.control.runout_parameters import RunoutModelParameters, RunoutParameters
from hdd_servo_ros.disturbance.spindle import SpindleParameters
from hdd_servo_ros.parameters import ParameterError

SECTORS = 42
RPM = 7200.0
T = round(60e9 / (RPM * SECTORS)) / 1e9


def path_of_a_loop(length):
    """A pulse response like that of a servo loop [um/V]."""
    samples = np.arange(length)
    path = 0.6 * np.exp(-samples / 5.0) * np.sin(samples / 3.0)
    path[0] = 0.0
    return path


def make(method, sample_time=T, **parameters):
    given = RunoutParameters(method=method, **parameters)
    return RunoutCancellation(given, sample_time, path_of_a_loop(path_length(given, sample_time)))


def closed_loop(law, runout, ticks, noise=None):
    """Run a loop in which the cancellation passes the path of the block itself; return errors and outputs."""
    path = law.path
    acted = np.zeros(ticks + len(path))
    errors = np.zeros(ticks)
    for tick in range(ticks):
        errors[tick] = runout(tick) + path[1:] @ acted[tick + len(path) - np.arange(1, len(path))]
        errors[tick] += 0.0 if noise is None else noise[tick]
        acted[tick + len(path)] = law.step(tick, errors[tick])
    return errors, acted[len(path) :]


def periodic(seed=1, scale=0.02, sectors=SECTORS):
    values = np.random.default_rng(seed).normal(size=sectors) * scale
    # The mean, held by the controller's integral, and half the sampling frequency are not canceled.
    spectrum = np.fft.rfft(values)
    spectrum[0] = 0.0
    if sectors % 2 == 0:
        spectrum[-1] = 0.0
    values = np.fft.irfft(spectrum, sectors)
    return lambda tick: values[tick % sectors]


def test_repetitive_equals_its_twin():
    parameters = {'gain': 0.2, 'cutoff': 1500.0, 'wait': 1, 'error_limit': 0.03}
    law = make('repetitive', **parameters)
    rng = np.random.default_rng(2)
    ticks = 8 * SECTORS
    found, errors = np.zeros(ticks), 0.02 * rng.normal(size=ticks)
    for tick in range(ticks):
        found[tick] = law.step(tick, errors[tick])
    path = law.path
    response = (path * np.exp(-2j * np.pi * np.outer(np.arange(SECTORS // 2 + 1) / SECTORS, np.arange(len(path))))).sum(
        axis=1
    )
    low_pass = 1.0 / (1.0 + (np.arange(SECTORS // 2 + 1) / (SECTORS * T) / 1500.0) ** 8)
    learning = np.zeros(SECTORS // 2 + 1, complex)
    learning[1:-1] = (low_pass / response)[1:-1]
    mean, wanted = np.zeros(SECTORS), np.zeros(ticks)
    for revolution in range(8):
        rows = slice(revolution * SECTORS, (revolution + 1) * SECTORS)
        wanted[rows] = -np.fft.irfft(learning * np.fft.rfft(mean), SECTORS)
        past = np.array([path[: tick + 1] @ wanted[tick::-1][: len(path)] for tick in range(rows.start, rows.stop)])
        if revolution >= 1:
            gain = max(1.0 / revolution, 0.2)
            mean = mean + gain * (np.clip(errors[rows] - past, -0.03, 0.03) - mean)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert np.abs(found).max() > 0.05
    last = wanted[-2 * SECTORS : -SECTORS]
    assert law.learned_rms == pytest.approx(np.sqrt(np.mean(last**2)), rel=1e-9)
    assert law.gain == 0.2


@pytest.mark.parametrize('sample_time', [T, 1e-4])
def test_harmonics_equals_its_twin(sample_time):
    orders = (1, 4, 7)
    parameters = {'orders': orders, 'gain': 0.1, 'initial_gain': 0.5, 'wait': 2}
    law = make('harmonics', sample_time, **parameters)
    turns = 1.0 / SECTORS if sample_time == T else 0.012
    path = law.path
    response = [path @ np.exp(-2j * np.pi * order * turns * np.arange(len(path))) for order in orders]
    coefficients = np.zeros(3, complex)
    errors = 0.02 * np.random.default_rng(5).normal(size=1200)
    first = 2 * SECTORS if sample_time == T else 167
    for tick, error in enumerate(errors):
        angle = 2.0 * np.pi * np.array(orders) * turns * tick
        if tick >= first:
            gain = max(min(2.0 / (2.0 + (tick - first) * turns), 0.5), 0.1)
            coefficients -= gain * 2.0 * turns / np.array(response) * error * np.exp(-1j * angle)
        wanted = (coefficients * np.exp(1j * angle)).real.sum()
        assert law.step(tick, error) == pytest.approx(wanted, abs=1e-12)
    assert law.learned_rms == pytest.approx(np.sqrt(0.5 * (np.abs(coefficients) ** 2).sum()), rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 60), st.integers(0, 2**32 - 1), st.just(0.0) | st.floats(0.5, 40.0))
def test_the_learning_filter_inverts_the_periodic_response(count, seed, cutoff_order):
    pulse = np.random.default_rng(seed).normal(size=count + 1)
    taps = np.zeros(count)
    learning_filter(pulse, cutoff_order, taps)
    folded = pulse[:count].copy()
    folded[0] += pulse[count]
    orders = np.arange(count // 2 + 1)
    low_pass = 1.0 / (1.0 + (orders / cutoff_order) ** 8) if cutoff_order else np.ones(len(orders))
    wanted = low_pass.astype(complex)
    wanted[0] = 0.0
    if count % 2 == 0:
        wanted[-1] = 0.0
    np.testing.assert_allclose(np.fft.rfft(taps) * np.fft.rfft(folded), wanted, atol=1e-7)


def test_the_response_at_a_frequency_is_that_of_numpy():
    pulse = np.random.default_rng(1).normal(size=500)
    for turns in (0.0, 0.012, 0.49):
        wanted = pulse @ np.exp(-2j * np.pi * turns * np.arange(500))
        assert complex(*response_at(pulse, turns)) == pytest.approx(wanted, abs=1e-10)


def test_repetitive_takes_off_what_repeats_in_the_second_revolution_after_the_wait():
    law = make('repetitive', cutoff=0.0, wait=1)
    errors, _ = closed_loop(law, periodic(), 6 * SECTORS)
    by_revolution = np.abs(errors.reshape(6, SECTORS)).max(axis=1)
    assert by_revolution[1] > 0.03
    # In the first revolution the cancellation is a step into the periodic response; the next one is periodic.
    assert by_revolution[3] < 1e-4 * by_revolution[1]


def test_repetitive_averages_the_noise_of_the_first_revolutions():
    """With n revolutions of white noise the learned signal has 1/n of its variance, later gain/(2 - gain)."""
    rng = np.random.default_rng(3)
    # By Parseval the filter multiplies the variance of white noise by the sum of its squares.
    taps = np.zeros(SECTORS)
    learning_filter(make('repetitive').path, 0.0, taps)
    variance = 1e-4 * (taps @ taps)
    tenth = []
    for _ in range(60):
        noise = 0.01 * rng.normal(size=11 * SECTORS)
        _, outputs = closed_loop(make('repetitive', cutoff=0.0, wait=0), lambda _: 0.0, len(noise), noise)
        tenth.append(np.mean(outputs[-SECTORS:] ** 2))
    assert np.mean(tenth) == pytest.approx(variance / 10, rel=0.2)
    noise = 0.01 * rng.normal(size=1000 * SECTORS)
    _, outputs = closed_loop(make('repetitive', cutoff=0.0, gain=0.05), lambda _: 0.0, len(noise), noise)
    assert np.mean(outputs[200 * SECTORS :] ** 2) == pytest.approx(variance * 0.05 / 1.95, rel=0.2)


@pytest.mark.parametrize('sample_time', [T, 1e-4])
def test_harmonics_takes_off_its_orders_alone(sample_time):
    law = make('harmonics', sample_time, orders=(1, 3))
    angle = 2.0 * np.pi * RPM / 60.0 * sample_time
    if sample_time == T:
        angle = 2.0 * np.pi / SECTORS
    ticks = 100 * round(2.0 * np.pi / angle)
    errors, _ = closed_loop(law, lambda k: 0.04 * np.sin(angle * k + 1.0) + 0.01 * np.cos(3 * angle * k), ticks)
    assert np.abs(errors[-200:]).max() < 1e-3
    late = round(11 * 2.0 * np.pi / angle)
    assert np.abs(errors[late : late + 100]).max() < 0.1 * 0.05
    law = make('harmonics', sample_time, orders=(1, 3))
    errors, _ = closed_loop(law, lambda k: 0.02 * np.sin(2 * angle * k), ticks)
    assert np.sqrt(2.0) * errors[-400:].std() == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize('method', ['harmonics', 'repetitive'])
def test_what_was_learned_stays(method):
    law = make(method, cutoff=0.0)
    runout = periodic()
    closed_loop(law, runout, 40 * SECTORS)
    learned = [law.step(40 * SECTORS + i, 0.0) for i in range(SECTORS)]

    def repeated(**changes):
        law.update(dataclasses.replace(law.parameters, **changes), law.path)
        return [law.step(42 * SECTORS + i, 0.2) for i in range(SECTORS)]

    law.update(dataclasses.replace(law.parameters, learning=False), law.path)
    frozen = [law.step(41 * SECTORS + i, 0.2) for i in range(SECTORS)]
    assert np.abs(np.array(frozen) - learned).max() < 0.3 * np.abs(learned).max()
    # Neither errors nor other parameters change it any more.
    assert repeated() == frozen
    assert repeated(gain=0.5, control_limit=0.9) == frozen
    assert not any(repeated(enabled=False))
    assert repeated(enabled=True) == frozen
    assert repeated(learning=True) != frozen or method == 'repetitive'


@pytest.mark.parametrize('method', ['harmonics', 'repetitive'])
def test_it_stays_within_its_limit_and_reports_it(method):
    law = make(method, control_limit=0.01, cutoff=0.0)
    assert not law.is_limited
    _, outputs = closed_loop(law, periodic(scale=0.2), 30 * SECTORS)
    assert np.abs(outputs).max() == 0.01
    assert law.is_limited
    law.update(dataclasses.replace(law.parameters, control_limit=10.0, learning=False), law.path)
    for i in range(SECTORS + 1):
        law.step(30 * SECTORS + i, 0.0)
    assert not law.is_limited


def test_a_wrong_model_is_bounded_by_the_limit():
    """A path with the wrong sign diverges up to the limit, and no further."""
    law = make('repetitive', cutoff=0.0)
    law.update(dataclasses.replace(law.parameters, control_limit=0.5), -law.path)
    path = -law.path
    acted, last = np.zeros(200 * SECTORS + len(path)), 0.0
    for tick in range(200 * SECTORS):
        error = periodic()(tick) + path[1:] @ acted[tick + len(path) - np.arange(1, len(path))]
        last = acted[tick + len(path)] = law.step(tick, error)
    assert np.isfinite(last)
    assert np.abs(acted).max() == 0.5


def test_an_error_that_is_not_finite_is_passed_on():
    for method in ('harmonics', 'repetitive'):
        for error in (np.nan, np.inf):
            assert np.isnan(make(method).step(0, error))


@settings(max_examples=100, deadline=None)
@given(st.integers(10, 500), st.floats(3000.0, 15000.0), st.integers(-30_000, 30_000))
def test_a_revolution_has_as_many_samples_as_that_of_the_disturbances(sectors, rpm, off):
    sample_time = round(60e9 / (rpm * sectors) + off / 100) / 1e9
    spindle = SpindleParameters(revolutions_per_minute=rpm, sectors=sectors)
    own = RunoutParameters(method='repetitive', revolutions_per_minute=rpm, sectors=sectors)
    assert samples_per_revolution(own, sample_time) == spindle.samples_per_revolution(sample_time)
    found = samples_per_revolution(dataclasses.replace(own, sectors=0), sample_time)
    if samples_per_revolution(own, sample_time):
        assert found == sectors


def test_repetitive_needs_a_whole_number_of_samples():
    with pytest.raises(ParameterError, match=r"runout.method: 'repetitive'; expected harmonics, since .* 0.000100402"):
        make('repetitive', 1e-4)
    with pytest.raises(ParameterError, match=r'such as 84 with sample_time = 9.9206e-05 s at 7200'):
        make('repetitive', 1e-4, sectors=84)
    assert make('repetitive', 99206e-9, sectors=84).path.shape == (85,)


def test_orders_above_half_the_sampling_frequency_are_rejected():
    with pytest.raises(ParameterError, match=r'runout.orders: \(1, 42\); expected below 41.67'):
        make('harmonics', 1e-4, orders=(1, 42))
    for orders in ((), (2, 2)):
        with pytest.raises(ParameterError, match='at least one order, without repetition'):
            RunoutParameters(orders=orders)


@pytest.mark.parametrize(
    ('lists', 'text'),
    [
        ({'numerators': (1.0, 2.0)}, 'three numbers b2, b1, b0 per resonance'),
        ({'numerators': (0.0, 0.0, 1.0)}, '3 numbers, as many as numerators'),
        ({'numerators': (0.0, 0.0, 1.0), 'denominators': (1.0, 0.0, 1.0)}, 'above 0'),
    ],
)
def test_resonances_of_the_model_are_checked(lists, text):
    with pytest.raises(ParameterError, match=text):
        RunoutModelParameters(**lists)
