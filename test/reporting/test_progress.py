"""The progress of a run on standard error, or what is left of it."""

import sys

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
