"""The directory of a study or campaign, which only one process may use at a time."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from hdd_servo_ros.messages import exit_codes
from hdd_servo_ros.parameters.files import ArgumentError


class StudyError(RuntimeError):
    """A study or a campaign that cannot continue; the message has the case and the reason."""

    exit_code = exit_codes.FAILED


def make_folder(directory: Path) -> None:
    """Create a directory if it is missing; raises :class:`ArgumentError` if that fails."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArgumentError(f'{directory} is a file, not a directory; choose another with --output') from None
    except OSError as error:
        raise ArgumentError(
            f'cannot create directory {directory}: {error.strerror}; choose another with --output'
        ) from None


@contextlib.contextmanager
def alone_in(directory: Path) -> Iterator[None]:
    """Lock the directory: a second study would take unfinished runs for broken ones."""
    descriptor = os.open(directory, os.O_RDONLY)
    # A forked worker closes its copy: otherwise it would hold the lock even after this process has ended.
    _locks.add(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StudyError(f'another study is running in {directory}') from None
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
