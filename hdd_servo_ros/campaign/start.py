"""Start of a run in its own process, with `rig` or with `simulate`."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def run_arguments(files: Iterable[Path], values: Mapping[str, Any], run_dir: Path) -> list[str]:
    """
    Return the arguments of `rig` and `simulate` for a run.

    Parameters
    ----------
    files
        ROS 2 parameter files; later ones win.
    values
        Overrides of the files, by ``'node:parameter'``, or by ``'parameter'`` for the node that has it; a float needs a
        decimal point, as in ROS. A plot is drawn only if ``plot`` is set.
    run_dir
        Directory of the run.
    """
    arguments = ['--ros-args']
    for file in files:
        arguments += ['--params-file', str(file)]
    # These come last: in rclpy, later nodes and wildcards override earlier ones.
    for name, value in {**values, 'plot': values.get('plot', False), 'run_dir': str(run_dir)}.items():
        # JSON is YAML, and distinguishes strings, numbers and lists.
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    return arguments


def start_run(
    arguments: Sequence[str], *, without_ros: bool, environment: Mapping[str, str] | None = None, **options: Any
) -> 'subprocess.Popen[Any]':
    """
    Start a run, and return its process; its standard error is redirected to its standard output.

    Parameters
    ----------
    arguments
        Result of :func:`run_arguments`.
    without_ros
        Whether to use `simulate` instead of `rig`.
    environment
        Additional environment variables.
    **options
        Further arguments of :class:`subprocess.Popen`.
    """
    module = 'hdd_servo_ros.simulation.simulate' if without_ros else 'hdd_servo_ros.nodes.rig'
    return subprocess.Popen(
        [sys.executable, '-m', module, *arguments],
        stderr=subprocess.STDOUT,
        env=run_environment(environment or {}),
        **options,
    )


def run_environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a run: that of this process, the variables of a sourced ROS, and ``variables``."""
    # Runs are not visible on the network unless the user sets the discovery range.
    defaults = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'AMENT_PREFIX_PATH': sys.prefix}
    return {**defaults, **os.environ, **variables}
