"""The progress of a run on standard error, or what is left of it."""

import re
import sys
import time

import pytest

from hdd_servo_ros.reporting.progress import Progress


class Gone:
    """A pipe whose reader has ended."""

    def isatty(self):
        return False

    def write(self, text):
        raise BrokenPipeError

    def flush(self):
        raise BrokenPipeError


def test_lines_where_there_is_no_terminal(capsys):
    progress = Progress('run', 100, 0.01)
    for tick in range(101):
        progress.show(tick)
    progress.close()
    assert capsys.readouterr().err.startswith('run 1.00 of 1.00 s, real-time factor ')


@pytest.mark.parametrize('gone_at', [0, 1])
def test_a_reader_that_is_gone_ends_no_run(monkeypatch, gone_at):
    progress = Progress('run', 1, 0.01)
    for tick in range(2):
        if tick == gone_at:
            monkeypatch.setattr(sys, 'stderr', Gone())
        progress.show(tick)
    progress.close()


@pytest.fixture
def clock(monkeypatch):
    """Wall time that goes on when it is told to [s]."""
    now = [100.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    return now


def shown(capsys):
    """Return the last line's real-time factor and what is left [s]."""
    line = capsys.readouterr().err.splitlines()[-1]
    found = re.search(r'real-time factor (\S+), (\S+) s left', line)
    assert found is not None
    factor, left = found.groups()
    return float(factor), float(left)


def test_a_pause_does_not_count(capsys, clock):
    progress = Progress('run', 1000, 0.1)
    for tick in range(200):
        progress.show(tick)
        clock[0] += 0.05
    assert shown(capsys) == (2.0, pytest.approx(45.0, abs=5.0))
    clock[0] += 3600.0
    progress.resume(200)
    for tick in range(201, 500):
        clock[0] += 0.05
        progress.show(tick)
    assert shown(capsys)[0] == 2.0


def test_the_last_seconds_count(capsys, clock):
    """Not those before: a run that has become ten times as fast says so, and so does one that is paced slowly."""
    progress = Progress('run', 100_000, 1e-3)
    progress.show(0)
    for tick, seconds in ((1000, 100.0), (2000, 100.0), (3000, 10.0), (4000, 10.0)):
        clock[0] += seconds
        progress.show(tick)
    factor, left = shown(capsys)
    assert factor == 0.1
    assert left == pytest.approx(960.0)


def test_a_run_may_be_started_by_hand(capsys, clock):
    """It goes on before it has shown anything."""
    progress = Progress('run', 1000, 0.1)
    progress.resume(0)
    for tick in range(200):
        progress.show(tick)
        clock[0] += 0.05
    assert shown(capsys)[0] == 2.0
