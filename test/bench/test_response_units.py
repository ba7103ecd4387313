"""Units and ranges of the columns of a measured response: another unit gives the same response, or is rejected."""

import numpy as np
import pytest

from hdd_servo_ros.bench.response import FrequencyResponse, read_csv

HEAD = 'frequency [Hz],magnitude [um/V],phase [deg]'
ROWS = ((100.0, 2.0, -10.0), (200.0, 1.0, -20.0))


def written(path, title, values, head=HEAD, rows=ROWS):
    lines = [f'{head},{title}']
    lines += [','.join(map(repr, row)) + f',{value}' for row, value in zip(rows, values, strict=True)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf8')
    return path


@pytest.mark.parametrize(
    ('title', 'values', 'attribute', 'expected'),
    [
        ('hold', ('2e-5', '2e-5'), 'hold', 2e-5),
        ('hold [s]', ('2e-5', '2e-5'), 'hold', 2e-5),
        ('Hold [ms]', ('0.02', '0.02'), 'hold', 2e-5),
        ('hold (us)', ('20', '20'), 'hold', 2e-5),
        ('hold [µs]', ('20', '20'), 'hold', 2e-5),
        ('hold [ns]', ('20000', '20000'), 'hold', 2e-5),
        ('coherence', ('0.98', '1'), 'coherence', (0.98, 1.0)),
        ('coherence [%]', ('98', '100'), 'coherence', (0.98, 1.0)),
        ('amplitude [mV]', ('100', '0'), 'amplitude', (0.1, 0.0)),
        ('amplitude [V]', ('0.1', '0'), 'amplitude', (0.1, 0.0)),
        ('averages', ('8', '16'), 'averages', (8, 16)),
        ('output', ('velocity', 'Displacement'), 'by_velocity', (True, False)),
    ],
)
def test_a_unit_is_converted(tmp_path, title, values, attribute, expected):
    found = getattr(read_csv(written(tmp_path / 'response.csv', title, values)), attribute)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ('title', 'values', 'message'),
    [
        ('hold [min]', ('1', '1'), "invalid unit of hold: 'min'; expected one of s, ms, us, µs, ns"),
        ('hold', ('0.02', '0.02'), 'a hold of 0.02 s allows frequencies up to 25 Hz'),
        ('hold', ('-1e-5', '-1e-5'), 'line 2: invalid hold: -1e-05; expected not negative'),
        ('hold', ('1e-5', '2e-5'), 'the hold must be the same in all rows'),
        ('coherence', ('98', '98'), 'line 2: invalid coherence: 98; expected from 0 to 1 (or in [%])'),
        ('coherence [%]', ('98', '101'), 'line 3: invalid coherence: 101'),
        ('coherence', ('-0.1', '1'), 'line 2: invalid coherence: -0.1'),
        ('coherence [dB]', ('-0.1', '0'), "invalid unit of coherence: 'db'"),
        ('averages', ('8', '0'), 'line 3: invalid averages: 0; expected a whole number, at least 1'),
        ('averages', ('2.5', '8'), 'line 2: invalid averages: 2.5'),
        ('averages [s]', ('8', '8'), "invalid unit of averages: 's'"),
        ('amplitude [N]', ('1', '1'), "invalid unit of amplitude: 'n'; expected one of V"),
        ('amplitude', ('-1', '1'), 'line 2: invalid amplitude: -1; expected not negative'),
        ('output', ('velocity', 'speed'), "line 3: invalid output: 'speed'; expected velocity or displacement"),
        ('gain', ('1', '1'), "two columns for magnitude: 'magnitude [um/V]' and 'gain'"),
        ('coherence', ('0', '0.0'), 'coherence is 0 in every row'),
        ('coherence [%]', ('0', '0'), 'coherence is 0 in every row'),
        ('coherence', ('nan', '1'), "line 2: invalid coherence: 'nan'; expected a finite number"),
    ],
)
def test_invalid_columns_are_rejected(tmp_path, title, values, message):
    with pytest.raises(ValueError, match=r'response\.csv') as rejected:
        read_csv(written(tmp_path / 'response.csv', title, values))
    assert message in str(rejected.value)


def plant(rng, count):
    """Return a rigid body or a pivot with up to three lightly damped modes and a delay, and its frequencies [Hz]."""
    lowest = 10.0 ** rng.uniform(0.5, 2.5)
    frequency = np.geomspace(lowest, lowest * 10.0 ** rng.uniform(0.5, 2.5), count)
    s = 2j * np.pi * frequency
    pivot = 2.0 * np.pi * lowest * 10.0 ** rng.uniform(-1.0, 1.0)
    response = 1.0 / (s**2 + 0.2 * pivot * s + (0.0 if rng.random() < 0.5 else pivot**2))
    for _ in range(rng.integers(0, 4)):
        natural = 2.0 * np.pi * lowest * 10.0 ** rng.uniform(0.5, 2.5)
        share = rng.uniform(0.05, 1.0)
        response = response + share / (s**2 + 0.04 * natural * s + natural**2)
    response = response * np.exp(-s * rng.uniform(0.0, 0.2) / frequency[-1])
    noise = 0.02 * (rng.normal(size=count) + 1j * rng.normal(size=count))
    return frequency, response * (1.0 + noise)


