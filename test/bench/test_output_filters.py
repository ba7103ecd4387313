"""The chain of filters after the controller: design and response against scipy.signal, and changes without a bump."""

from typing import Any, cast

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.bench.output_filters import FilterParameters, OutputFilters, filters_step
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 5e-5
NOTCH: dict[str, Any] = {
    'notch.frequencies': (5476.0, 6494.0, 7847.0),
    'notch.dampings': (0.1, 0.05, 0.2),
    'notch.depths': (40.0, 20.0, 30.0),
}
RESONANT: dict[str, Any] = {
    'resonant.frequencies': (1800.0, 4100.0),
    'resonant.dampings': (0.01, 0.05),
    'resonant.gains': (2.0, 0.7),
    'resonant.phases': (0.0, 65.0),
}
LEAD: dict[str, Any] = {'lead.frequencies': (1500.0, 900.0), 'lead.phases': (35.0, -20.0)}
LOW_PASS: dict[str, Any] = {'low_pass.frequencies': (8000.0,), 'low_pass.dampings': (0.6,)}
SECTIONS: dict[str, Any] = {'sections': tuple(signal.butter(4, 6000.0, fs=1.0 / T, output='sos').ravel().tolist())}
EVERY = {**NOTCH, **RESONANT, **LEAD, **LOW_PASS, **SECTIONS}
KINDS = {'notch': NOTCH, 'resonant': RESONANT, 'lead': LEAD, 'low_pass': LOW_PASS}


def filters(values, sample_time=T):
    return OutputFilters(from_mapping(FilterParameters, values), sample_time)


def analog(kind, values):
    """Return center frequency [rad/s], numerator and denominator of each filter, from its equation."""
    lists = [
        values[f'{kind}.{name}']
        for name in ('frequencies', 'dampings', 'depths', 'gains', 'phases')
        if f'{kind}.{name}' in values
    ]
    for frequency, *others in zip(*lists, strict=True):
        w = 2.0 * np.pi * frequency
        if kind == 'notch':
            z, depth = others
            yield w, [1.0, 2.0 * z * w * 10.0 ** (-depth / 20.0), w * w], [1.0, 2.0 * z * w, w * w]
        elif kind == 'resonant':
            z, k, phi = others[0], others[1], np.radians(others[2])
            denominator = np.array([1.0, 2.0 * z * w, w * w])
            yield w, denominator + 2.0 * k * z * w * np.array([0.0, np.cos(phi), -w * np.sin(phi)]), denominator
        elif kind == 'lead':
            sine = np.sin(np.radians(others[0]))
            q = np.sqrt((1.0 + sine) / (1.0 - sine))
            yield w, [q / w, 1.0], [1.0 / (q * w), 1.0]
        else:
            yield w, [w * w], [1.0, 2.0 * others[0] * w, w * w]


def by_scipy(kind, values):
    """Return the discrete filters by scipy's bilinear transform, prewarped by its sampling frequency."""
    for w, numerator, denominator in analog(kind, values):
        yield signal.bilinear(numerator, denominator, fs=0.5 * w / np.tan(0.5 * w * T))


@pytest.mark.parametrize('kind', KINDS)
def test_coefficients_against_scipy(kind):
    found = filters(KINDS[kind]).sos
    for section, (b, a) in zip(found, by_scipy(kind, KINDS[kind]), strict=True):
        b, a = (np.append(values, np.zeros(3 - len(values))) for values in (b, a))
        np.testing.assert_allclose(section, [*b, *a], rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize('kind', KINDS)
def test_the_center_is_that_of_the_analog_filter(kind):
    """The bilinear transform is exact at the frequency of each filter."""
    for number, (w, numerator, denominator) in enumerate(analog(kind, KINDS[kind])):
        one = {name: (value[number],) for name, value in KINDS[kind].items()}
        expected = np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)
        np.testing.assert_allclose(filters(one).response([w / (2.0 * np.pi)]), expected, rtol=1e-9)


def test_a_resonant_filter_adds_its_gain_and_phase_at_the_center():
    found = filters({'resonant.frequencies': (1800.0,), 'resonant.gains': (2.0,), 'resonant.phases': (30.0,)})
    np.testing.assert_allclose(found.response([1800.0]), 1.0 + 2.0 * np.exp(1j * np.pi / 6.0), rtol=1e-9)


