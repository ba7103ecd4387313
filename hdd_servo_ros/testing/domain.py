"""A ROS domain for one test."""

import contextlib
import fcntl
import os
import tempfile
from pathlib import Path
from typing import IO

_DOMAINS = range(1, 101)


def take_domain() -> tuple[int, IO[str]]:
    """
    Return a ROS domain that no other test on this machine uses, and an open file that reserves it until it is closed.

    Raises
    ------
    RuntimeError
        If every domain is in use.
    """
    # Not always the lowest: the remains of a killed process in one domain should not affect every test.
    start = os.getpid()
    for domain in (_DOMAINS[(start + i) % len(_DOMAINS)] for i in range(len(_DOMAINS))):
        # OSError: another test has it, perhaps one of another user.
        with contextlib.suppress(OSError):
            lock = (Path(tempfile.gettempdir()) / f'hdd_servo_ros-test-domain-{domain}').open('w')
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return domain, lock
    raise RuntimeError('every ROS domain is in use by another test')
