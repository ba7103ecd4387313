"""Repeatable runout against its Fourier coefficients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

ON = {'runout.repeatable.enabled': True}
PRESETS = [(84, 99206e-9), (220, 37879e-9), (420, 19841e-9)]


def generator(sample_time, values):
    return DisturbanceGenerator(from_mapping(DisturbanceParameters, {**ON, **values}), sample_time)


def track_center(sample_time, values, count):
    return generator(sample_time, values).rows(0, count)[0][:, 1]


@pytest.mark.parametrize(('sectors', 'sample_time'), PRESETS)
def test_harmonics_are_the_fourier_coefficients_of_a_revolution(sectors, sample_time):
    values = {
        'runout.repeatable.orders': (1, 3, 17),
        'runout.repeatable.amplitudes': (0.038, 0.0076, 0.0015),
        'runout.repeatable.phases': (0.0, 0.25, 0.4),
        'spindle.sectors': sectors,
    }
    found = track_center(sample_time, values, 3 * sectors)
    # Exactly the same in every revolution.
    assert found[:sectors].tobytes() == found[sectors : 2 * sectors].tobytes() == found[2 * sectors :].tobytes()
    coefficients = np.fft.rfft(found[:sectors]) / sectors * 2.0
    expected = np.zeros(len(coefficients), complex)
    for order, amplitude, phase in ((1, 0.038, 0.0), (3, 0.0076, 0.25), (17, 0.0015, 0.4)):
        expected[order] = -1j * amplitude * np.exp(2j * np.pi * phase)
    assert np.abs(coefficients - expected).max() < 1e-15


def test_without_sectors_the_harmonics_turn_with_the_spindle():
    values = {
        'runout.repeatable.orders': (2,),
        'runout.repeatable.amplitudes': (1.0,),
        'runout.repeatable.phases': (0.1,),
        'spindle.revolutions_per_minute': 5400.0,
    }
    ticks = np.arange(2000)
    expected = np.sin(2.0 * np.pi * (2.0 * 90.0 * 1e-4 * ticks + 0.1))
    assert track_center(1e-4, values, 2000) == pytest.approx(expected, abs=1e-10)


def test_phases_by_seed_belong_to_their_harmonic():
    def alone(order, seed):
        values = {'runout.repeatable.orders': (order,), 'runout.repeatable.amplitudes': (0.01,)}
        return track_center(1e-4, {**values, 'runout.repeatable.seed': seed}, 500)

    both = {'runout.repeatable.orders': (1, 5), 'runout.repeatable.amplitudes': (0.01, 0.01)}
    assert track_center(1e-4, both, 500) == pytest.approx(alone(1, 1) + alone(5, 1), abs=1e-15)
    assert not np.allclose(alone(1, 1), alone(1, 2))


@settings(max_examples=20)
@given(st.sampled_from(PRESETS), st.integers(0, 2**53), st.floats(1.0, 200.0), st.floats(1e-4, 1.0))
def test_a_random_sequence_has_exactly_its_sigma_and_repeats(preset, seed, cutoff, sigma):
    sectors, sample_time = preset
    values = {
        'runout.repeatable.amplitudes': (0.0, 0.0, 0.0),
        'runout.repeatable.sequence': 'random',
        'runout.repeatable.sequence_sigma': sigma,
        'runout.repeatable.sequence_cutoff': cutoff,
        'runout.repeatable.seed': seed,
        'spindle.sectors': sectors,
    }
    found = track_center(sample_time, values, 2 * sectors)
    assert found[:sectors].tobytes() == found[sectors:].tobytes()
    assert found[:sectors].std() == pytest.approx(sigma, rel=1e-12)
    assert abs(found[:sectors].mean()) < 1e-13 * sigma


def test_the_spectrum_of_the_random_sequence_is_that_of_the_low_pass():
    sectors, cutoff = 220, 20.0
    power = np.zeros(sectors // 2 + 1)
    for seed in range(400):
        values = {
            'runout.repeatable.amplitudes': (0.0, 0.0, 0.0),
            'runout.repeatable.sequence': 'random',
            'runout.repeatable.sequence_cutoff': cutoff,
            'runout.repeatable.seed': seed,
            'spindle.sectors': sectors,
        }
        power += np.abs(np.fft.rfft(track_center(37879e-9, values, sectors))) ** 2
    orders = np.arange(1, sectors // 2)
    # |1 - d|^2/|1 - d exp(-i w)|^2 with d such that it is 1/2 at the cutoff.
    half = 2.0 - np.cos(2.0 * np.pi * cutoff / sectors)
    decay = half - np.sqrt(half**2 - 1.0)
    expected = 1.0 / np.abs(1.0 - decay * np.exp(-2j * np.pi * orders / sectors)) ** 2
    assert expected[19] / (1.0 / (1.0 - decay) ** 2) == pytest.approx(0.5, rel=1e-9)
    ratio = power[1:-1] / power[1:-1].sum() * expected.sum() / expected
    # Each is a mean of 400 squares of pairs of normal deviates: 5 % standard deviation.
    assert np.abs(ratio - 1.0).max() < 0.2
    assert ratio.std() < 0.07


def test_a_sequence_from_a_file(tmp_path):
    file = tmp_path / 'sequence.csv'
    sequence = np.random.default_rng(1).normal(size=84)
    file.write_text('displacement [um]\n' + '\n'.join(map(repr, sequence.tolist())))
    values = {
        'runout.repeatable.amplitudes': (0.0, 0.0, 0.0),
        'runout.repeatable.sequence': 'file',
        'runout.repeatable.sequence_file': str(file),
        'spindle.sectors': 84,
    }
    assert track_center(99206e-9, values, 168).tolist() == [*sequence, *sequence]
    with pytest.raises(ParameterError, match='220 rows, one per sector; it has 84'):
        generator(37879e-9, {**values, 'spindle.sectors': 220})
    # Read once: a change during a run needs no file.
    block = generator(99206e-9, values)
    file.unlink()
    block.update(from_mapping(DisturbanceParameters, {**ON, **values, 'flutter.enabled': True}))
    block.update(from_mapping(DisturbanceParameters, {**ON, **values}))
    assert block.rows(0, 84)[0][:, 1].tolist() == sequence.tolist()


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        (
            {'runout.repeatable.sequence': 'random'},
            r'spindle\.sectors: 0; expected a whole .* runout\.repeatable\.sequence = ran',
        ),
        ({'runout.repeatable.sequence': 'file'}, r'sequence_file'),
        ({'runout.repeatable.amplitudes': (1.0,)}, '3 elements, as many as orders'),
        ({'runout.repeatable.phases': (1.0,)}, 'an empty list or 3 elements, as many as orders'),
        ({'runout.repeatable.orders': (0, 1, 2)}, 'at least 1'),
    ],
)
def test_invalid_parameters_are_rejected(values, reason):
    with pytest.raises(ParameterError, match=reason):
        generator(1e-4, values)


def test_a_sequence_that_is_off_needs_no_sectors():
    values = {'runout.repeatable.sequence': 'random', 'runout.repeatable.enabled': False}
    assert not track_center(1e-4, values, 10).any()