@pytest.mark.parametrize('values', [*KINDS.values(), SECTIONS, EVERY])
def test_the_chain_against_scipy(values):
    block = filters(values)
    inputs = np.random.default_rng(1).normal(size=500)
    found = [block.step(value) for value in inputs.tolist()]
    np.testing.assert_allclose(found, signal.sosfilt(block.sos, inputs), rtol=0.0, atol=1e-9 * np.abs(found).max())
    frequencies = np.geomspace(10.0, 0.5 / T, 100)
    _, expected = signal.sosfreqz(block.sos, frequencies, fs=1.0 / T)
    np.testing.assert_allclose(block.response(frequencies), expected, rtol=1e-8, atol=1e-12)


def test_one_value_serves_all_filters():
    many = filters({'notch.frequencies': (5000.0, 6000.0), 'notch.dampings': (0.2,), 'notch.depths': (12.0,)})
    each = filters({'notch.frequencies': (5000.0, 6000.0), 'notch.dampings': (0.2, 0.2), 'notch.depths': (12.0, 12.0)})
    np.testing.assert_array_equal(many.sos, each.sos)


@pytest.mark.parametrize(
    ('values', 'name'),
    [
        ({'notch.frequencies': (1.0, 2.0, 3.0), 'notch.dampings': (0.1, 0.2)}, 'notch.dampings'),
        ({'notch.frequencies': (1.0,), 'notch.dampings': ()}, 'notch.dampings'),
        ({'notch.frequencies': (0.0,)}, 'notch.frequencies'),
        ({'lead.frequencies': (100.0,), 'lead.phases': (90.0,)}, 'lead.phases'),
        ({'sections': (1.0, 0.0, 0.0, 1.0, 0.0)}, 'sections'),
        ({'sections': (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)}, 'sections'),
        ({'sections': (1.0, 0.0, 0.0, 2.0, 0.0, 0.0)}, 'sections'),
        ({'fade_time': -1.0}, 'fade_time'),
    ],
)
def test_invalid_parameters(values, name):
    with pytest.raises(ParameterError, match=name):
        from_mapping(FilterParameters, values)


def test_frequencies_are_below_the_nyquist_frequency_of_the_updates():
    values = from_mapping(FilterParameters, {'notch.frequencies': (7847.0,)})
    with pytest.raises(ParameterError, match=r'dsp\.filters\.notch\.frequencies.*below the Nyquist .*, 5000 Hz'):
        Dsp(DspParameters(filters=values), 1e-4)
    assert Dsp(DspParameters(filters=values, updates_per_sample=2), 1e-4).filters.sample_time == 5e-5


def test_without_filters_each_value_passes():
    block = filters({})
    assert [block.step(value) for value in (0.3, -1.0)] == [0.3, -1.0]
    assert block.is_idle
    assert not filters(NOTCH).is_idle


CHANGES = {
    'changed': (NOTCH, {**NOTCH, 'notch.frequencies': (5000.0, 6000.0, 7000.0)}),
    'added': (NOTCH, EVERY),
    'removed': (EVERY, NOTCH),
    'first': ({}, NOTCH),
    'last': (NOTCH, {}),
    'another gain at 0 Hz': ({}, {'sections': (0.5, 0.0, 0.0, 1.0, 0.0, 0.0)}),
}


@pytest.mark.parametrize('change', CHANGES)
def test_a_change_makes_no_bump_in_a_constant_output(change):
    before, after = CHANGES[change]
    block = filters(before)
    for _ in range(4000):
        last = block.step(1.0)
    block.update(from_mapping(FilterParameters, after))
    found = np.array([block.step(1.0) for _ in range(4000)])
    assert found[0] == pytest.approx(last, abs=1e-9)
    final = abs(block.response([0.0])[0])
    assert found[-1] == pytest.approx(final, abs=1e-6)
    if final == pytest.approx(1.0, abs=1e-9) and last == pytest.approx(1.0, abs=1e-9):
        np.testing.assert_allclose(found, 1.0, atol=1e-9)
    else:
        # The step to the new gain takes the fade time of 20 updates.
        assert np.abs(np.diff(found)).max() < 0.2 * abs(final - last) + 1e-9


@pytest.mark.parametrize('change', CHANGES)
def test_a_change_makes_no_step_in_a_sine(change):
    """The next output is that of the former chain, and after the fade time the output is that of the new one."""
    before, after = CHANGES[change]
    changed, kept, new = filters(before), filters(before), filters(after)
    inputs = np.sin(2.0 * np.pi * 800.0 * T * np.arange(4000))
    for value in inputs[:1001].tolist():
        changed.step(value)
        kept.step(value)
        new.step(value)
    changed.update(from_mapping(FilterParameters, after))
    assert changed.step(inputs[1001]) == pytest.approx(kept.step(inputs[1001]), abs=1e-12)
    new.step(inputs[1001])
    found = [changed.step(value) for value in inputs[1002:].tolist()]
    expected = [new.step(value) for value in inputs[1002:].tolist()]
    np.testing.assert_allclose(found[-500:], expected[-500:], atol=1e-6)
    steps = np.abs(np.diff([changed.step(0.0)] * 2))
    assert steps.max() == 0.0


