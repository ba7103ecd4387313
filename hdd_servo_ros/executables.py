"""
The package's executables as entry points: an interrupt ends each quietly, also while it is still being imported.

Importing what an executable needs takes seconds, in which a launch file may want it to end; a traceback out of numba
says nothing then.
"""

import functools
import gc
import importlib
import signal
from collections.abc import Callable
from types import ModuleType

from hdd_servo_ros.messages.exit_codes import guard


def __getattr__(name: str) -> Callable[[], int]:
    """Return what runs an executable, by its name."""
    if name.startswith('_'):
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return functools.partial(_run, name)


def _run(name: str) -> int:
    code = guard(name, functools.partial(_work, name))
    # The work is done: a signal that arrives while Python shuts down would replace the exit code.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    return code


def _work(name: str) -> int:
    try:
        code: int = _module(name).main()
    except KeyboardInterrupt:
        code = 128 + signal.SIGINT
    return code


def _module(name: str) -> ModuleType:
    """
    Import the module of an executable.

    Garbage is collected only afterward: what is imported stays, so that each search through it while it grows would
    find nothing.
    """
    gc.disable()
    try:
        # Imported only here, where an interrupt is taken.
        from hdd_servo_ros.graph.catalog import executable_module

        return importlib.import_module(f'hdd_servo_ros.{executable_module(name)}')
    finally:
        gc.freeze()
        gc.enable()