def csv_of(path, frequency, magnitude, response, head):
    lines = [] if head is None else [head]
    phase = np.degrees(np.angle(response))
    lines += [
        ','.join(map(repr, row)) for row in zip(frequency.tolist(), magnitude.tolist(), phase.tolist(), strict=True)
    ]
    path.write_text('\n'.join(lines) + '\n')
    return path


def is_rejected(path):
    try:
        read_csv(path)
    except ValueError as error:
        return 'add its unit to the header: [dB]' in str(error)
    return False


@pytest.mark.parametrize('head', [None, 'frequency,magnitude,phase'])
def test_decibels_without_a_unit_are_rejected_by_the_phase(tmp_path, head):
    """All of them positive, so that they could be a linear magnitude."""
    found = wrong = 0
    for seed in range(100):
        frequency, response = plant(np.random.default_rng(seed), 60)
        decibels = 20.0 * np.log10(np.abs(response))
        path = tmp_path / 'response.csv'
        found += is_rejected(csv_of(path, frequency, decibels - decibels.min() + 3.0, response, head))
        wrong += is_rejected(csv_of(path, frequency, np.abs(response), response, head))
    assert found >= 45
    assert wrong <= 1


def test_decibels_of_the_drive_are_rejected(tmp_path):
    frequency = np.geomspace(100.0, 5000.0, 80)
    s = 2j * np.pi * frequency
    response = 4e7 / (s**2 + 200.0 * s + (2.0 * np.pi * 150.0) ** 2)
    decibels = 20.0 * np.log10(np.abs(response))
    assert decibels.max() > 20.0
    assert is_rejected(csv_of(tmp_path / 'r.csv', frequency, decibels - decibels.min() + 1.0, response, None))
    assert not is_rejected(csv_of(tmp_path / 'r.csv', frequency, np.abs(response), response, None))
    labeled = csv_of(tmp_path / 'r.csv', frequency, decibels, response, 'frequency,magnitude [dB],phase')
    np.testing.assert_allclose(read_csv(labeled).response, response, rtol=1e-12)


def test_any_written_response_is_read_back(tmp_path):
    for seed in range(20):
        frequency, response = plant(np.random.default_rng(seed), 40)
        FrequencyResponse.of(frequency, response).write_csv(tmp_path / 'own.csv')
        np.testing.assert_allclose(read_csv(tmp_path / 'own.csv').response, response, rtol=1e-12)


@pytest.mark.parametrize(
    ('unit', 'derivatives', 'expected'),
    [
        ('um/V', 0, 'um/V'),
        ('um/s/V', 1, 'um/V'),
        ('(um/s)/V', 1, 'um/V'),
        ('mm/(s V)', 1, 'mm/V'),
        ('um / s / V', 1, 'um/V'),
        ('um/s', 1, 'um'),
        ('rad/s/A', 1, 'rad/A'),
        ('m/s^2/V', 2, 'm/V'),
        ('m/s²/V', 2, 'm/V'),
        ('(m/s2)/V', 2, 'm/V'),
        ('m/(s^2 V)', 2, 'm/V'),
        ('dB re um/s/V', 1, 'um/V'),
        ('dB re um/V', 0, 'um/V'),
        ('V/V', 0, 'V/V'),
        ('', 0, ''),
    ],
)
def test_a_response_of_velocity_or_acceleration_is_integrated(tmp_path, unit, derivatives, expected):
    frequency = np.geomspace(100.0, 5000.0, 40)
    s = 2j * np.pi * frequency
    response = 4e7 / (s**2 + 200.0 * s + (2.0 * np.pi * 150.0) ** 2)
    given = response * s**derivatives
    magnitude = 20.0 * np.log10(np.abs(given)) if unit.startswith('dB') else np.abs(given)
    path = csv_of(tmp_path / 'r.csv', frequency, magnitude, given, f'frequency [Hz],magnitude [{unit}],phase [deg]')
    found = read_csv(path)
    np.testing.assert_allclose(found.response, response, rtol=1e-9)
    assert found.unit == expected
    assert np.all(found.by_velocity == (derivatives > 0))


@pytest.mark.parametrize('head', [None, 'frequency,magnitude [um/V],phase'])
def test_radians_without_a_unit_are_rejected_by_the_slope(tmp_path, head):
    found = wrong = 0
    path = tmp_path / 'response.csv'
    for seed in range(100):
        frequency, response = plant(np.random.default_rng(seed), 60)
        for turns, unit in ((np.angle(response), 'rad'), (np.degrees(np.angle(response)), 'deg')):
            lines = [] if head is None else [head]
            rows = zip(frequency.tolist(), np.abs(response).tolist(), turns.tolist(), strict=True)
            path.write_text('\n'.join([*lines, *(','.join(map(repr, row)) for row in rows)]) + '\n')
            try:
                read_csv(path)
            except ValueError:
                found += unit == 'rad'
                wrong += unit == 'deg'
    assert found >= 45
    assert wrong <= 1
