"""A ROS domain for one test alone."""

import contextlib
import fcntl
import os
import tempfile
from pathlib import Path
from typing import IO

_DOMAINS = range(1, 101)


def take_domain() -> tuple[int, IO[str]]:
    """
    Return a ROS domain that no other test of this machine uses, and the open file that keeps it until it is closed.

    Raises
    ------
    RuntimeError
        If all are taken.
    """
    # Not always the lowest: what a killed process leaves behind in one domain should not meet every test.
    start = os.getpid()
    for domain in (_DOMAINS[(start + i) % len(_DOMAINS)] for i in range(len(_DOMAINS))):
        # An OSError says that another test has it, perhaps another user's.
        with contextlib.suppress(OSError):
            lock = (Path(tempfile.gettempdir()) / f'hdd_servo_ros-test-domain-{domain}').open('w')
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return domain, lock
    raise RuntimeError('every ROS domain is taken by another test')
