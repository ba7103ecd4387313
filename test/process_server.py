"""
The processes of the tests as copies of one, in which all that the executables need is imported and compiled already.

``python PROGRAM ARGUMENTS`` and ``python -m MODULE ARGUMENTS`` run in a copy as in a new interpreter, with their own
command line, folder, variables and output: only the imports are there beforehand, and what remains at the end is not
taken apart piece by piece. Tests of those two use new interpreters.

The server reads a JSON object per line, ``{"arguments": [...], "directory": ..., "environment": {...}, "log": FILE,
"errors": FILE or null}``, and answers ``started PID``; when a copy ends it writes ``ended PID CODE``, with a negative
code for a signal. At the end of its input it ends the copies, then itself.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import select
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, NoReturn

_ASKED_TO_END = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Server:
    """
    What the server's process does.

    Parameters
    ----------
    requests, answers
        Its input and output.
    run
        Called with the request in the forked process, whose output is in the request's log; it does not return.
    """

    def __init__(self, requests: IO[bytes], answers: IO[bytes], run: Callable[[Mapping[str, Any]], NoReturn]) -> None:
        self._requests, self._answers, self._run = requests, answers, run
        self._running: set[int] = set()
        self._woken, self._wake = os.pipe()
        os.set_blocking(self._wake, False)
        signal.set_wakeup_fd(self._wake, warn_on_full_buffer=False)
        self._handlers = {signal.SIGCHLD: signal.signal(signal.SIGCHLD, lambda number, frame: None)}
        # Ctrl-C in a terminal reaches every process: the copies end by themselves, and the tests end the server.
        for number in _ASKED_TO_END:
            self._handlers[number] = signal.signal(number, signal.SIG_IGN)

    def serve(self) -> None:
        """Start the requested copies until the end of the input."""
        unread = b''
        while True:
            ready = select.select([self._requests.fileno(), self._woken], [], [])[0]
            if self._woken in ready:
                os.read(self._woken, 4096)
                self._reap()
            if self._requests.fileno() in ready:
                read = os.read(self._requests.fileno(), 65536)
                if not read:
                    break
                *lines, unread = (unread + read).split(b'\n')
                for line in lines:
                    self._start(json.loads(line))
        for pid in self._running:
            os.kill(pid, signal.SIGTERM)
        for pid in self._running:
            os.waitpid(pid, 0)

    def _start(self, request: Mapping[str, Any]) -> None:
        pid = os.fork()
        if pid == 0:
            # The reader of the answers detects the server's end by the end of this pipe.
            os.close(self._answers.fileno())
            signal.set_wakeup_fd(-1)
            # As a new interpreter would find them: whoever starts processes in the background has SIGINT ignored.
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
            log = os.open(str(request['log']), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
            nothing = os.open(os.devnull, os.O_RDONLY)
            for own, taken in ((nothing, 0), (log, 1), (log, 2)):
                os.dup2(own, taken)
            self._run(request)
        self._running.add(pid)
        self._say(f'started {pid}')

    def _reap(self) -> None:
        while self._running:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            self._running.remove(pid)
            self._say(f'ended {pid} {os.waitstatus_to_exitcode(status)}')

    def _say(self, line: str) -> None:
        self._answers.write(line.encode() + b'\n')
        self._answers.flush()


def prepare() -> None:
    """Import every executable and what it imports when it needs it, and load the kernels of all controllers."""
    from hdd_servo_ros.graph.catalog import EXECUTABLES, executable_module
    from hdd_servo_ros.simulation.closed_loop import Controllers
    from hdd_servo_ros.simulation.experiment import Experiment

    modules = [f'hdd_servo_ros.{executable_module(name)}' for name in EXECUTABLES]
    for module in (*modules, 'hdd_servo_ros.reporting.plot', 'hdd_servo_ros.reporting.page'):
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


def serve(prepare: Callable[[], None], run: Callable[[Mapping[str, Any]], NoReturn]) -> None:
    """Prepare, and serve what comes by the standard input; see :class:`Server`."""
    answers = os.fdopen(os.dup(1), 'wb')
    # What is printed by the imports must not be read as an answer.
    os.dup2(2, 1)
    prepare()
    gc.freeze()
    Server(sys.stdin.buffer, answers, run).serve()


if __name__ == '__main__':
    serve(prepare, run)
