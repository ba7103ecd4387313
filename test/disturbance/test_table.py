"""CSV files of numbers, and the error messages for invalid files."""

import numpy as np
import pytest

from hdd_servo_ros.disturbance.recording import at_ticks, read_recording
from hdd_servo_ros.disturbance.table import read_table
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.parameters import ParameterError


def written(tmp_path, text):
    file = tmp_path / 'table.csv'
    file.write_text(text, 'utf8')
    return str(file)


@pytest.mark.parametrize(
    'text',
    [
        '0,1\n0.5,-2\n1,3e-1\n',
        'time,acceleration\n0,1\n0.5,-2\n1,0.3\n',
        '\ufefftime [s], a [m/s^2]\r\n\r\n# measured\r\n0, 1\r\n0.5, -2\r\n1, 0.3\r\n',
        '0,1,ignored\n0.5,-2,nan\n1,0.3,9\n',
    ],
)
def test_a_recording_is_read(tmp_path, text):
    path = written(tmp_path, text)
    assert read_recording('recording', path, 'acceleration').tolist() == [[0.0, 1.0], [0.5, -2.0], [1.0, 0.3]]


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', 'at least 2 rows of numbers; it has 0'),
        ('time,a\n', 'at least 2 rows of numbers; it has 0'),
        ('time,a\n0,1\n', 'at least 2 rows of numbers; it has 1'),
        ('0,1\n1,nan\n', "finite numbers; line 2 is '1,nan'"),
        ('0,1\ninf,2\n', "finite numbers; line 2 is 'inf,2'"),
        ('0,1\n1\n', "finite numbers; line 2 is '1'"),
        ('0,1\n1,two\n', "finite numbers; line 2 is '1,two'"),
        ('time,a\n0,1\ntime,a\n', "finite numbers; line 3 is 'time,a'"),
        ('0 1\n1 2\n', "finite numbers; line 2 is '1 2'"),
        ('0,1\n1,2\n1,3\n', 'increasing times; row 3 has 1.0 s after 1.0 s'),
        ('0,1\n1,2\n0.5,3\n', 'increasing times; row 3 has 0.5 s after 1.0 s'),
    ],
)
def test_a_bad_recording_is_rejected_in_one_line(tmp_path, text, reason):
    path = written(tmp_path, text)
    with pytest.raises(ParameterError) as error:
        read_recording('vibration.linear.recording', path, 'acceleration [m/s^2]')
    message = str(error.value)
    assert message.startswith(
        f'invalid value for parameter vibration.linear.recording: {shown(path)}; expected a CSV file'
    )
    assert reason in message
    assert '\n' not in message


def test_a_file_that_is_not_text_is_rejected(tmp_path):
    with pytest.raises(ParameterError, match='No such file'):
        read_table('file', str(tmp_path / 'nothing.csv'), ['x'], 1)
    with pytest.raises(ParameterError, match=r'a CSV file with x; reading failed: .*directory'):
        read_table('file', str(tmp_path), ['x'], 1)
    binary = tmp_path / 'binary.csv'
    binary.write_bytes(b'\xff\xfe\x00\x81')
    with pytest.raises(ParameterError, match='decode'):
        read_table('file', str(binary), ['x'], 1)


@pytest.mark.parametrize('sample_time', [1e-4, 37879e-9, 3e-3])
def test_linear_interpolation_is_that_of_numpy(sample_time):
    rng = np.random.default_rng(3)
    recording = np.column_stack((5.0 + np.cumsum(rng.uniform(1e-4, 2e-3, 200)), rng.normal(size=200)))
    samples = at_ticks(recording, 'linear', sample_time)
    times = recording[0, 0] + sample_time * np.arange(len(samples))
    assert times[-1] <= recording[-1, 0] < times[-1] + sample_time
    assert samples == pytest.approx(np.interp(times, *recording.T), rel=1e-9, abs=1e-9)


def test_held_values_change_at_their_times():
    recording = np.array([[0.0, 1.0], [0.3, 2.0], [0.5, 3.0], [0.9, 4.0]])
    # 0.3 is not a float64 multiple of 0.1, and still counts at its tick.
    assert at_ticks(recording, 'hold', 0.1).tolist() == [1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0, 4.0]
