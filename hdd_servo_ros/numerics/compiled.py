"""The one decorator through which this package compiles its kernels."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config as numba_config

config: Any = numba_config
jit: Any = numba.njit

_TYPES = ('messages/controller_inputs.py',)
"""Sources without a kernel whose types kernels take."""

Function = TypeVar('Function', bound=Callable[..., Any])


@cache
def kernel_cache_directory() -> Path:
    """
    Return the writable folder in which compiled kernels are kept between runs.

    Numba keys a cached kernel by the age of its own file only: a kernel that calls into another file would go stale
    unseen when that file changes. The folder's name therefore carries a digest of the sources (and of their path), and
    the folder lies in the user's cache, not beside the sources, so that a read-only install starts warm as well.
    """
    package = Path(__file__).parent.parent
    # Numba keeps what it compiles by the path of the source as well, so two copies of the package share nothing.
    digest = hashlib.sha256(str(package).encode())
    sources = sorted(package.rglob('*.py'))
    # Kernels take constants from the files beside them, so a folder with a kernel counts as a whole.
    folders = {source.parent for source in sources if b'@compiled' in source.read_bytes()}
    for source in sources:
        path = source.relative_to(package).as_posix()
        if path in _TYPES or any(folder in source.parents for folder in folders):
            digest.update(path.encode() + source.read_bytes())
    name = f'numba-{numba.__version__}-{digest.hexdigest()[:16]}'
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


def _bases() -> Iterator[Path]:
    if os.environ.get('XDG_CACHE_HOME'):
        yield Path(os.environ['XDG_CACHE_HOME']) / 'hdd_servo_ros'
    with contextlib.suppress(RuntimeError):  # no home
        yield Path.home() / '.cache' / 'hdd_servo_ros'
    yield Path(tempfile.gettempdir()) / f'hdd_servo_ros-{os.getuid()}'


def first_compilation() -> bool:
    """Return whether nothing has been compiled yet, so that the next steps take a while."""
    return next(kernel_cache_directory().rglob('*.nbi'), None) is None


def compiled(function: Function) -> Function:
    """
    Compile a scalar kernel ahead of its first call in later runs.

    No ``fastmath`` and no fused operations: every addition and multiplication is rounded as IEEE 754 says, so the bits
    do not depend on the machine. Division by zero gives an infinity, as in numpy, and is caught where values enter.

    A kernel allocates nothing, so references to its arrays are not counted (``_nrt``): with six arrays that would cost
    60 ns per step. One that makes an array does not compile ('Only accept returning of array passed').

    A kernel is inlined into the kernels that call it (``forceinline``): a call costs some ns, for its arrays and what
    the registers held go through memory, and one tick of the closed loop has dozens of calls.
    """
    return _compiled(function, forceinline=True)


def compiled_apart(function: Function) -> Function:
    """
    Compile a kernel as :func:`compiled` does, but keep it a function of its own in the kernels that call it.

    For kernels that are long, called from several places, and rarely at that: copies of them would only make the
    compiled code larger, which every start has to load.
    """
    return _compiled(function, forceinline=False)


def _compiled(function: Function, *, forceinline: bool) -> Function:
    outer = config.CACHE_DIR
    config.CACHE_DIR = str(kernel_cache_directory())
    try:
        return cast(Function, jit(cache=True, error_model='numpy', _nrt=False, forceinline=forceinline)(function))
    finally:
        config.CACHE_DIR = outer
