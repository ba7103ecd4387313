"""The command: what it prints, warns of and rejects."""

import dataclasses
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.identify import main
from hdd_servo_ros.bench.response import FrequencyResponse, held
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import sections_of

BAND = np.geomspace(100.0, 20_000.0, 200)


def drive(frequency):
    """Return the response of the drive of chapter 5 whose rigid body a spring holds at 150 Hz [um/V]."""
    s = 2j * np.pi * frequency
    held_body = s**2 / (s**2 + 280.0 * s + (2.0 * np.pi * 150.0) ** 2)
    return transfer.frequency_response(PlantParameters(), frequency) * held_body


def test_the_command(tmp_path, capsys):
    path = tmp_path / 'response.csv'
    FrequencyResponse.of(BAND, drive(BAND) * held(BAND, 1e-5), hold=1e-5).write_csv(path)
    assert main([str(path), '--poles', '10', '--zeros', '4']) == 0
    printed = capsys.readouterr().out
    assert 'gain of the rigid body 4.0968e+07 um/(V s^2)' in printed
    assert '|residue| [um/V rad/s]' in printed
    rows = [line.split() for line in printed.splitlines() if line[:16].strip().replace('.', '').isdigit()]
    frequencies = [np.sqrt(section.a0) / (2.0 * np.pi) for section in sections_of(PlantParameters().resonance)]
    np.testing.assert_allclose([float(row[0]) for row in rows[1:]], frequencies, rtol=1e-5)
    assert main([str(path), '--poles', '10', '--zeros', '4', '--hold', '0']) == 0
    assert 'gain of the rigid body 4.0968e+07' not in capsys.readouterr().out
    assert main([str(tmp_path / 'none.csv')]) == 3
    capsys.readouterr()


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (['--from', '30000'], '--from 30000 leaves 0 of 40 points from 100 to 20000 Hz, expected at least 2'),
        (['--from', '152', '--to', '155', '--integrators', '2'], '--from 152 --to 155 leaves 0 of 40 points'),
        (
            ['--from', '15000', '--poles', '10'],
            'leaves 3 of 40 points from 100 to 20000 Hz, expected at least 6 for',
        ),
        (['--poles', '60', '--zeros', '60'], ': 40 of 40 points from 100 to 20000 Hz, expected at least 61 for 60'),
    ],
)
def test_too_few_points_are_told(tmp_path, capsys, options, words):
    path = tmp_path / 'response.csv'
    frequency = np.geomspace(100.0, 20_000.0, 40)
    FrequencyResponse.of(frequency, drive(frequency)).write_csv(path)
    assert main([str(path), *options]) == 3
    said = capsys.readouterr().err
    assert said.startswith(f'identify: {path}: ')
    assert words in said


def test_doubts_are_told(tmp_path, capsys):
    """A line each: a gain that is none, modes that are unstable or beyond the points, a residual that is no noise."""
    frequency = np.geomspace(10.0, 1000.0, 60)
    denominator = np.polymul([1.0, -20.0, 1e5], [1.0, 400.0, 1e8])
    _, unstable = signal.freqs([-1e6], denominator, 2.0 * np.pi * frequency)
    measured = FrequencyResponse.of(frequency, unstable)
    measured.write_csv(tmp_path / 'none.csv')
    # A coherence that claims next to nothing: 0.2 % are believed.
    rng = np.random.default_rng(0)
    noise = (rng.normal(size=60) + 1j * rng.normal(size=60)) / np.sqrt(2.0)
    claimed = dataclasses.replace(measured, response=unstable * (1.0 + 0.02 * noise), averages=np.full(60, 8))
    claimed.write_csv(tmp_path / 'claimed.csv')
    order = ['--poles', '4', '--rigid-order', '0']
    assert main([str(tmp_path / 'none.csv'), *order]) == 0
    warnings = [
        'the gain of the rigid body is -1e-07, expected above 0',
        'the mode at 50.3292 Hz is unstable: its damping is -0.0316',
        'the mode at 1591.55 Hz is outside the band of the points, 10 to 1000 Hz',
    ]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(warnings)
    for line, words in zip(lines, warnings, strict=True):
        assert line.startswith(f'identify: warning: {words}')
    assert main([str(tmp_path / 'claimed.csv'), *order]) == 0
    assert re.search(r'warning: the weighted rms error is (9|1[01])(\.\d+)?: ', capsys.readouterr().err)


def test_a_reader_that_has_seen_enough_ends_the_command_quietly(tmp_path):
    path = tmp_path / 'response.csv'
    FrequencyResponse.of(BAND, drive(BAND)).write_csv(path)
    command = [
        sys.executable,
        '-m',
        'hdd_servo_ros.analysis.identify',
        str(path),
        '--poles',
        '10',
        '--zeros',
        '4',
    ]
    reading, writing = os.pipe()
    os.close(reading)
    ended = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=250)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, '')


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (['--poles', '-1'], 'argument --poles: -1 is invalid; expected at least 1'),
        (['--poles', '0'], 'argument --poles: 0 is invalid; expected at least 1'),
        (['--rigid-order', '1'], 'argument --rigid-order: invalid choice: 1 (choose from 2, 0)'),
        (['--from', 'nan'], 'argument --from: nan is not a frequency'),
        (['--from', '3000', '--to', '1000'], '--from 3000 is above --to 1000'),
        (['--zeros', '4'], '--zeros needs --poles'),
        (['--hold', '-1'], 'argument --hold: -1 is not a time'),
        (['--delay', 'nan'], 'argument --delay: nan is not a time'),
        (['--integrators', '3'], '--integrators 3 exceeds --rigid-order 2'),
        (['--method', 'levy'], '--method levy needs --poles'),
    ],
)
def test_options_that_mean_nothing_are_rejected(options, words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(['response.csv', *options])
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
