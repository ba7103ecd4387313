"""Extreme and wrong parameter values from files and schedules."""

import itertools
import random
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from faults.campaign import TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.judging import call
from faults.odd_values import is_named, odd_value
from faults.processes import NODES, PARAMS
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.graph.catalog import CONTROLLERS
from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments
from hdd_servo_ros.simulation.run_setup import Simulation

_DURATION = 0.0012
"""Twelve ticks [s]."""
_FIXED = ('duration', 'sample_time', 'record', 'run_dir', 'schedule', 'controller', 'recorded_run', 'progress')
"""Parameters that select the run and do not affect the loop."""
_REJECTIONS = (ParameterError, ArgumentError, ControllerError, RunError)


def trial(folder: Path, choice: random.Random) -> Trial:
    """Set some parameters by a file or a schedule, and run a few ticks if they are accepted."""
    controller = choice.choice([name for name in CONTROLLERS if CONTROLLERS[name] != 'signal_analyzer'])
    nodes = [*NODES[:-2], CONTROLLERS[controller], 'disturbance_generator']
    values = [odd_value(choice, choice.choice(nodes), _FIXED) for _ in range(choice.randint(1, 3))]
    way = choice.choice(('file', 'file', 'schedule'))
    given = ['--ros-args', '--params-file', str(PARAMS)]
    if way == 'file':
        path = folder / 'values.yaml'
        path.write_text(yaml.safe_dump(_sections(values)))
        given += ['--params-file', str(path)]
    else:
        entries = [f'0.0005 {node} {name} {yaml.safe_dump(value).split(chr(10))[0]}' for node, name, value in values]
        given += ['-p', f'schedule:={entries}']
    given += ['-p', f'duration:={_DURATION}', '-p', 'record:=false', '-p', f'controller:={controller}']
    returned, _, faults = call(_run, given)
    if faults:
        faults = [Fault(fault.kind, f'{fault.message}; {values}') for fault in faults]
        return Trial(f'by {way}: fault', faults)
    outcome, reason = returned
    if outcome == 'rejected' and not any(is_named(reason, node, name) for node, name, _ in values):
        faults = [Fault(WRONG, f'rejected without the name of the parameter: {reason[:200]}; {values}')]
    if '\n' in reason or len(reason) > 1000:
        faults = [*faults, Fault(TRACEBACK, f'not one line: {reason[:200]!r}')]
    return Trial(f'by {way}: {outcome}', faults)


def _run(given: list[str]) -> tuple[str, str]:
    try:
        simulation = Simulation(parse_ros_arguments(given))
        experiment = simulation.experiment
        pieces = list(itertools.islice(simulation.pieces(simulation.last_tick), 20))
        rows = [experiment.run(first, count) for first, count in pieces]
    except _REJECTIONS as error:
        return 'rejected', str(error)
    # `simulate` ends a run at the first value that is not finite.
    finite = all(np.isfinite(np.asarray(piece[topic])).all() for piece in rows for topic in ('head', 'control'))
    return ('accepted', '') if finite else ('accepted, ends at the first value that is not finite', '')


def _sections(values: list[tuple[str, str, Any]]) -> dict[str, Any]:
    sections: dict[str, Any] = {}
    for node, name, value in values:
        sections.setdefault(f'/**/{node}', {'ros__parameters': {}})['ros__parameters'][name] = value
    return sections


CAMPAIGN = Campaign('parameters', 'Parameter values from files and schedules', 12_000, 150, 1800.0, trial)
