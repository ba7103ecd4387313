"""
Processes of the tests as copies of a prepared one: the side that asks for them; ``process_server.py`` is the other.

Each is forked from the server: it starts in a hundredth of a second instead of more than one, and shares nothing with
the others that it could change.
"""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

_SERVER = Path(__file__).with_name('process_server.py')


class Copy:
    """
    A process that :class:`Copies` have started; its methods are those of :class:`subprocess.Popen`.

    Attributes
    ----------
    pid
        Of its process.
    returncode
        Exit code, negative for a signal; None while it runs.
    """

    def __init__(self, server: 'Copies', pid: int) -> None:
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
                raise subprocess.TimeoutExpired('a copy', timeout)
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


class Copies:
    """
    Starts the server's process, requests copies of it and receives how they ended.

    Parameters
    ----------
    environment
        Variables of the server.

    Attributes
    ----------
    pid
        Of the server's process.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(_SERVER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        self.pid = self._process.pid
        self._runs: dict[int, Copy] = {}
        self._started: list[int] = []
        self._ended: dict[int, int] = {}
        self._unread = b''

    def request(self, request: Mapping[str, object]) -> Copy:
        """
        Start the process that a request describes; the first one waits until the server is ready.

        Raises
        ------
        OSError
            If the server has ended.
        """
        # It may be read before the process has opened it.
        Path(str(request['log'])).touch()
        stream = self._process.stdin
        assert stream is not None
        stream.write(json.dumps(request).encode() + b'\n')
        stream.flush()
        while not self._started:
            self.read(None)
        run = Copy(self, self._started.pop())
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
            raise OSError(f'the process that is copied has ended with exit code {self._process.wait()}')
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
