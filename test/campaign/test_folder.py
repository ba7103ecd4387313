"""The lock of a folder is that of one process: those that it forks do not hold it."""

import os

import pytest

from hdd_servo_ros.campaign.folder import StudyError, alone_in


def test_a_forked_process_does_not_hold_the_lock(tmp_path):
    ready, end = os.pipe(), os.pipe()
    with alone_in(tmp_path):
        pid = os.fork()
        if pid == 0:
            os.close(end[1])
            os.write(ready[1], b'.')
            os.read(end[0], 1)
            os._exit(0)
        os.read(ready[0], 1)
        with pytest.raises(StudyError, match='another study is running'), alone_in(tmp_path):
            pass
    try:
        # The process is still there.
        assert os.waitpid(pid, os.WNOHANG) == (0, 0)
        with alone_in(tmp_path):
            pass
    finally:
        for descriptor in (end[1], end[0], *ready):
            os.close(descriptor)
        os.waitpid(pid, 0)
