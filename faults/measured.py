"""Exit code, output, time and peak memory of a command."""

import dataclasses
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence

from faults.processes import ROOT


@dataclasses.dataclass(frozen=True)
class Measured:
    """Result of a command: exit code, standard output and error, time [s] and peak resident memory [MB]."""

    exit_code: int
    output: str
    errors: str
    seconds: float
    memory: float


def run_measured(
    module: str,
    *arguments: object,
    environment: Mapping[str, str] | None = None,
    most_seconds: float = 3600.0,
    inside: Sequence[str] = (),
) -> Measured:
    """
    Run a module of this package and measure it; the output goes to files, so that no pipe can block it.

    Parameters
    ----------
    module
        Name of the module; its arguments follow.
    environment
        Additional environment variables.
    most_seconds
        Wall time limit, after which the command is killed [s].
    inside
        Prefix of the command, such as a command that enters a namespace.

    Raises
    ------
    TimeoutError
        If the command was killed.
    """
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])])
    with tempfile.TemporaryFile('w+') as output, tempfile.TemporaryFile('w+') as errors:
        started = time.monotonic()
        process = subprocess.Popen(
            [*inside, sys.executable, '-m', module, *map(str, arguments)],
            env={**os.environ, 'PYTHONPATH': path, **(environment or {})},
            stdout=output,
            stderr=errors,
        )
        used: resource.struct_rusage | None = None
        while used is None:
            done, status, found = os.wait4(process.pid, os.WNOHANG)
            if done:
                process.returncode, used = os.waitstatus_to_exitcode(status), found
            elif time.monotonic() - started > most_seconds:
                process.kill()
                process.wait()
                raise TimeoutError(f'{module} did not end within {most_seconds:g} s')
            else:
                time.sleep(0.02)
        seconds = time.monotonic() - started
        output.seek(0)
        errors.seek(0)
        # Linux gives the memory in units of 1024 bytes.
        return Measured(process.returncode, output.read(), errors.read(), seconds, used.ru_maxrss * 1024e-6)
