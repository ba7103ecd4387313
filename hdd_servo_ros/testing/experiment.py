"""Make a run for a test: through the graph by `rig`, or through `simulate`."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.testing.domain import take_domain
from hdd_servo_ros.testing.run import Run

TIMEOUT = 120.0
"""How long a run may take, if a test does not say [s]."""
_KEPT_LINES = 20


class ExperimentFailed(AssertionError):
    """A run that was to be tested did not come to its end; carries what the executable said."""


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
    Run an experiment in a process of its own, and open what it recorded.

    Parameters
    ----------
    parameter_files
        ROS 2 parameter files, overlaid from left to right.
    directory
        Folder of the run; it must not exist.
    controller
        ``adaptive_nn``, ``pid``, or what else `rig` knows; None for what the files say.
    overrides
        Further parameters: ``{'duration': 2.0}`` for whichever node has it, ``{'pid_controller': {'kp': 0.1}}`` for
        one node.
    without_ros
        Whether to run `simulate`, which gives the same bits sooner, instead of `rig`.
    may_fail
        Whether a run that fails is returned like any other; it must have left a bag.
    timeout
        How long it may take [s].

    Raises
    ------
    ExperimentFailed
        If the run fails, is refused, or takes too long.
    """
    module = 'hdd_servo_ros.simulation.simulate' if without_ros else 'hdd_servo_ros.nodes.rig'
    parameters = {'run_dir': str(directory), 'plot': False, 'progress': False}
    arguments = ['--ros-args']
    for file in parameter_files:
        arguments += ['--params-file', str(file)]
    if controller is not None:
        parameters['controller'] = controller
    for name, value in {**parameters, **(overrides or {})}.items():
        if isinstance(value, Mapping):
            pairs = [(f'{name}:{inner}', inner_value) for inner, inner_value in value.items()]
        else:
            pairs = [(name, value)]
        for full_name, one in pairs:
            # JSON is YAML, and keeps texts, numbers and lists apart.
            arguments += ['-p', f'{full_name}:={json.dumps(one)}']
    # What a sourced ROS would have set, and a domain of its own, so that tests may run side by side.
    environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'AMENT_PREFIX_PATH': sys.prefix, **os.environ}
    domain, lock = take_domain()
    try:
        with lock:
            ended = subprocess.run(
                [sys.executable, '-m', module, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=timeout,
                env={**environment, 'ROS_DOMAIN_ID': str(domain)},
            )
    except subprocess.TimeoutExpired as error:
        said = error.stdout.decode(errors='replace') if isinstance(error.stdout, bytes) else error.stdout or ''
        raise ExperimentFailed(f'{_called(module, arguments)} took more than {timeout:g} s; {_said(said)}') from None
    bag = directory / 'bag' / 'metadata.yaml'
    if ended.returncode != 0 and not (may_fail and bag.is_file()):
        raise ExperimentFailed(
            f'{_called(module, arguments)} ended with exit code {ended.returncode}; {_said(ended.stdout)}'
        )
    return Run.open(directory)


def _called(module: str, arguments: Sequence[str]) -> str:
    return ' '.join(['python -m', module, *arguments])


def _said(output: str) -> str:
    lines = output.strip().splitlines()[-_KEPT_LINES:]
    return 'it said:\n' + '\n'.join(lines) if lines else 'it said nothing'
