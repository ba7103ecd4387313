"""Starts a run in a process of its own: through the graph by `rig`, or without middleware by `simulate`."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def run_arguments(files: Iterable[Path], values: Mapping[str, Any], run_dir: Path) -> list[str]:
    """
    Return the arguments that `rig` and `simulate` take for a run.

    Parameters
    ----------
    files
        ROS 2 parameter files, later ones win.
    values
        Overrides of the files, under ``'node:parameter'``, or ``'parameter'`` for whichever node has it; a float must
        be written as one, as ROS insists. No picture is drawn unless they say so.
    run_dir
        Folder of the run.
    """
    arguments = ['--ros-args']
    for file in files:
        arguments += ['--params-file', str(file)]
    # Ours come last: rclpy lets the node or wildcard that is named first give way to those named after it.
    for name, value in {**values, 'plot': values.get('plot', False), 'run_dir': str(run_dir)}.items():
        # JSON is YAML, and keeps texts, numbers and lists apart.
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    return arguments


def start_run(
    arguments: Sequence[str], *, without_ros: bool, environment: Mapping[str, str] | None = None, **options: Any
) -> 'subprocess.Popen[Any]':
    """
    Start a run, and return its process; its standard error goes where its standard output goes.

    Parameters
    ----------
    arguments
        As :func:`run_arguments` makes them.
    without_ros
        Whether `simulate` makes the run instead of `rig`.
    environment
        Variables to set besides those of this process.
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
    """Return the environment of a run: that of this process, what a sourced ROS would have set, and ``variables``."""
    # The runs are this machine's own affair unless the user says otherwise.
    defaults = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'AMENT_PREFIX_PATH': sys.prefix}
    return {**defaults, **os.environ, **variables}
