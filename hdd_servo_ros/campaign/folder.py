"""The folder that many runs are made in: one study or campaign at a time."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from hdd_servo_ros.messages import exit_codes
from hdd_servo_ros.parameters.files import ArgumentError


class StudyError(RuntimeError):
    """A study or a campaign that cannot go on; says which case and why."""

    exit_code = exit_codes.FAILED


def make_folder(directory: Path) -> None:
    """Make a folder, if it is not there; raises :class:`ArgumentError` if it cannot be made."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArgumentError(f'{directory} cannot be a folder: a file stands there; --output says another') from None
    except OSError as error:
        raise ArgumentError(f'{directory} cannot be made: {error.strerror}; --output says another folder') from None


@contextlib.contextmanager
def alone_in(directory: Path) -> Iterator[None]:
    """Keep a second study out of the folder, for it would take the runs that are being made for broken ones."""
    descriptor = os.open(directory, os.O_RDONLY)
    # A worker that is forked meanwhile would hold the lock for as long as it lives, whatever became of this process.
    _locks.add(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StudyError(f'another study is at work in {directory}') from None
    else:
        yield
    finally:
        _locks.discard(descriptor)
        os.close(descriptor)


_locks: set[int] = set()


def _drop_locks() -> None:
    while _locks:
        os.close(_locks.pop())


os.register_at_fork(after_in_child=_drop_locks)
