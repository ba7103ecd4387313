"""
The cache of compiled kernels: shared by all copies of the package and by processes that start at once.

Numba finds a cached kernel by the path of its source, so that each copy of the package compiles its own; and processes
that start without a cache all compile the same. Here a kernel is found by its module and name in one folder
(:mod:`~hdd_servo_ros.numerics.kernel_folder`), and the process that compiles it holds a lock that the others wait for.
The files themselves are those of Numba: an index of signatures and processors per kernel, and a file of code for each,
which is loaded in parts (:mod:`~hdd_servo_ros.numerics.outline`).
"""

import contextlib
import fcntl
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core import caching

from hdd_servo_ros.numerics.kernel_folder import kernel_cache_directory
from hdd_servo_ros.numerics.outline import complete_when_linked, outlined

WAITING = 'another process compiles the kernels; waiting for it'
_NOTICE_AFTER = 1.0
"""How long a process waits silently [s]."""
_PATIENCE = 300.0
"""How long it waits for one kernel [s]; whoever compiles may be stopped, and then it compiles for itself."""

# Numba has no types.
_FunctionCache: Any = caching.FunctionCache
_CacheImpl: Any = caching.CompileResultCacheImpl
_CacheLocator: Any = caching._CacheLocator


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Where the files of a kernel are: in the common folder, whatever copy of the package the kernel is of."""

    def __init__(self, function: Callable[..., Any]) -> None:
        # By this name Numba's warnings refer to the source.
        self._py_file = function.__code__.co_filename
        self._lineno = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(kernel_cache_directory())

    def get_source_stamp(self) -> str:
        """Return nothing: the folder belongs to one state of all sources."""
        return ''

    def get_disambiguator(self) -> str:
        return str(self._lineno)


class _KernelCacheImpl(_CacheImpl):  # type: ignore[misc]
    """How a kernel is stored: as Numba does it, in files that are named after its module and name."""

    def __init__(self, function: Callable[..., Any]) -> None:
        # Without the constructor of Numba, which looks for one of its own locators and takes the file's name alone.
        self._locator = _Locator(function)
        self._lineno = function.__code__.co_firstlineno
        self._filename_base = self.get_filename_base(f'{function.__module__}.{function.__qualname__}', sys.abiflags)

    def reduce(self, cres: Any) -> Any:
        """Return what is stored of a compiled kernel."""
        return outlined(super().reduce(cres), cres.library)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the kernel of which that was stored."""
        of_numba, bitcode = payload
        found = super().rebuild(target_context, of_numba)
        if bitcode is not None:
            complete_when_linked(found.library, bitcode)
        return found


class KernelCache(_FunctionCache):  # type: ignore[misc]
    """
    The cache of one kernel.

    Parameters
    ----------
    function
        The kernel, before it is compiled.
    """

    _impl_class = _KernelCacheImpl
    _noticed = False

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock_file = Path(self.cache_path) / f'{self._impl.filename_base}.lock'
        self._lock: int | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """
        Return the compiled kernel for a signature, None if this process has to compile it.

        In the latter case the kernel's lock is held from here on, as far as there can be one: :meth:`release` it.

        Numba gets its compiler ready before it loads a kernel, which takes longer than all else and imports SciPy.
        Compiled code that counts no references needs none of that, and the compiler gets itself ready when it is used.
        """
        found = self._load(sig, target_context)
        if found is None and self._lock is None:
            self._lock = self._acquire()
            # Another process may have compiled it while this one waited.
            found = self._load(sig, target_context)
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel, None if there is none, or only files that a power cut or a full disk has left."""
        try:
            return self._load_overload(sig, target_context)
        except Exception:  # unpickling and LLVM raise whatever damaged bytes make them
            # An index without entries, which is then written anew; the damaged one would fail there too.
            with contextlib.suppress(OSError):
                self.flush()
            return None

    @property
    def is_locked(self) -> bool:
        """Whether this process holds the lock."""
        return self._lock is not None

    def release(self) -> None:
        """Release the lock, if this process holds it."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _acquire(self) -> int | None:
        """Wait for the lock, which the system frees when its holder ends; return its descriptor, None without one."""
        try:
            lock = os.open(self._lock_file, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            return None
        started = time.monotonic()
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return lock
            except BlockingIOError:
                pass
            except OSError:  # a file system without locks
                break
            waited = time.monotonic() - started
            if waited > _PATIENCE:
                break
            if waited > _NOTICE_AFTER and not KernelCache._noticed:
                KernelCache._noticed = True
                print(f'{Path(sys.argv[0]).stem}: {WAITING}', file=sys.stderr, flush=True)
            time.sleep(0.02)
        os.close(lock)
        return None


def keep_compiled(dispatcher: Any) -> None:
    """Give a kernel its cache, and make it compile under its lock."""
    cache = dispatcher._cache = KernelCache(dispatcher.py_func)
    compile_unlocked = dispatcher.compile

    def compile_once(sig: Any) -> Any:
        was_locked = cache.is_locked
        try:
            return compile_unlocked(sig)
        finally:
            # Also when it has failed or was interrupted.
            if not was_locked:
                cache.release()

    dispatcher.compile = compile_once
    # Before each first call Numba looks through all installed packages for extensions, to know types of arguments that
    # no kernel has. Where it compiles, it does so all the same.
    dispatcher._compilation_chain_init_hook = lambda: None
