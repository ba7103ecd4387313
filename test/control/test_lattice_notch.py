"""The adaptive notch in lattice form: its response against scipy, and how it finds and follows a narrow-band signal."""

import dataclasses
from typing import Any, cast

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.control.lattice_notch import (
    METHODS,
    NOTCH,
    STATE,
    LatticeNotch,
    LatticeNotchParameters,
    lattice_notch_step,
)
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError

T = 1.0 / 52800.0
MODE = 5476.0
WIDE = LatticeNotchParameters(frequency=MODE, lowest=0.75 * MODE, highest=1.3 * MODE, bandwidth=1000.0)


def notch(**changes):
    return LatticeNotch(dataclasses.replace(WIDE, **changes), T)


def resonance(count, frequency, damping, seed=1):
    """Return white noise through a mode, by scipy; ``frequency`` [Hz] may be an array over time."""
    force = np.random.default_rng(seed).normal(size=count)
    w = 2.0 * np.pi * np.broadcast_to(frequency, count)
    radius = np.exp(-damping * w * T)
    a1, a2 = -2.0 * radius * np.cos(w * np.sqrt(1.0 - damping**2) * T), radius**2
    found = np.zeros(count + 2)
    for i in range(count):
        found[i + 2] = force[i] - a1[i] * found[i + 1] - a2[i] * found[i]
    return found[2:] / found.std()


def test_the_fixed_notch_against_scipy():
    """By scipy's notch with the same center and width, and by the coefficients of the all-pass."""
    block = notch(enabled=False)
    impulse = signal.unit_impulse(4000)
    found = [block.step(value) for value in impulse.tolist()]
    k1, k2 = record(block.state, STATE).k1, record(block.arrays[0], NOTCH).k2
    all_pass = [k2, k1 * (1.0 + k2), 1.0]
    expected = 0.5 * (impulse + signal.lfilter(all_pass, all_pass[::-1], impulse))
    np.testing.assert_allclose(found, expected, atol=1e-13)
    b, a = signal.iirnotch(MODE, MODE / WIDE.bandwidth, fs=1.0 / T)
    np.testing.assert_allclose(found, signal.lfilter(b, a, impulse), atol=1e-12)
    frequencies = np.linspace(50.0, 26000.0, 80)
    np.testing.assert_allclose(block.response(frequencies), signal.freqz(b, a, frequencies, fs=1.0 / T)[1], atol=1e-11)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('error', [-0.2, -0.1, 0.1, 0.2])
def test_a_sine_is_found_within_one_percent_in_10_ms(method, error):
    block = notch(method=method, frequency=(1.0 + error) * MODE)
    assert block.frequency == pytest.approx((1.0 + error) * MODE, rel=1e-12)
    noise = np.random.default_rng(2).normal(scale=0.2, size=4000)
    inputs = np.sin(2.0 * np.pi * MODE * T * np.arange(4000)) + noise
    found = []
    for value in inputs.tolist():
        block.step(value)
        found.append(block.frequency)
    assert np.abs(np.array(found[round(0.01 / T) :]) / MODE - 1.0).max() < 0.01


@pytest.mark.parametrize('error', [-0.2, 0.2])
@pytest.mark.parametrize('damping', [0.009, 0.03])
def test_a_mode_excited_by_noise_is_found_within_one_percent_in_100_ms(error, damping):
    block = notch(method='least_squares', frequency=(1.0 + error) * MODE, memory=0.03, bandwidth=300.0)
    found = []
    for value in resonance(round(0.3 / T), MODE, damping).tolist():
        block.step(value)
        found.append(block.frequency)
    after = np.array(found[round(0.1 / T) :]) / MODE - 1.0
    assert abs(after.mean()) < 0.005
    assert np.abs(after).max() < (0.01 if damping < 0.02 else 0.02)


@pytest.mark.parametrize('method', METHODS)
def test_a_drift_of_10_percent_in_2_s_is_followed(method):
    count = round(2.0 / T)
    frequencies = np.linspace(MODE, 1.1 * MODE, count)
    inputs = np.sin(2.0 * np.pi * np.cumsum(frequencies) * T)
    block = notch(method=method)
    outputs, errors = [], []
    for tick, value in enumerate(inputs.tolist()):
        outputs.append(block.step(value))
        if tick % 500 == 0:
            errors.append(block.frequency / frequencies[tick] - 1.0)
    assert np.abs(errors[1:]).max() < 0.005
    assert np.std(outputs[1000:]) < 0.02 * np.std(inputs)


@pytest.mark.parametrize('method', METHODS)
def test_the_center_stays_within_its_bounds(method):
    for frequency, bound in ((2000.0, WIDE.lowest), (9000.0, WIDE.highest)):
        block = notch(method=method)
        found = []
        for value in np.sin(2.0 * np.pi * frequency * T * np.arange(5000)).tolist():
            block.step(value)
            found.append(block.frequency)
        assert min(found) >= WIDE.lowest * (1.0 - 1e-9)
        assert max(found) <= WIDE.highest * (1.0 + 1e-9)
        assert found[-1] == pytest.approx(bound, rel=1e-9)


@pytest.mark.parametrize('method', METHODS)
def test_without_a_signal_the_center_stays(method):
    block = notch(method=method, frequency=5000.0)
    for _ in range(100):
        assert block.step(0.0) == 0.0
    assert block.frequency == pytest.approx(5000.0, rel=1e-12)


def test_parameters_changed_during_a_run():
    block = notch()
    block.step(1.0)
    block.update(dataclasses.replace(WIDE, frequency=6500.0, lowest=6000.0, enabled=False))
    assert block.frequency == pytest.approx(6000.0, rel=1e-12)


def test_invalid_parameters():
    with pytest.raises(ParameterError, match=r'frequency.*between lowest and highest'):
        LatticeNotchParameters(frequency=7000.0)
    with pytest.raises(ParameterError, match=r'highest.*below the Nyquist frequency of the notch, 5000 Hz'):
        LatticeNotch(LatticeNotchParameters(), 1e-4)


@pytest.mark.parametrize('method', METHODS)
def test_compiling_changes_no_bit(method):
    compiled, plain = notch(method=method), notch(method=method)
    for value in np.random.default_rng(3).normal(size=300).tolist():
        assert compiled.step(value) == cast(Any, lattice_notch_step).py_func(*plain.arrays, value)
    assert compiled.state.tolist() == plain.state.tolist()
