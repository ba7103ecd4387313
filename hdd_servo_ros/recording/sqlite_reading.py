"""Opening of an sqlite3 file for reading, without changes to the file and without write access to its directory."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

_WRITE_AHEAD = 2
"""Value of bytes 18 and 19 in the header of a file in WAL mode, whose changes go to a log first."""
_READ_VERSION = 19


@contextlib.contextmanager
def database_to_read(path: Path) -> Iterator[str]:
    """
    Yield the URI with which `sqlite3.connect` opens a database for reading.

    In WAL mode, SQLite creates files next to the database even for reading, which fails on a read-only mount. Without a
    log, the database is complete and is opened as immutable. With a log, a copy of both is opened.

    Parameters
    ----------
    path
        Path of the database.

    Raises
    ------
    OSError
        If the database cannot be read.
    """
    with path.open('rb') as file:
        head = file.read(_READ_VERSION + 1)
    if len(head) <= _READ_VERSION or head[_READ_VERSION] != _WRITE_AHEAD:
        yield f'{path.resolve().as_uri()}?mode=ro'
        return
    log = path.with_name(f'{path.name}-wal')
    if not log.is_file() or not log.stat().st_size:
        yield f'{path.resolve().as_uri()}?mode=ro&immutable=1'
        return
    with tempfile.TemporaryDirectory() as directory:
        copy = Path(directory) / path.name
        shutil.copyfile(path, copy)
        shutil.copyfile(log, copy.with_name(log.name))
        yield copy.as_uri()
