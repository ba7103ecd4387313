"""A case of a study: one run, defined by its parameters."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.campaign.start import run_arguments
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.version import __version__

_NOT_COMPARED = {
    'deterministic_timer': ('rate', 'progress', 'lookahead', 'start_timeout', 'peer_timeout'),
    'bag_recorder': ('run_dir', 'storage', 'compression', 'max_bag_size', 'max_bag_duration'),
}
"""Parameters that do not affect the results of a run."""


def parameter_file(name: str) -> Path:
    """
    Return a parameter file of this package, from the checkout or the installed share directory.

    Raises
    ------
    ArgumentError
        If no file has that name.
    """
    package = Path(__file__).resolve().parents[1]
    share = [parent / 'share' / 'hdd_servo_ros' / 'params' for parent in package.parents]
    for directory in (package.parent / 'params', *share):
        if (directory / name).is_file():
            return directory / name
    raise ArgumentError(f'unknown parameter file {name!r}: hdd_servo_ros has none of that name')


@dataclasses.dataclass(frozen=True)
class Case:
    """
    One run of a study.

    Attributes
    ----------
    name
        Name of the case and of its run directory.
    controller
        Value of the parameter ``controller`` of `rig`.
    files
        Parameter files, those in ``params/`` by name, others by path; later ones win.
    overrides
        Overrides of the files, by ``'node:parameter'``; a float needs a decimal point, as in ROS.
    """

    name: str
    controller: str
    files: tuple[str | Path, ...]
    overrides: Mapping[str, object] = dataclasses.field(default_factory=dict)

    def arguments(self, defaults: Mapping[str, object], run_dir: Path) -> list[str]:
        """
        Return the command line of `rig` and of `simulate` for this case.

        Parameters
        ----------
        defaults
            Overrides for the whole study; those of the case win.
        run_dir
            Folder of the run.
        """
        files = [file if isinstance(file, Path) else parameter_file(file) for file in self.files]
        return run_arguments(files, {**defaults, **self.overrides, 'controller': self.controller}, run_dir)


class PlannedRun:
    """
    A case with its checked parameters and its paths on disk.

    Parameters
    ----------
    case
        What to run.
    defaults
        Overrides of the whole study.
    directory
        Parent of the run directory.

    Raises
    ------
    ParameterError, ArgumentError
        If the parameters are not allowed.
    """

    def __init__(self, case: Case, defaults: Mapping[str, object], directory: Path) -> None:
        self.case = case
        self.directory = directory / case.name
        self.log = directory / f'{case.name}.log'
        self.arguments: Sequence[str] = case.arguments(defaults, self.directory)
        self._simulation = Simulation(parse_ros_arguments(self.arguments))
        self.ticks = self._simulation.last_tick + 1

    @property
    def period(self) -> float:
        """Period of the reference [s]; infinite if it is not periodic or unused."""
        nodes = self._simulation.nodes
        named = {name.rsplit('/', 1)[-1]: node['parameters'] for name, node in nodes.items()}
        reference = named['reference_generator']
        repeats = reference['waveform'] in ('sine', 'square') and reference['frequency'] > 0.0
        return 1.0 / reference['frequency'] if repeats and 'signal_analyzer' not in named else math.inf

    @property
    def sample_time(self) -> float:
        """Sample time T [s]."""
        return self._simulation.timer.sample_time

    def obstacle(self, run: Mapping[str, Any]) -> str:
        """Return why a recorded run cannot replace this one; empty if it can."""
        if run['status'] != FINISHED:
            return f'its status is {run["status"]}'
        version = run['versions']['hdd_servo_ros']
        if version != __version__:
            return f'its version is {version}'
        return next(self._differences(run), '')

    def _differences(self, run: Mapping[str, Any]) -> Iterator[str]:
        for full_name, expected in self._simulation.nodes.items():
            node = full_name.rsplit('/', 1)[-1]
            recorded = run['nodes'].get(full_name)
            if recorded is None:
                yield f'it has no {node}'
                continue
            if recorded['offers'] != expected['offers']:
                # For example the digest of a controller's file.
                yield f'{node} has changed'
            for name, value in expected['parameters'].items():
                plain = list(value) if isinstance(value, tuple) else value
                found = recorded['parameters'].get(name)
                if name not in _NOT_COMPARED.get(node, ()) and found != plain:
                    yield f'{node}:{name} is {found}, not {plain}'
