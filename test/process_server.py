"""
The processes of the tests as copies of one, in which all that the executables need is imported and compiled already.

``python PROGRAM ARGUMENTS`` and ``python -m MODULE ARGUMENTS`` run in a copy as in a new interpreter, with their own
command line, folder, variables and output: only the imports are there beforehand, and what remains at the end is not
taken apart piece by piece. Tests of those two use new interpreters.

A request is ``{"arguments": [...], "directory": ..., "environment": {...}, "log": FILE, "errors": FILE or null}``.
"""

import atexit
import importlib
import os
import runpy
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from hdd_servo_ros.campaign.run_server import serve


def prepare() -> None:
    """Import every executable and what it imports when it needs it, and load the kernels of all controllers."""
    from hdd_servo_ros.graph.catalogue import EXECUTABLES, executable_module
    from hdd_servo_ros.simulation.closed_loop import Controllers
    from hdd_servo_ros.simulation.experiment import Experiment

    modules = [f'hdd_servo_ros.{executable_module(name)}' for name in EXECUTABLES]
    for module in (*modules, 'hdd_servo_ros.reporting.picture', 'hdd_servo_ros.reporting.page'):
        importlib.import_module(module)
    for name in Controllers._fields:
        whole = Experiment(1e-4, name)
        whole.run(0, 2)
        Experiment(1e-4, whole.controller).run(0, 2)  # block by block, as the nodes do
    # The module that is run has been imported here, which runpy warns of.
    warnings.filterwarnings('ignore', category=RuntimeWarning, module='runpy')


def run(request: Mapping[str, Any]) -> NoReturn:
    """Be the interpreter that the request asks for."""
    code = 1
    try:
        if request['errors'] is not None:
            os.dup2(os.open(request['errors'], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666), 2)
        os.chdir(request['directory'])
        os.environ.clear()
        os.environ.update(request['environment'])
        execute(*request['arguments'])
        code = 0
    except SystemExit as ended:
        code = exit_code(ended.code)
    except KeyboardInterrupt:
        traceback.print_exc()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        traceback.print_exc()
    finally:
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def execute(program: str, *arguments: str) -> None:
    """Run a program, or the module that follows ``-m``."""
    if program == '-m':
        sys.argv = list(arguments)
        sys.path[0] = str(Path.cwd())
        runpy.run_module(arguments[0], run_name='__main__', alter_sys=True)
    else:
        sys.argv = [program, *arguments]
        sys.path[0] = str(Path(program).resolve().parent)
        runpy.run_path(program, run_name='__main__')


def exit_code(given: object) -> int:
    """Return the exit code of ``sys.exit(given)``, which prints what is no number."""
    if given is None:
        return 0
    if isinstance(given, int):
        return given
    print(given, file=sys.stderr)
    return 1


if __name__ == '__main__':
    serve(prepare, run)
