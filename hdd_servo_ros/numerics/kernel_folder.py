"""The folder in which compiled kernels are kept between runs."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numba

PACKAGE = Path(__file__).parent.parent

_SOURCES = (
    'bench',
    'control',
    'disturbance',
    'drive',
    'messages/controller_inputs.py',
    'numerics',
    'signals',
    'simulation',
)
"""
What compiled code depends on: each folder with a kernel as a whole, since kernels take constants from the files beside
them, and sources without a kernel whose types kernels take. A test compares this with the sources.
"""


@cache
def kernel_cache_directory() -> Path:
    """
    Return the writable folder in which compiled kernels are kept between runs.

    Numba keys a cached kernel by its own file only: a kernel that calls into another file would go stale unseen when
    that file changes. The folder's name therefore carries a digest of the sources. It carries no path: all copies of
    the package with the same sources share the folder. It lies in the user's cache, not beside the sources, so that a
    read-only install starts warm as well.

    Raises
    ------
    OSError
        If no folder can be written to.
    """
    name = f'numba-{numba.__version__}-{sources_digest(PACKAGE)}'
    for base in _bases():
        try:
            base.mkdir(parents=True, exist_ok=True, mode=0o700)
            (base / name).mkdir(exist_ok=True)
        except OSError:
            continue
        # Compiled code is run as it is found, so a folder that somebody else could have prepared will not do.
        if os.access(base / name, os.W_OK) and base.stat().st_uid == os.getuid():
            return base / name
    raise OSError('no writable folder for compiled kernels: set XDG_CACHE_HOME to one')


def sources_digest(package: Path) -> str:
    """Return a digest of all sources of a copy of the package on which compiled code depends, in 16 hex digits."""
    digest = hashlib.sha256()
    for name in _SOURCES:
        for source in sorted((package / name).rglob('*.py')) if '.' not in name else [package / name]:
            digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def _bases() -> Iterator[Path]:
    # The specification has relative ones ignored.
    given = Path(os.environ.get('XDG_CACHE_HOME', ''))
    if given.is_absolute():
        yield given / 'hdd_servo_ros'
    with contextlib.suppress(RuntimeError):  # no home
        yield Path.home() / '.cache' / 'hdd_servo_ros'
    yield Path(tempfile.gettempdir()) / f'hdd_servo_ros-{os.getuid()}'


def first_compilation() -> bool:
    """Return whether nothing has been compiled yet, so that the next steps take a while."""
    return next(kernel_cache_directory().glob('*.nbi'), None) is None
