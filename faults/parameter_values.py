"""Parameter values as nobody should give them, by file, by schedule and as services check them."""

import itertools
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from faults.campaign import TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.judging import call
from faults.processes import NODES, PARAMS
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.graph.catalogue import CONTROLLERS
from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments
from hdd_servo_ros.simulation.run_setup import Simulation

_DURATION = 0.0012
"""Twelve ticks [s]."""
_FIXED = ('duration', 'sample_time', 'record', 'run_dir', 'schedule', 'controller', 'recorded_run', 'progress')
"""What says which run it is, and not how it goes."""
_REFUSALS = (ParameterError, ArgumentError, ControllerError, RunError)


def trial(folder: Path, choice: random.Random) -> Trial:
    """Set some parameters by a file or a schedule, and run a few ticks if that is accepted."""
    controller = choice.choice([name for name in CONTROLLERS if CONTROLLERS[name] != 'signal_analyzer'])
    values = _values(choice, [*NODES[:-2], CONTROLLERS[controller], 'disturbance_generator'])
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
        faults = [Fault(fault.kind, f'{fault.seen}; {values}') for fault in faults]
        return Trial(f'by {way}: fault', faults)
    outcome, what = returned
    if outcome == 'refused' and not any(_is_named(what, node, name) for node, name, _ in values):
        faults = [Fault(WRONG, f'refused without its name: {what[:200]}; {values}')]
    if '\n' in what or len(what) > 1000:
        faults = [*faults, Fault(TRACEBACK, f'not one line: {what[:200]!r}')]
    return Trial(f'by {way}: {outcome}', faults)


def _is_named(said: str, node: str, name: str) -> bool:
    """Return whether a refusal names a parameter, or as `a drive in x and V` the units of the drive."""
    return name in said or node in said or (name.endswith('_unit') and 'a drive in' in said)


def _run(given: list[str]) -> tuple[str, str]:
    try:
        simulation = Simulation(parse_ros_arguments(given))
        experiment = simulation.experiment
        pieces = list(itertools.islice(simulation.pieces(simulation.last_tick), 20))
        rows = [experiment.run(first, count) for first, count in pieces]
    except _REFUSALS as error:
        return 'refused', str(error)
    # `simulate` ends a run at its first value that is not finite; only an infinity that looks like a number would pass.
    finite = all(np.isfinite(np.asarray(piece[topic])).all() for piece in rows for topic in ('head', 'control'))
    return ('accepted', '') if finite else ('accepted, ends at its first value that is not finite', '')


def _values(choice: random.Random, nodes: list[str]) -> list[tuple[str, str, Any]]:
    chosen = []
    for _ in range(choice.randint(1, 3)):
        node = choice.choice(nodes)
        declarations = [each for each in node_declarations(node) if each.name not in _FIXED]
        declaration = choice.choice(declarations)
        value = _value(choice, declaration)
        chosen.append((node, declaration.name, value))
    return chosen


_NUMBERS = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e-12, 1e12, 1e300, 1.797e308, math.inf, -math.inf, math.nan)
_ODD: tuple[Any, ...] = (True, 'x', '', [], [1.0, 'x'], 2**63, -(2**63) - 1, 10**30, {'a': 1}, None)


def _value(choice: random.Random, declaration: Any) -> Any:
    if choice.random() < 0.1:
        return choice.choice(_ODD)
    if declaration.is_sequence:
        return [_scalar(choice, declaration) for _ in range(choice.randint(0, 4))]
    return _scalar(choice, declaration)


def _scalar(choice: random.Random, declaration: Any) -> Any:
    kind = declaration.element_type
    if kind is bool:
        return choice.random() < 0.5
    if kind is str:
        return choice.choice([*(declaration.choices or ()), 'x', ''])
    lower, upper = max(declaration.minimum, declaration.above), declaration.maximum
    bounds = [bound for bound in (lower, upper) if math.isfinite(bound)]
    if kind is int:
        return choice.choice([0, 1, 2, 3, -1, 2**31, 2**62, *map(int, bounds)])
    return choice.choice(
        [*_NUMBERS, *bounds, *(math.nextafter(bound, math.inf) for bound in bounds), choice.gauss(0, 1)]
    )


def _sections(values: list[tuple[str, str, Any]]) -> dict[str, Any]:
    sections: dict[str, Any] = {}
    for node, name, value in values:
        sections.setdefault(f'/**/{node}', {'ros__parameters': {}})['ros__parameters'][name] = value
    return sections


CAMPAIGN = Campaign('parameters', 'Parameter values by file and schedule', 20_000, 150, 2400.0, trial)
