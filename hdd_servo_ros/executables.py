"""
The package's executables as entry points: an interrupt ends each quietly, also while it is still being imported.

Importing what an executable needs takes seconds, in which a launch file may want it to end; a traceback out of numba
says nothing then.
"""

import functools
import importlib
import signal
from collections.abc import Callable

_ELSEWHERE = {
    'simulate': 'simulation.simulate',
    'study': 'studies.main',
    'compare': 'studies.compare',
    'report': 'reporting.report',
    'compare_bags': 'recording.compare_bags',
    'replay': 'tools.replay',
    'recover': 'tools.recover',
    'scope': 'tools.scope',
    'identify': 'analysis.identify',
    'tune': 'studies.tune',
    'stability_certificate': 'studies.stability_certificate',
    'instruments': 'studies.instruments',
    'swept_sine': 'studies.swept_sine',
    'friction_curves': 'studies.friction_curves',
    'drive_response': 'studies.drive_response',
}
"""Modules of the commands; a node's executable has a module of its name in `nodes`."""


def __getattr__(name: str) -> Callable[[], int]:
    """Return what runs an executable, by its name."""
    if name.startswith('_'):
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return functools.partial(_run, _ELSEWHERE.get(name, f'nodes.{name}'))


def _run(module: str) -> int:
    try:
        code: int = importlib.import_module(f'hdd_servo_ros.{module}').main()
    except KeyboardInterrupt:
        code = 128 + signal.SIGINT
    # It has done what it had to do; while Python ends, another one would take its exit code away.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code
