import math

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.bench.response import FrequencyResponse, held, read_csv


def measured(count=5, averages=4):
    frequency = np.geomspace(10.0, 1e4, count)
    response = np.asarray(40.0 / (1.0 + 1j * frequency / 100.0), dtype=np.complex128)
    ones = np.ones(count)
    return FrequencyResponse(
        frequency,
        response,
        0.99 * ones,
        0.1 * ones,
        np.full(count, averages, dtype=np.int64),
        frequency > 500.0,
        hold=1e-5,
    )


def test_a_written_csv_is_read_back(tmp_path):
    path = tmp_path / 'response.csv'
    written = measured()
    written.write_csv(path)
    assert path.read_text().splitlines()[0] == (
        'frequency [Hz],magnitude [um/V],phase [deg],coherence,amplitude [V],averages,hold [s],output'
    )
    read = read_csv(path)
    np.testing.assert_array_equal(read.frequency, written.frequency)
    np.testing.assert_allclose(read.response, written.response, rtol=1e-15)
    np.testing.assert_array_equal(read.coherence, written.coherence)
    np.testing.assert_array_equal(read.amplitude, written.amplitude)
    np.testing.assert_array_equal(read.averages, written.averages)
    np.testing.assert_array_equal(read.by_velocity, [False, False, False, True, True])
    assert read.hold == 1e-5


@pytest.mark.parametrize(
    'text',
    [
        '# from some other analyzer\n100,2,90\n200,1,-90\n',
        'Phase (rad),Freq [kHz],Mag [dB],remark\n'
        f'{-math.pi / 2},0.2,0,last\n{math.pi / 2},0.1,{20 * math.log10(2)},first\n',
        f'Frequency (KHZ);Magnitude (db);Phase (degrees)\n0.1;{20 * math.log10(2)};90\n0.2;0;-90\n',
        '100\t2\t90\n200\t1\t-90\n',
        f'frequency [rad/s], gain, phase\n{200 * math.pi}, 2, 90\n{400 * math.pi}, 1, -90\n',
    ],
)
def test_other_csvs(tmp_path, text):
    path = tmp_path / 'other.csv'
    path.write_text(text)
    read = read_csv(path)
    np.testing.assert_allclose(read.frequency, [100.0, 200.0])
    np.testing.assert_allclose(read.response, [2j, -1j], atol=1e-12)
    assert read.relative_deviation() is None
    assert read.hold == 0.0


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'no row of numbers'),
        ('frequency [Hz],magnitude\n1,2\n', "no column 'phase'"),
        ('frequency [min],magnitude,phase\n1,2,3\n', "invalid unit of frequency: 'min'"),
        ('1,2,3\n2,x,3\n', "line 2: invalid magnitude: 'x'"),
        ('1,2,3\n2,1\n', "line 2: invalid phase: ''"),
        ('1,2,3\n# again\n1,2,3\n', 'line 3: duplicate frequency 1, already in line 1'),
        ('2,2,3\n0,2,3\n', 'line 2: invalid frequency: 0; expected above 0'),
        ('1,-20,3\n', 'line 1: invalid magnitude: -20; expected above 0; a magnitude in dB needs the unit [dB]'),
        ('1;0,5;3\n', "line 1: invalid magnitude: '0,5'"),
    ],
)
def test_a_bad_csv_is_rejected_by_name(tmp_path, text, message):
    path = tmp_path / 'bad.csv'
    path.write_text(text)
    with pytest.raises(ValueError, match=r'bad\.csv') as rejected:
        read_csv(path)
    assert message in str(rejected.value)


@pytest.mark.parametrize(
    ('title', 'unit'),
    [
        ('gain [um/V]', 'um/V'),
        ('Magnitude (dB)', ''),
        ('mag [dB re 1 m/N]', '1 m/N'),
        ('gain [dB, nm/V]', 'nm/V'),
        ('gain', ''),
    ],
)
def test_the_unit_of_the_response_is_kept(tmp_path, title, unit):
    path = tmp_path / 'response.csv'
    path.write_text(f'frequency,"{title}",phase\n1,2,3\n')
    read = read_csv(path)
    assert read.unit == unit
    assert abs(read.response[0]) == pytest.approx(10.0**0.1 if 'dB' in title else 2.0)
    read.write_csv(path)
    assert read_csv(path).unit == unit


def test_a_file_that_is_not_text_is_rejected_by_name(tmp_path):
    path = tmp_path / 'bad.csv'
    path.write_bytes(b'frequency,\xbf\n')
    with pytest.raises(ValueError, match=r'bad\.csv is not a CSV file'):
        read_csv(path)


def test_between():
    part = measured().between(50.0, 2000.0)
    assert part.frequency.min() >= 50.0
    assert part.frequency.max() <= 2000.0
    assert len(part.response) == len(part.coherence) == len(part.averages) == len(part.frequency) == 3


def test_the_deviation_from_the_coherence_is_that_of_repeated_measurements():
    """4000 points of the same true response: their spread agrees with the mean coherence."""
    rng = np.random.default_rng(3)
    points, averages, noise = 4000, 16, 0.2
    records = 1.0 + noise * (rng.normal(size=(points, averages)) + 1j * rng.normal(size=(points, averages)))
    mean = records.mean(axis=1)
    coherence = averages * np.abs(mean) ** 2 / np.sum(np.abs(records) ** 2, axis=1)
    found = FrequencyResponse(
        np.arange(1.0, points + 1),
        mean,
        coherence,
        np.ones(points),
        np.full(points, averages, dtype=np.int64),
        np.zeros(points, dtype=bool),
    ).relative_deviation()
    assert found is not None
    assert np.sqrt(np.mean(found**2)) == pytest.approx(np.std(mean), rel=0.05)


def test_the_hold_is_that_of_a_sampled_system():
    """A second-order low pass far below half the sampling rate: scipy's discrete system over the continuous one."""
    sample_time, low_pass = 1e-4, ([1e6], [1.0, 800.0, 1e6])
    frequency = np.array([5.0, 50.0, 300.0])
    numerator, denominator, _ = signal.cont2discrete(low_pass, sample_time)
    _, discrete = signal.freqz(numerator[0], denominator, 2.0 * np.pi * frequency * sample_time)
    _, continuous = signal.freqs(*low_pass, 2.0 * np.pi * frequency)
    np.testing.assert_allclose(discrete / continuous, held(frequency, sample_time), rtol=5e-4)
    np.testing.assert_allclose(
        held(frequency, sample_time, 2e-4), held(frequency, sample_time) * np.exp(-2j * np.pi * frequency * 2e-4)
    )
