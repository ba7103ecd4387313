"""
Cache of compiled kernels, shared by all copies of the package and by processes that start at the same time.

Numba identifies a cached kernel by the path of its source, so each copy of the package would compile its own kernels,
and processes that start without a cache would all compile the same kernels. This cache identifies a kernel by its
module and name, in one directory (:mod:`~hdd_servo_ros.numerics.kernel_folder`). The process that compiles a kernel
holds a lock, and the other processes wait for it. The file format is that of Numba: per kernel an index of signatures
and processors, and one code file per index entry, loaded in parts (:mod:`~hdd_servo_ros.numerics.outline`).
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

WAITING = 'waiting for another process that is compiling the kernels'
_NOTICE_AFTER = 1.0
"""Waiting time before a process prints a notice [s]."""
_PATIENCE = 300.0
"""Longest wait for one kernel [s]; if the compiling process hangs, this process then compiles the kernel itself."""

# Numba has no types.
_FunctionCache: Any = caching.FunctionCache
_CacheImpl: Any = caching.CompileResultCacheImpl
_CacheLocator: Any = caching._CacheLocator


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Locator of the files of a kernel: in the shared directory for all copies of the package."""

    def __init__(self, function: Callable[..., Any]) -> None:
        # Numba's warnings use this name for the source.
        self._py_file = function.__code__.co_filename
        self._lineno = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(kernel_cache_directory())

    def get_source_stamp(self) -> str:
        """Return an empty stamp, because the name of the directory contains the digest of all sources."""
        return ''

    def get_disambiguator(self) -> str:
        return str(self._lineno)


class _KernelCacheImpl(_CacheImpl):  # type: ignore[misc]
    """Storage of a kernel in Numba's format, in files named after its module and name."""

    def __init__(self, function: Callable[..., Any]) -> None:
        # Do not call Numba's constructor, which selects one of its own locators and uses only the file name.
        self._locator = _Locator(function)
        self._lineno = function.__code__.co_firstlineno
        self._filename_base = self.get_filename_base(f'{function.__module__}.{function.__qualname__}', sys.abiflags)

    def reduce(self, cres: Any) -> Any:
        """Return the payload to store for a compiled kernel."""
        return outlined(super().reduce(cres), cres.library)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the kernel for a stored payload."""
        of_numba, bitcode = payload
        found = super().rebuild(target_context, of_numba)
        if bitcode is not None:
            complete_when_linked(found.library, bitcode)
        return found


class KernelCache(_FunctionCache):  # type: ignore[misc]
    """
    Cache of one kernel.

    Parameters
    ----------
    function
        Python function of the kernel.
    """

    _impl_class = _KernelCacheImpl
    _noticed = False

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock_file = Path(self.cache_path) / f'{self._impl.filename_base}.lock'
        self._lock: int | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """
        Return the compiled kernel for a signature, or None if this process has to compile it.

        When it returns None, this process holds the lock of the kernel (where locks are available) until
        :meth:`release`.

        Numba's own method initializes the compiler before it loads a kernel. That takes longer than everything else and
        imports SciPy. Compiled code without reference counting does not need it, and the compiler initializes itself
        when it is used.
        """
        found = self._load(sig, target_context)
        if found is None and self._lock is None:
            self._lock = self._acquire()
            # Another process may have compiled it while this one waited.
            found = self._load(sig, target_context)
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel, or None if it is missing or its files are damaged (power failure, full disk)."""
        try:
            return self._load_overload(sig, target_context)
        except Exception:  # unpickling and LLVM may raise any exception for damaged bytes
            # Write an index without entries; saving the new kernel would fail on the damaged index too.
            with contextlib.suppress(OSError):
                self.flush()
            return None

    @property
    def is_locked(self) -> bool:
        """Whether this process holds the lock of the kernel."""
        return self._lock is not None

    def release(self) -> None:
        """Release the lock, if this process holds it."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _acquire(self) -> int | None:
        """
        Wait for the lock; return its file descriptor, or None if it is not available.

        The system releases the lock when its holder exits.
        """
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
    """Set the cache of a kernel, and make the kernel compile under its lock."""
    cache = dispatcher._cache = KernelCache(dispatcher.py_func)
    compile_unlocked = dispatcher.compile

    def compile_once(sig: Any) -> Any:
        was_locked = cache.is_locked
        try:
            return compile_unlocked(sig)
        finally:
            if not was_locked:
                cache.release()

    dispatcher.compile = compile_once
    # Before each first call Numba scans all installed packages for extensions that define argument types. No kernel
    # uses such types, and the scan still happens on compilation.
    dispatcher._compilation_chain_init_hook = lambda: None
