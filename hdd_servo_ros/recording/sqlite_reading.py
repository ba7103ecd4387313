"""An sqlite3 file opened so that reading changes nothing, and needs no right to write beside it."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

_WRITE_AHEAD = 2
"""What the head of a file says whose changes go to a log first, the mode WAL: bytes 18 and 19."""
_READ_VERSION = 19


@contextlib.contextmanager
def database_to_read(path: Path) -> Iterator[str]:
    """
    Yield the address by which `sqlite3.connect` opens a database for reading.

    In the mode WAL, SQLite makes files beside the database even to read it, which fails on a read-only mount. Where
    there is no log, the database is all there is, and is opened as one that nobody changes; where there is one, a copy
    of both is opened.

    Parameters
    ----------
    path
        The database.

    Raises
    ------
    OSError
        If it cannot be read.
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
