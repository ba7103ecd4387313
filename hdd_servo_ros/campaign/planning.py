"""The runs of a campaign, each with the parameters that it sets, checked before the first one runs."""

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
    One run of a campaign, all that a worker needs to make it.

    Attributes
    ----------
    number
        Its row in the table, from 0.
    controller
        Name of the controller, as the table has it.
    seed
        Of sensors and disturbances; None for those of the files.
    varied
        The parameters that vary and their values in this run, under ``'node:parameter'``, elements of lists under
        ``'node:parameter[index]'``; of a whole list that is scaled, the factor.
    lists
        The lists that are scaled or of which elements vary, as this run has them, under ``'node:parameter'``.
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
        """All that this run sets beyond its base, under ``'node:parameter'``."""
        seed = {} if self.seed is None else dict.fromkeys(self.seeds, self.seed)
        whole = {key: value for key, value in self.varied.items() if list_and_index(key)[1] is None}
        # Over a whole list's factor, too.
        return {**whole, **self.lists, **seed}

    def arguments(self, further: Mapping[str, object] | None = None) -> RosArguments:
        """Return the run's parameters as `simulate` takes them, with ``further`` ones over them."""
        overrides = {node: dict(values) for node, values in self.base.overrides.items()}
        for key, value in {**self.settings, **(further or {})}.items():
            node, _, name = key.partition(':')
            # Behind all others, which it overrides; a wildcard in a file may match the node as well.
            section = overrides.pop(node, {})
            overrides[node] = {**section, name: value}
        return RosArguments(overrides, list(self.base.named), self.base.remaps)

    def command(self, base_file: Path, run_dir: str) -> str:
        """
        Return a command that makes this run again and records it.

        Parameters
        ----------
        base_file
            Parameter file of the base, by :meth:`Plan.base_files`.
        run_dir
            Folder of the recorded run.
        """
        arguments = ['--params-file', str(base_file)]
        for key, value in {**self.settings, 'bag_recorder:run_dir': run_dir}.items():
            arguments += ['-p', f'{key}:={written(value)}']
        return f'ros2 run hdd_servo_ros simulate --ros-args {shlex.join(arguments)}'


class Plan(LazySequence[CampaignRun]):
    """
    All runs of a campaign.

    For each point its controllers, for each of these its seeds: runs 0 to ``len(plan) - 1``.

    Parameters
    ----------
    spec
        The campaign.

    Raises
    ------
    ArgumentError, ParameterError
        If a file, a parameter or a controller of the specification is not allowed. Values that vary are not checked: a
        run that they reject is a row with that reason.
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
        """How many runs, and of what they are the product."""
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
                    # The table has the factor, a number to sort and to draw by.
                    lists[key] = value
                else:
                    values[key] = value
        lists |= with_elements(base.values, values)
        return CampaignRun(number, controller.name, seed, values, lists, base.seeds, base.arguments)

    @property
    def varied(self) -> tuple[str, ...]:
        """The parameters that vary, under ``'node:parameter'``."""
        return tuple(self.spec.points[0])

    @property
    def contents(self) -> dict[str, Any]:
        """What the table depends on beside the base parameters, as ``campaign.yaml`` has it."""
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

        What the runs read beside them has :attr:`files`.
        """
        texts = [self.contents, self.base_files()]
        return hashlib.blake2b(json.dumps(texts).encode(), digest_size=16).hexdigest()

    @property
    def files(self) -> Iterator[object]:
        """The values of parameters, beside those of the nodes, that may name files which the runs read."""
        for base in self._bases.values():
            yield from base.arguments.parameters_of(PLAYBACK).values()
        texts = {key for point in self.spec.points[:1] for key, varied in point.items() if type(varied.value) is str}
        if texts:
            yield from dict.fromkeys(point[key].value for point in self.spec.points for key in texts)

    @property
    def nodes(self) -> list[dict[str, dict[str, Any]]]:
        """Of each controller the nodes of its runs, with the parameters of the base."""
        return [base.nodes for base in self._bases.values()]

    def base_files(self) -> dict[str, str]:
        """Return for each controller, by its name, a parameter file of what all its runs have in common."""
        return {name: written_file(base.arguments.overrides) for name, base in self._bases.items()}

    def _check_varied(self) -> None:
        """Reject parameters that no controller's run has."""
        known = sorted({key for base in self._bases.values() for key in base.values})
        for key in self.varied:
            name, index = list_and_index(key)
            if name not in known:
                node = name.partition(':')[0]
                if node == 'rig':
                    other = '; list them under `controllers`' if name == 'rig:controller' else ''
                    raise ArgumentError(
                        f'vary: {key} does not vary, but can be in `set` of an entry of `controllers`{other}'
                    )
                if node not in names_with_parameters():
                    hint = did_you_mean(node, names_with_parameters())
                    raise ArgumentError(f'vary: {key}: no such node{hint}')
                raise ArgumentError(f'vary: {key}: no run has such a parameter{did_you_mean(name, known)}')
            if index is not None:
                for base in self._bases.values():
                    if name in base.values:
                        element(base.values[name], key, 'vary')
        for point in self.spec.points[:1]:
            for key in (key for key, varied in point.items() if varied.times_base):
                for base in self._bases.values():
                    scaled(base.value(key), 1.0, f'vary: {key}')

    def _check_after(self) -> None:
        """Reject a time before which errors do not count that is behind the end of all runs with a controller."""
        after = self.spec.after
        if after is None or any(key.startswith('deterministic_timer:') for key in self.varied):
            return
        for name, base in self._bases.items():
            if base.end is not None and after > base.end:
                raise ArgumentError(f'after: {after:g} s is not allowed: the runs of {name} end at {base.end:g} s')


class _Base:
    """What all runs with a controller have in common."""

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
        """When its runs end [s], None if that depends on a plan."""
        self.nodes = nodes = simulation.nodes
        self.values: dict[str, Any] = {
            f'{name.rsplit("/", 1)[-1]}:{parameter}': value
            for name, node in nodes.items()
            for parameter, value in node['parameters'].items()
        }
        self.seeds = tuple(
            key
            for key in self.values
            # The seeds of a reference say what is to be done, not by what chance it is disturbed.
            if key.rpartition(':')[2].rpartition('.')[2] == 'seed' and not key.startswith(f'{REFERENCE_GENERATOR}:')
        )

    def value(self, key: str) -> Any:
        """Return the base value of a parameter, or of an element."""
        name, index = list_and_index(key)
        if name not in self.values:
            raise ArgumentError(
                f'vary: {key}: times_base is not allowed: a controller of the campaign has no such value'
            )
        return self.values[name] if index is None else element(self.values[name], key, 'vary')


def _entry(error: ParameterError | ArgumentError, spec: Spec, controller: CampaignController) -> str:
    """Return the entry of the specification that an error of the parameters with a controller is about."""
    own = f'controllers: {controller.name}'
    for values, entry in ((controller.values, f'{own}: set'), (spec.values, 'set')):
        for key in values:
            is_unknown = key.partition(':')[0] not in names_with_parameters()
            if error.name == key if isinstance(error, ParameterError) else is_unknown:
                return entry
    return own
