"""The runs of a campaign with their parameters, checked before the first run starts."""

import dataclasses
import hashlib
import itertools
import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdd_servo_ros.campaign.elements import element, list_and_index, with_elements
from hdd_servo_ros.campaign.lazy_sequence import LazySequence
from hdd_servo_ros.campaign.points import Point
from hdd_servo_ros.campaign.sampling import scaled
from hdd_servo_ros.campaign.spec import CampaignController, Spec
from hdd_servo_ros.graph.catalog import names_with_parameters
from hdd_servo_ros.graph.roles import PLAYBACK
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, RosArguments, did_you_mean, parse_ros_arguments
from hdd_servo_ros.parameters.ros_yaml import written, written_file
from hdd_servo_ros.reporting.evaluation import REFERENCE_GENERATOR
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.version import __version__


@dataclasses.dataclass(frozen=True)
class CampaignRun:
    """
    One run of a campaign, with everything that a worker needs.

    Attributes
    ----------
    number
        Row of the table, from 0.
    controller
        Name of the controller in the table.
    seed
        Seed of sensors and disturbances; None for the seeds of the files.
    varied
        The varied parameters and their values in this run, by ``'node:parameter'`` or, for elements of lists, by
        ``'node:parameter[index]'``; the factor for a scaled list.
    lists
        The resulting lists with scaled or varied elements, by ``'node:parameter'``.
    seeds
        The parameters that the seed sets.
    base
        The parameters of all runs with this controller.
    """

    number: int
    controller: str
    seed: int | None
    varied: Mapping[str, object]
    lists: Mapping[str, tuple[object, ...]]
    seeds: tuple[str, ...]
    base: RosArguments

    @property
    def settings(self) -> dict[str, object]:
        """The parameters that this run sets in addition to its base, by ``'node:parameter'``."""
        seed = {} if self.seed is None else dict.fromkeys(self.seeds, self.seed)
        scalars = {key: value for key, value in self.varied.items() if list_and_index(key)[1] is None}
        # Lists come last, so that they replace their factors.
        return {**scalars, **self.lists, **seed}

    def arguments(self, further: Mapping[str, object] | None = None) -> RosArguments:
        """Return the arguments of `simulate` for this run, with ``further`` overrides."""
        overrides = {node: dict(values) for node, values in self.base.overrides.items()}
        for key, value in {**self.settings, **(further or {})}.items():
            node, _, name = key.partition(':')
            # Moved to the end, to override all others; a wildcard in a file may also match the node.
            section = overrides.pop(node, {})
            overrides[node] = {**section, name: value}
        return RosArguments(overrides, list(self.base.named), self.base.remaps)

    def command(self, base_file: Path, run_dir: str) -> str:
        """
        Return a command that repeats and records this run.

        Parameters
        ----------
        base_file
            Parameter file of the base, see :meth:`Plan.base_files`.
        run_dir
            Directory of the recorded run.
        """
        arguments = ['--params-file', str(base_file)]
        for key, value in {**self.settings, 'bag_recorder:run_dir': run_dir}.items():
            arguments += ['-p', f'{key}:={written(value)}']
        return f'ros2 run hdd_servo_ros simulate --ros-args {shlex.join(arguments)}'