def test_a_change_during_a_change_makes_no_step():
    block = filters({})
    block.step(1.0)
    for gain in (0.5, 2.0, 0.25):
        last = block.step(1.0)
        block.update(from_mapping(FilterParameters, {'sections': (gain, 0.0, 0.0, 1.0, 0.0, 0.0)}))
        following = [block.step(1.0) for _ in range(5)]
        # The offset that was fading out goes on, 1/20 of it per update.
        assert abs(following[0] - last) < 0.11 * 2.0
        assert np.abs(np.diff(following)).max() < 0.11 * 2.0
    assert [block.step(1.0) for _ in range(30)][-1] == 0.25


def test_without_a_fade_time_a_change_acts_at_once():
    block = filters({'fade_time': 0.0})
    block.step(1.0)
    block.update(from_mapping(FilterParameters, {'fade_time': 0.0, 'sections': (0.5, 0.0, 0.0, 1.0, 0.0, 0.0)}))
    assert block.step(1.0) == 0.5


def test_equal_parameters_change_nothing():
    block = filters(NOTCH)
    block.step(1.0)
    chain = block.chain
    block.update(from_mapping(FilterParameters, NOTCH))
    assert block.chain is chain


def test_compiling_changes_no_bit():
    compiled, plain = filters(EVERY), filters(EVERY)
    for step, value in enumerate(np.random.default_rng(3).normal(size=200).tolist()):
        if step == 100:
            for block in (compiled, plain):
                block.update(from_mapping(FilterParameters, NOTCH))
        assert compiled.step(value) == cast(Any, filters_step).py_func(plain.chain, value)


@pytest.mark.parametrize('count', [1, 2, 4])
@pytest.mark.parametrize('interpolation', ['hold', 'linear'])
def test_the_chain_runs_at_the_rate_of_the_updates(count, interpolation):
    """The controller's voltage is held or interpolated first, then filtered, then limited and rounded."""
    values = from_mapping(FilterParameters, {'notch.frequencies': (3000.0,), 'low_pass.frequencies': (4000.0,)})
    plain = DspParameters(updates_per_sample=count, interpolation=interpolation)
    dsp, unfiltered = (
        Dsp(DspParameters(dac_bits=10, dac_range=1.0, filters=values, **vars_of(plain)), 1e-4),
        Dsp(plain, 1e-4),
    )
    commands = np.random.default_rng(4).normal(scale=0.5, size=300).tolist()
    found = np.array([dsp.voltages(dsp.step(u, u, u)[0]) for u in commands]).ravel()
    staircase = np.array([unfiltered.voltages(unfiltered.step(u, u, u)[0]) for u in commands]).ravel()
    expected = signal.sosfilt(dsp.filters.sos, staircase)
    step = 1.0 / 512.0
    np.testing.assert_allclose(found, np.clip(np.floor(expected / step + 0.5), -512, 511) * step, atol=1e-12)


def vars_of(dsp):
    return {'updates_per_sample': dsp.updates_per_sample, 'interpolation': dsp.interpolation}


def test_the_voltage_before_saturation_is_that_of_the_chain():
    gain = from_mapping(FilterParameters, {'sections': (2.0, 0.0, 0.0, 1.0, 0.0, 0.0)})
    dsp = Dsp(DspParameters(filters=gain), 1e-4, drive_limit=1.0)
    assert dsp.step(0.75, 1.0, 0.5) == (1.0, 1.75, 0.5)
    assert dsp.saturated_samples == 1


def test_filters_added_to_a_dsp_make_no_bump():
    dsp = Dsp(DspParameters(), 1e-4)
    for _ in range(3):
        dsp.step(0.7, 0.7, 0.7)
    dsp.update(DspParameters(filters=from_mapping(FilterParameters, {'notch.frequencies': (3000.0,)})))
    found = [dsp.step(0.7, 0.7, 0.7)[0] for _ in range(50)]
    np.testing.assert_allclose(found, 0.7, atol=1e-12)
    dsp.update(DspParameters())
    assert [dsp.step(0.7, 0.7, 0.7)[0] for _ in range(50)] == pytest.approx([0.7] * 50, abs=1e-12)
