"""Directory in which compiled kernels are kept between runs."""

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
Sources on which compiled code depends.

Directories with kernels are listed as a whole, because kernels use constants from neighboring files. Files without a
kernel are listed if kernels use their types. A test compares this list with the sources.
"""


@cache
def kernel_cache_directory() -> Path:
    """
    Return the writable directory in which compiled kernels are kept between runs.

    Numba checks only the source file of a cached kernel, so it would not notice a change in another file that the
    kernel calls into. The name of the directory therefore contains a digest of the sources. It does not contain a path,
    so all copies of the package with the same sources share the directory. The directory is in the user's cache rather
    than next to the sources, so that a read-only installation can use it too.

    Raises
    ------
    OSError
        If no directory is writable.
    """
    name = f'numba-{numba.__version__}-{sources_digest(PACKAGE)}'
    for base in _bases():
        try:
            base.mkdir(parents=True, exist_ok=True, mode=0o700)
            (base / name).mkdir(exist_ok=True)
        except OSError:
            continue
        # The compiled code is executed without a check, so reject a directory that another user may have prepared.
        if os.access(base / name, os.W_OK) and base.stat().st_uid == os.getuid():
            return base / name
    raise OSError('no writable directory for compiled kernels; set XDG_CACHE_HOME to a writable directory')


def sources_digest(package: Path) -> str:
    """Return a digest, in 16 hex digits, of the sources in a copy of the package on which compiled code depends."""
    digest = hashlib.sha256()
    for name in _SOURCES:
        for source in sorted((package / name).rglob('*.py')) if '.' not in name else [package / name]:
            digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def _bases() -> Iterator[Path]:
    # The XDG specification requires that relative paths are ignored.
    given = Path(os.environ.get('XDG_CACHE_HOME', ''))
    if given.is_absolute():
        yield given / 'hdd_servo_ros'
    with contextlib.suppress(RuntimeError):  # no home directory
        yield Path.home() / '.cache' / 'hdd_servo_ros'
    yield Path(tempfile.gettempdir()) / f'hdd_servo_ros-{os.getuid()}'


def first_compilation() -> bool:
    """Return whether no kernel has been compiled yet, so that the first run takes longer."""
    return next(kernel_cache_directory().glob('*.nbi'), None) is None