class Plan(LazySequence[CampaignRun]):
    """
    All runs of a campaign.

    The seeds vary fastest, then the controllers, then the points: runs 0 to ``len(plan) - 1``.

    Parameters
    ----------
    spec
        The campaign.

    Raises
    ------
    ArgumentError, ParameterError
        If a file, a parameter or a controller of the specification is invalid. Varied values are not checked here: a
        run with an invalid value is a row with the status ``rejected``.
    """

    called = 'run'

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._bases = {controller.name: _Base(spec, controller) for controller in spec.controllers}
        self._check_varied()
        self._check_after()

    def __len__(self) -> int:
        return self.spec.count

    def __iter__(self) -> Iterator[CampaignRun]:
        combinations = itertools.product(self.spec.points, self.spec.controllers, self.spec.seeds)
        for number, (point, controller, seed) in enumerate(combinations):
            yield self._run(number, point, controller, seed)

    @property
    def extent(self) -> str:
        """The number of runs and its factors, as text."""
        return f'{len(self)} runs, {self.spec.extent}'

    def __repr__(self) -> str:
        return f'Plan({self.extent}, varied: {", ".join(self.varied) or "nothing"})'

    def _item(self, number: int) -> CampaignRun:
        rest, seed = divmod(number, len(self.spec.seeds))
        point, controller = divmod(rest, len(self.spec.controllers))
        spec = self.spec
        return self._run(number, spec.points[point], spec.controllers[controller], spec.seeds[seed])

    def _run(self, number: int, point: Point, controller: CampaignController, seed: int | None) -> CampaignRun:
        base = self._bases[controller.name]
        values: dict[str, object] = {}
        lists: dict[str, tuple[object, ...]] = {}
        for key, varied in point.items():
            values[key] = varied.value
            if varied.times_base:
                value = scaled(base.value(key), float(str(varied.value)), key)
                if isinstance(value, tuple):
                    # The table has the factor, which can be sorted and plotted.
                    lists[key] = value
                else:
                    values[key] = value
        lists |= with_elements(base.values, values)
        return CampaignRun(number, controller.name, seed, values, lists, base.seeds, base.arguments)

    @property
    def varied(self) -> tuple[str, ...]:
        """The varied parameters, as ``'node:parameter'``."""
        return tuple(self.spec.points[0])

    @property
    def contents(self) -> dict[str, Any]:
        """Entry ``contents`` of ``campaign.yaml``: the inputs of the table, apart from the base parameters."""
        spec = self.spec
        return {
            'version': __version__,
            'controllers': [controller.name for controller in spec.controllers],
            'varied': {key: self._digest_of_values(key) for key in self.varied},
            'seeds': [seed for seed in spec.seeds if seed is not None],
            'metrics': list(spec.metrics),
            'after': spec.after,
        }

    def _digest_of_values(self, key: str) -> str:
        values = [[point[key].value, point[key].times_base] for point in self.spec.points]
        return hashlib.blake2b(json.dumps(values).encode(), digest_size=8).hexdigest()

    @property
    def digest(self) -> str:
        """
        Digest of :attr:`contents` and of the base parameters.

        The files that the runs read are listed by :attr:`files`.
        """
        texts = [self.contents, self.base_files()]
        return hashlib.blake2b(json.dumps(texts).encode(), digest_size=16).hexdigest()

    @property
    def files(self) -> Iterator[object]:
        """Further parameter values that may name files which the runs read."""
        for base in self._bases.values():
            yield from base.arguments.parameters_of(PLAYBACK).values()
        strings = {key for point in self.spec.points[:1] for key, varied in point.items() if type(varied.value) is str}
        if strings:
            yield from dict.fromkeys(point[key].value for point in self.spec.points for key in strings)

    @property
    def nodes(self) -> list[dict[str, dict[str, Any]]]:
        """The nodes of the runs of each controller, with their base parameters."""
        return [base.nodes for base in self._bases.values()]

    def base_files(self) -> dict[str, str]:
        """Return the text of the base parameter file of each controller, by name."""
        return {name: written_file(base.arguments.overrides) for name, base in self._bases.items()}

    def _check_varied(self) -> None:
        """Reject parameters that do not exist in any run."""
        known = sorted({key for base in self._bases.values() for key in base.values})
        for key in self.varied:
            name, index = list_and_index(key)
            if name not in known:
                node = name.partition(':')[0]
                if node == 'rig':
                    other = '; list them under `controllers`' if name == 'rig:controller' else ''
                    raise ArgumentError(f'vary: {key} cannot vary; put it in `set` of an entry of `controllers`{other}')
                if node not in names_with_parameters():
                    hint = did_you_mean(node, names_with_parameters())
                    raise ArgumentError(f'vary: {key}: unknown node{hint}')
                raise ArgumentError(f'vary: {key}: unknown parameter{did_you_mean(name, known)}')
            if index is not None:
                for base in self._bases.values():
                    if name in base.values:
                        element(base.values[name], key, 'vary')
        for point in self.spec.points[:1]:
            for key in (key for key, varied in point.items() if varied.times_base):
                for base in self._bases.values():
                    scaled(base.value(key), 1.0, f'vary: {key}')

    def _check_after(self) -> None:
        """Reject a window of metrics that starts after the end of all runs with a controller."""
        after = self.spec.after
        if after is None or any(key.startswith('deterministic_timer:') for key in self.varied):
            return
        for name, base in self._bases.items():
            if base.end is not None and after > base.end:
                raise ArgumentError(f'after: {after:g} s is invalid: the runs of {name} end at {base.end:g} s')


class _Base:
    """The common parameters of all runs with a controller."""

    def __init__(self, spec: Spec, controller: CampaignController) -> None:
        command = ['--ros-args']
        for file in (*spec.files, *controller.files):
            command += ['--params-file', str(file)]
        settings = {**spec.values, **controller.values, 'rig:controller': controller.controller}
        for key, value in {**settings, 'rig:plot': False, 'deterministic_timer:progress': False}.items():
            command += ['-p', f'{key}:={written(value)}']
        try:
            self.arguments = parse_ros_arguments(command)
            simulation = Simulation(self.arguments)
        except (ParameterError, ArgumentError) as error:
            raise ArgumentError(f'{_entry(error, spec, controller)}: {error}') from error
        timer = simulation.timer
        self.end = simulation.last_tick * timer.sample_time if timer.duration > 0.0 else None
        """End time of its runs [s]; None if it depends on a plan."""
        self.nodes = nodes = simulation.nodes
        self.values: dict[str, Any] = {
            f'{name.rsplit("/", 1)[-1]}:{parameter}': value
            for name, node in nodes.items()
            for parameter, value in node['parameters'].items()
        }
        self.seeds = tuple(
            key
            for key in self.values
            # The seed of a reference defines the task, not a disturbance.
            if key.rpartition(':')[2].rpartition('.')[2] == 'seed' and not key.startswith(f'{REFERENCE_GENERATOR}:')
        )

    def value(self, key: str) -> Any:
        """Return the base value of a parameter, or of an element."""
        name, index = list_and_index(key)
        if name not in self.values:
            raise ArgumentError(
                f'vary: {key}: times_base is invalid: a controller of the campaign lacks this parameter'
            )
        return self.values[name] if index is None else element(self.values[name], key, 'vary')


def _entry(error: ParameterError | ArgumentError, spec: Spec, controller: CampaignController) -> str:
    """Return the entry of the specification that caused a parameter error."""
    own = f'controllers: {controller.name}'
    for values, entry in ((controller.values, f'{own}: set'), (spec.values, 'set')):
        for key in values:
            is_unknown = key.partition(':')[0] not in names_with_parameters()
            if error.name == key if isinstance(error, ParameterError) else is_unknown:
                return entry
    return own
