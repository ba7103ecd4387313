"""Room kept on the disk for closing a run, and files that are on the disk when a call returns."""

import contextlib
import errno
import os
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Numbers of the errors of a full disk, and of a user who may not write more."""
_NOT_OFFERED = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)
_PIECE = 2**16


class Reserve:
    """
    A file that takes up room, to be given back for what must still be written when the disk is full.

    Parameters
    ----------
    path
        The file; one that is there is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = 0
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)

    @property
    def size(self) -> int:
        """Size [bytes]."""
        return self._size

    def grow(self, size: int) -> None:
        """
        Take up ``size`` bytes, if it is fewer now.

        Raises
        ------
        OSError
            If there is no room.
        """
        if size > self._size:
            allocate(self._file, self._size, size - self._size)
            self._size = size

    def release(self) -> None:
        """Give the room back; does nothing the second time."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)
            with contextlib.suppress(OSError):
                self._path.unlink()


def allocate(file: int, start: int, size: int) -> None:
    """
    Give a file room on the disk, from byte ``start`` on.

    Parameters
    ----------
    file
        Descriptor of the file.
    start, size
        Where the room begins in the file, and how much [bytes].

    Raises
    ------
    OSError
        If there is no room.
    """
    try:
        os.posix_fallocate(file, start, size)
        return
    except AttributeError:
        pass
    except OSError as error:
        if error.errno not in _NOT_OFFERED:
            raise
    # A file system or a system that cannot allocate must be given bytes.
    for offset in range(start, start + size, _PIECE):
        os.pwrite(file, bytes(min(_PIECE, start + size - offset)), offset)


def write_durably(path: Path, text: str, temporary: Path) -> None:
    """
    Write a text so that after a crash or a power failure the file holds either the old text or the new one.

    Parameters
    ----------
    path
        The file.
    text
        Its new content.
    temporary
        File in the same folder that becomes the new one. If it exists, it is written from the start without being cut
        first, so that room that was allocated for it is used.

    Raises
    ------
    OSError
        If it cannot be written; the old text is there then.
    """
    file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        write_all(file, memoryview(text.encode()))
        os.ftruncate(file, len(text.encode()))
        os.fsync(file)
    finally:
        os.close(file)
    temporary.replace(path)
    sync_folder(path.parent)


def write_all(file: int, data: memoryview) -> None:
    """Write all of the data; the system may take them in parts."""
    while data:
        data = data[os.write(file, data) :]


def sync_folder(folder: Path) -> None:
    """Ensure that the names in a folder survive a power failure, where the file system offers that."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
