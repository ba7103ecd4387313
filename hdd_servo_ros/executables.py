"""
Entry points of the executables: an interrupt ends each without a traceback, even during imports.

Imports take seconds, during which a launch file may end the process; a traceback from inside numba would not help then.
"""

import functools
import gc
import importlib
import signal
from collections.abc import Callable
from types import ModuleType

from hdd_servo_ros.messages.exit_codes import guard


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that runs an executable, by name."""
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

    Garbage collection is disabled meanwhile: imported objects stay alive, so that each collection would be wasted time.
    """
    gc.disable()
    try:
        # Imported here, where an interrupt is handled.
        from hdd_servo_ros.graph.catalog import executable_module

        return importlib.import_module(f'hdd_servo_ros.{executable_module(name)}')
    finally:
        gc.freeze()
        gc.enable()
