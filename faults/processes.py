"""Processes of a trial in a private ROS domain; each is ended by its process ID."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from faults.campaign import HANG, ORPHAN, Fault
from faults.judging import tracebacks, wait_until
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.testing.domain import take_domain

ROOT = Path(__file__).parent.parent
PARAMS = ROOT / 'params' / 'seagate_7200_10.yaml'
NODES = nodes_of_run({CONTROLLER: CONTROLLERS['adaptive_nn']})
LONGEST_START = 600.0
"""Time limit for the start of a run, which takes a few seconds unless the machine is busy [s]."""
LONGEST_END = 300.0
"""Time limit for the end of the processes of a disturbed run, and between two progress reports [s]."""


class Processes:
    """
    The processes of a trial.

    Parameters
    ----------
    folder
        Working directory and directory of the logs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.domain, self._lock = take_domain()
        self.environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(self.domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]),
            _MARK: str(folder),
        }
        self.started: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, *arguments: str) -> subprocess.Popen[bytes]:
        """Start a node's executable with the default parameters."""
        # As the installed script starts it.
        code = f'import sys; from hdd_servo_ros.executables import {name}; sys.exit({name}())'
        command = [sys.executable, '-c', code, '--ros-args', '--params-file', str(PARAMS)]
        with (self.folder / f'{name}.log').open('wb') as log:
            process = subprocess.Popen(
                [*command, *arguments], cwd=self.folder, env=self.environment, stdout=log, stderr=log
            )
        self.started[name] = process
        return process

    def output(self, name: str) -> str:
        """Return the output of a process."""
        return (self.folder / f'{name}.log').read_text(errors='replace')

    def outputs(self) -> Sequence[str]:
        """Return the outputs of all processes."""
        return [self.output(name) for name in self.started]

    def family(self) -> list[int]:
        """Return the IDs of all processes of this trial, including their children."""
        return [int(path.name) for path in Path('/proc').iterdir() if path.name.isdigit() and self._is_own(path)]

    def _is_own(self, process: Path) -> bool:
        with contextlib.suppress(OSError):
            mark = f'{_MARK}={self.folder}'.encode()
            is_dead = (process / 'stat').read_text().rpartition(')')[2].split()[0] == 'Z'
            return not is_dead and mark in (process / 'environ').read_bytes().split(b'\0')
        return False

    def ended(self, seconds: float = LONGEST_END) -> list[Fault]:
        """Wait until all processes have ended; return hangs, orphans and tracebacks."""
        faults = []
        for name, process in self.started.items():
            if not self._ends(process, seconds):
                faults.append(Fault(HANG, f'{name} neither ended nor printed anything within {seconds:g} s'))
        if not faults and not wait_until(lambda: not self.family(), seconds):
            faults.append(Fault(ORPHAN, f'processes {self.family()} are still running'))
        for name in self.started:
            faults += tracebacks(self.output(name), name)
        return faults

    def _ends(self, process: 'subprocess.Popen[bytes]', seconds: float) -> bool:
        """Wait for the end of a process; a run that prints progress is slow and does not hang."""
        printed = -1
        while (present := sum(len(text) for text in self.outputs())) > printed:
            printed = present
            if wait_until(lambda: process.poll() is not None, seconds):
                return True
        return False

    def close(self) -> None:
        """Kill the remaining processes."""
        for pid in self.family():
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        for process in self.started.values():
            process.wait()
        self._lock.close()


_MARK = 'HDD_SERVO_ROS_TRIAL'


@contextlib.contextmanager
def processes(folder: Path) -> Iterator[Processes]:
    """Create the processes of a trial, and kill the remaining ones at its end."""
    made = Processes(folder)
    try:
        yield made
    finally:
        made.close()
