"""Reserved disk space for closing a run, and durable writing of files."""

import contextlib
import errno
import os
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk and of an exceeded quota."""
_NOT_OFFERED = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)
_PIECE = 2**16


class Reserve:
    """
    File that reserves disk space, released for the files that must still be written when the disk is full.

    Parameters
    ----------
    path
        Path of the file; an existing file is replaced.
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
        Reserve at least ``size`` bytes.

        Raises
        ------
        OSError
            If the disk is full.
        """
        if size > self._size:
            allocate(self._file, self._size, size - self._size)
            self._size = size

    def release(self) -> None:
        """Release the space; a second call has no effect."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)
            with contextlib.suppress(OSError):
                self._path.unlink()


def allocate(file: int, start: int, size: int) -> None:
    """
    Allocate disk space for a file, from byte ``start`` on.

    Parameters
    ----------
    file
        File descriptor.
    start, size
        Offset and size of the space in the file [bytes].

    Raises
    ------
    OSError
        If the disk is full.
    """
    try:
        os.posix_fallocate(file, start, size)
        return
    except AttributeError:
        pass
    except OSError as error:
        if error.errno not in _NOT_OFFERED:
            raise
    # Without support for allocation, zeros are written.
    for offset in range(start, start + size, _PIECE):
        os.pwrite(file, bytes(min(_PIECE, start + size - offset)), offset)


def write_durably(path: Path, text: str, temporary: Path) -> None:
    """
    Write a file so that it contains either the old or the new text after a crash or a power failure.

    Parameters
    ----------
    path
        Path of the file.
    text
        New content.
    temporary
        File in the same directory that is renamed to the new one. If it exists, it is overwritten without truncating it
        first, so that space allocated for it is used.

    Raises
    ------
    OSError
        If the file cannot be written; it then keeps the old text.
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
    """Write all data, in several calls if necessary."""
    while data:
        data = data[os.write(file, data) :]


def sync_folder(folder: Path) -> None:
    """Synchronize the entries of a directory with the disk, if the file system supports it."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
