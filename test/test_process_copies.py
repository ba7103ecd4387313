"""Runs as copies of one prepared process: the same bits, and the same exit codes, logs and signals as any process."""

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from hdd_servo_ros.campaign.case import parameter_file
from hdd_servo_ros.campaign.start import run_arguments, start_run
from hdd_servo_ros.messages.outcome import FINISHED, INTERRUPTED
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.recording.run_folder import read_run_yaml
from test.conftest import with_package
from test.process_copies import Copies

LONG = 100.0
"""For all that is waited for [s]."""


@pytest.fixture(scope='module')
def server():
    made = Copies(with_package(os.environ))
    yield made
    made.close()


def arguments(directory, duration=0.2, **values):
    given = {'duration': duration, **values}
    return run_arguments([parameter_file('seagate_7200_10.yaml')], given, directory)


def start(server, of_simulate, log):
    """Start a run of `simulate` as a copy."""
    request = {'arguments': ['-m', 'hdd_servo_ros.simulation.simulate', *of_simulate], 'log': str(log), 'errors': None}
    return server.request({**request, 'directory': str(log.parent), 'environment': with_package(os.environ)})


def wait_for_bag(directory):
    deadline = time.monotonic() + LONG
    while not any(file.stat().st_size > 1e6 for file in directory.glob('bag/*')):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_the_same_bits_as_in_a_process_of_its_own(server, tmp_path):
    """Also in the second run of a server, and with another controller before it."""
    runs = {
        name: start(server, arguments(tmp_path / name, controller=controller), tmp_path / f'{name}.log')
        for name, controller in (('pid', 'pid'), ('first', 'adaptive_nn'), ('second', 'adaptive_nn'))
    }
    assert {name: run.wait(LONG) for name, run in runs.items()} == dict.fromkeys(runs, 0)
    process = start_run(arguments(tmp_path / 'own'), without_ros=True, stdout=subprocess.PIPE, text=True)
    said, _ = process.communicate(timeout=LONG)
    assert process.returncode == 0, said
    for name in ('first', 'second'):
        assert compare_bags([str(tmp_path / 'own'), str(tmp_path / name)]) == 0
        assert read_run_yaml(tmp_path / name)['status'] == FINISHED
        summary = (tmp_path / f'{name}.log').read_text()
        assert 'tracking error' in summary
        assert lines(summary) == lines(said)


def lines(text):
    """Return the summary but for what differs from run to run."""
    kept = ('run  finished', 'tracking error', 'peak control', 'estimates', 'messages')
    return [line.strip() for line in text.splitlines() if line.strip().startswith(kept)]


def test_a_rejected_run_has_its_exit_code_and_says_why_in_its_log(server, tmp_path):
    log = tmp_path / 'log'
    run = start(server, [*arguments(tmp_path / 'run'), '-p', 'ldv_sensor:adc_bits:=-3'], log)
    assert run.wait(LONG) == 2
    assert run.poll() == 2
    assert 'ldv_sensor:adc_bits' in log.read_text()
    assert not (tmp_path / 'run').exists()


def test_a_run_that_is_asked_to_end_closes_its_bag(server, tmp_path):
    run = start(server, arguments(tmp_path / 'run', duration=1000.0), tmp_path / 'log')
    wait_for_bag(tmp_path / 'run')
    assert run.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        run.wait(0.01)
    run.terminate()
    assert run.wait(LONG) == 128 + signal.SIGTERM
    assert read_run_yaml(tmp_path / 'run')['status'] == INTERRUPTED
    run.terminate()


def test_a_killed_run_leaves_the_others_alone(server, tmp_path):
    doomed = start(server, arguments(tmp_path / 'doomed', duration=1000.0), tmp_path / 'doomed.log')
    other = start(server, arguments(tmp_path / 'other'), tmp_path / 'other.log')
    doomed.kill()
    assert doomed.wait(LONG) == -signal.SIGKILL
    assert other.wait(LONG) == 0


def test_the_end_of_the_server_ends_its_runs(tmp_path):
    server = Copies(with_package(os.environ))
    run = start(server, arguments(tmp_path / 'run', duration=1000.0), tmp_path / 'log')
    wait_for_bag(tmp_path / 'run')
    server.close()
    assert not Path(f'/proc/{run.pid}').exists()
    assert read_run_yaml(tmp_path / 'run')['status'] == INTERRUPTED


def test_a_server_that_was_killed_is_told_of():
    server = Copies(with_package(os.environ))
    os.kill(server.pid, signal.SIGKILL)
    with pytest.raises(OSError, match=r'the process that is copied has ended with exit code -9'):
        server.read(LONG)
    server.close()


def test_the_log_is_there_before_the_run_has_opened_it(tmp_path):
    """A server that never starts the run shows what is there until one does."""
    server = Copies(with_package(os.environ))
    os.kill(server.pid, signal.SIGKILL)
    with pytest.raises(OSError, match=r'has ended with exit code -9|Broken pipe'):
        start(server, arguments(tmp_path / 'run'), tmp_path / 'log')
    with contextlib.suppress(BrokenPipeError):  # the request is still to be written
        server.close()
    assert (tmp_path / 'log').read_bytes() == b''


def test_a_run_may_end_before_its_start_is_read(server, tmp_path, monkeypatch):
    read = Copies.read

    def late(self, timeout):
        time.sleep(1.0)
        read(self, timeout)

    monkeypatch.setattr(Copies, 'read', late)
    rejected = [start(server, ['--ros-args', '-p', 'no_such:=1'], tmp_path / f'{number}.log') for number in range(2)]
    assert [run.wait(LONG) for run in rejected] == [2, 2]
