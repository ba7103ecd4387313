"""Make a run for a test, with `rig` or with `simulate`."""

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.campaign.start import run_arguments, start_run
from hdd_servo_ros.testing.domain import take_domain
from hdd_servo_ros.testing.run import Run

TIMEOUT = 120.0
"""Default time limit of a run [s]."""
_KEPT_LINES = 20


class ExperimentFailed(AssertionError):
    """A run for a test failed; the message has the last output of the executable."""


def make_run(
    parameter_files: Sequence[str | Path],
    directory: Path,
    *,
    controller: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    without_ros: bool = False,
    may_fail: bool = False,
    timeout: float = TIMEOUT,
) -> Run:
    """
    Run an experiment in its own process, and open the recorded run.

    Parameters
    ----------
    parameter_files
        ROS 2 parameter files, overlaid from left to right.
    directory
        Folder of the run; it must not exist.
    controller
        ``adaptive_nn``, ``pid`` or another controller of `rig`; None for the one in the parameter files.
    overrides
        Further parameters: ``{'duration': 2.0}`` for the node that has it, ``{'pid_controller': {'kp': 0.1}}`` for
        one node.
    without_ros
        Whether to run `simulate`, which is faster and bit-identical, instead of `rig`.
    may_fail
        Whether a failed run is returned too; it must have left a bag.
    timeout
        Time limit [s].

    Raises
    ------
    ExperimentFailed
        If the run fails, is rejected, or takes too long.

    Examples
    --------
    >>> from pathlib import Path
    >>> from hdd_servo_ros.testing import make_run
    >>> run = make_run([], Path('runs/made'), overrides={'duration': 0.01}, without_ros=True)
    >>> run.last_tick
    100
    """
    values: dict[str, Any] = {'progress': False}
    if controller is not None:
        values['controller'] = controller
    for name, value in (overrides or {}).items():
        if isinstance(value, Mapping):
            values.update({f'{name}:{inner}': inner_value for inner, inner_value in value.items()})
        else:
            values[name] = value
    arguments = run_arguments(map(Path, parameter_files), values, directory)
    # Its own domain, so that tests may run at the same time.
    domain, lock = take_domain()
    with (
        lock,
        start_run(
            arguments,
            without_ros=without_ros,
            environment={'ROS_DOMAIN_ID': str(domain)},
            stdout=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        try:
            output, _ = process.communicate(timeout=timeout)
        except BaseException as error:
            process.kill()
            output, _ = process.communicate()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            message = f'{_command_line(process)} took more than {timeout:g} s; {_last_lines(output)}'
            raise ExperimentFailed(message) from None
    bag = directory / 'bag' / 'metadata.yaml'
    if process.returncode != 0 and not (may_fail and bag.is_file()):
        message = f'{_command_line(process)} ended with exit code {process.returncode}; {_last_lines(output)}'
        raise ExperimentFailed(message)
    return Run.open(directory)


def _command_line(process: 'subprocess.Popen[str]') -> str:
    command = process.args
    assert isinstance(command, list)
    return ' '.join(['python', *map(str, command[1:])])


def _last_lines(output: str) -> str:
    lines = output.strip().splitlines()[-_KEPT_LINES:]
    return 'its output:\n' + '\n'.join(lines) if lines else 'it printed nothing'
