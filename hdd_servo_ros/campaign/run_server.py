"""
Runs without middleware as copies of one process, in which all that a run needs is imported and compiled already.

Each run is a process of its own, forked from the server: it starts in a hundredth of a second instead of more than one,
and shares nothing with the others that it could change.

The server reads a JSON object per line, ``{"arguments": [...], "log": FILE}``, and answers ``started PID``; when a run
ends it writes ``ended PID CODE``, with a negative code for a signal. At the end of its input it ends the runs, then
itself.
"""

import contextlib
import gc
import json
import os
import select
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NoReturn

_ASKED_TO_END = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class ServedRun:
    """
    A run that a :class:`RunServer` has started; its methods are those of :class:`subprocess.Popen`.

    Attributes
    ----------
    pid
        Of its process.
    returncode
        Exit code, negative for a signal; None while it runs.
    """

    def __init__(self, server: 'RunServer', pid: int) -> None:
        self._server = server
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        if self.returncode is None:
            self._server.read(0.0)
        return self.returncode

    def wait(self, timeout: float) -> int:
        """
        Return the exit code as soon as there is one.

        Raises
        ------
        subprocess.TimeoutExpired
            If there is none after ``timeout`` [s].
        """
        deadline = time.monotonic() + timeout
        while self.returncode is None:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise subprocess.TimeoutExpired('simulate', timeout)
            self._server.read(left)
        return self.returncode

    def terminate(self) -> None:
        """Ask the run to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process at once."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal, if the process still runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # ended just now
                os.kill(self.pid, number)


class RunServer:
    """
    Starts the server's process, requests runs and receives how they ended.

    Parameters
    ----------
    environment
        Variables of the runs.
    command
        Arguments of the interpreter that becomes the server; another program than this module serves other requests
        by :class:`Server`.

    Attributes
    ----------
    pid
        Of the server's process.
    """

    def __init__(self, environment: Mapping[str, str], command: Sequence[str] = ('-m', __name__)) -> None:
        self._process = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        self.pid = self._process.pid
        self._runs: dict[int, ServedRun] = {}
        self._started: list[int] = []
        self._ended: dict[int, int] = {}
        self._unread = b''

    def start(self, arguments: Sequence[str], log: Path) -> ServedRun:
        """
        Start a run; the first one waits until the server is ready.

        Parameters
        ----------
        arguments
            Of `simulate`.
        log
            Where its output goes.

        Raises
        ------
        OSError
            If the server has ended.
        """
        return self.request({'arguments': list(arguments), 'log': str(log)})

    def request(self, request: Mapping[str, object]) -> ServedRun:
        """Start the process that a request describes; :meth:`start` makes that of a run."""
        # It may be read before the process has opened it.
        Path(str(request['log'])).touch()
        stream = self._process.stdin
        assert stream is not None
        stream.write(json.dumps(request).encode() + b'\n')
        stream.flush()
        while not self._started:
            self.read(None)
        run = ServedRun(self, self._started.pop())
        # The end of a process that ended at once may have come with the same read as its start.
        run.returncode = self._ended.pop(run.pid, None)
        if run.returncode is None:
            self._runs[run.pid] = run
        return run

    def read(self, timeout: float | None) -> None:
        """
        Read what the server has written, and wait for it up to ``timeout`` [s], None for as long as it takes.

        Raises
        ------
        OSError
            If the server has ended.
        """
        stream = self._process.stdout
        assert stream is not None
        if not select.select([stream], [], [], timeout)[0]:
            return
        read = os.read(stream.fileno(), 65536)
        if not read:
            raise OSError(f'the process that starts the runs has ended with exit code {self._process.wait()}')
        *lines, self._unread = (self._unread + read).split(b'\n')
        for line in lines:
            word, pid, *code = line.decode().split()
            if word == 'started':
                self._started.append(int(pid))
            elif int(pid) in self._runs:
                self._runs.pop(int(pid)).returncode = int(code[0])
            else:
                self._ended[int(pid)] = int(code[0])

    def close(self) -> None:
        """End the server, and with it the runs that are left."""
        with self._process as process:
            assert process.stdin is not None
            process.stdin.close()


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
        # Ctrl-C in a terminal reaches every process: the runs end by themselves, and the study ends the server.
        for number in _ASKED_TO_END:
            self._handlers[number] = signal.signal(number, signal.SIG_IGN)

    def serve(self) -> None:
        """Start the requested runs until the end of the input."""
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


def _run(request: Mapping[str, Any]) -> NoReturn:
    """Run `simulate` in the forked process, and exit."""
    code = 1
    try:
        from hdd_servo_ros.simulation.simulate import main

        code = main(request['arguments'])
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _prepare() -> None:
    """Import what a run and its summary need, and load the compiled loop."""
    import hdd_servo_ros.reporting.show  # noqa: F401
    from hdd_servo_ros.simulation.closed_loop import Controllers
    from hdd_servo_ros.simulation.experiment import Experiment

    for controller in Controllers._fields:
        Experiment(1e-4, controller).run(0, 1)


def serve(prepare: Callable[[], None], run: Callable[[Mapping[str, Any]], NoReturn]) -> None:
    """Prepare, and serve what comes by the standard input; see :class:`Server`."""
    answers = os.fdopen(os.dup(1), 'wb')
    # What is printed by the imports must not be read as an answer.
    os.dup2(2, 1)
    prepare()
    gc.freeze()
    Server(sys.stdin.buffer, answers, run).serve()


def main() -> None:
    """Serve runs of `simulate`."""
    serve(_prepare, _run)


if __name__ == '__main__':
    main()
