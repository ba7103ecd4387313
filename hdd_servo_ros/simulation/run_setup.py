"""Setup of a run from its command line: nodes, parameters, topics, schedule, experiment."""

import heapq
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.parameter_trial import (
    Attempt,
    Sets,
    attempt_change,
    attempt_for,
    has_extremes,
    reject_failing,
)
from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters
from hdd_servo_ros.control.controller import HasPlan
from hdd_servo_ros.control.feedforward_parameters import ControllerFeedforwardParameters
from hdd_servo_ros.control.observer import ControllerObserverParameters
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.control.runout_parameters import ControllerRunoutParameters
from hdd_servo_ros.control.seek_parameters import ControllerSeekParameters, SeekControllerParameters
from hdd_servo_ros.graph.catalog import (
    CONTROLLERS,
    NODES,
    names_with_parameters,
    nodes_of_run,
    parameter_sets,
)
from hdd_servo_ros.graph.connections import outputs_of
from hdd_servo_ros.graph.controller_loader import ControllerKind, load_controller
from hdd_servo_ros.graph.known_parameters import reject_unknown, take_standard
from hdd_servo_ros.graph.rig_parameters import RigParameters
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR, PLAYBACK, roles_of_run
from hdd_servo_ros.graph.topic_names import topic_names
from hdd_servo_ros.messages.errors import NotFiniteError
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import CONTROL_UPDATES, ESTIMATES, OPTIONAL_TOPICS, LoopTopic, topics_of_run
from hdd_servo_ros.parameters import (
    InvalidParameterError,
    ParameterError,
    Value,
    declarations,
    from_mapping,
    to_mapping,
)
from hdd_servo_ros.parameters.events import NodeChange
from hdd_servo_ros.parameters.files import RosArguments, with_node
from hdd_servo_ros.parameters.run_parameters import (
    DriveIdentityParameters,
    PlaybackParameters,
    RecorderParameters,
    TimerParameters,
    last_tick_of_run,
)
from hdd_servo_ros.parameters.schedule import Step, plan, reject_unknown_nodes
from hdd_servo_ros.recording.playback import Playback
from hdd_servo_ros.simulation.disturbance import DisturbanceSource
from hdd_servo_ros.simulation.experiment import Experiment

CHUNK = 4096
"""Number of ticks that are computed, packed and written in one piece."""
PYTHON_CHUNK = 256
"""Piece length with a controller called from Python; shorter, because interrupts are checked between pieces."""


_AROUND_A_CONTROLLER = (
    ControllerInputParameters,
    ControllerOutputParameters,
    ControllerFeedforwardParameters,
    ControllerRunoutParameters,
    ControllerObserverParameters,
    ControllerSeekParameters,
    SeekControllerParameters,
)
"""Parameter sets of a controller node for the blocks around the controller."""


class Simulation:
    """
    Run of the loop, described by ROS arguments.

    Parameters
    ----------
    arguments
        Parsed command line.

    Raises
    ------
    ParameterError, ArgumentError
        If a parameter or argument is invalid; the message names the node.
    """

    def __init__(self, arguments: RosArguments) -> None:
        # Load a custom controller first, so that its parameters are known.
        custom = _custom_controller(arguments)
        arguments.check_nodes(names_with_parameters())
        self.rig: RigParameters = self._sets(arguments, 'simulate', 'rig')[RigParameters]
        controller = CONTROLLERS[self.rig.controller] if custom is None else custom.node
        names = nodes_of_run(roles_of_run(controller, arguments, self.rig.sensor))
        playback: PlaybackParameters = self._sets(arguments, PLAYBACK)[PlaybackParameters]
        self.playback = Playback(playback.recorded_run) if playback.recorded_run else None
        sets = {name: self._sets(arguments, name) for name in names}
        self.timer: TimerParameters = sets['deterministic_timer'][TimerParameters]
        self.recorder: RecorderParameters = sets['bag_recorder'][RecorderParameters]
        self.frame_id = sets['vcm_plant'][DriveIdentityParameters].frame_id
        self._check_sample_times(sets)
        by_kind = {name: {kind: to_mapping(values) for kind, values in kinds.items()} for name, kinds in sets.items()}
        mappings = {
            name: {key: value for values in kinds.values() for key, value in values.items()}
            for name, kinds in by_kind.items()
        }
        arguments.check_names('simulate', ['rig', *names])
        self._full_names = {name: arguments.full_name(name) for name in names}
        by_contract = topic_names(arguments, names)
        optional = set(self._optional_topics(names))
        if not sets[controller][ControllerOutputParameters].dsp.is_multirate:
            optional.discard(CONTROL_UPDATES)
        self.topics = [(topic, by_contract[topic]) for topic in topics_of_run(tuple(optional))]
        by_topic = dict(self.topics)
        units = {'frame_id': self.frame_id} | {
            key: str(mappings['vcm_plant'][key]) for key in ('length_unit', 'control_unit')
        }
        offers = {'vcm_plant': units, controller: {} if custom is None else custom.offers()}
        self.nodes: dict[str, dict[str, Any]] = {
            self._full_names[name]: {
                'outputs': [by_topic[topic] for topic in outputs_of(name) if topic in by_topic],
                'offers': offers.get(name, {}),
                'parameters': mappings[name],
            }
            for name in names
        }
        self.offers = {key: value for values in offers.values() for key, value in values.items()}
        blocks = {name: _of_blocks(name, by_kind[name]) for name in names}
        self.schedule = self._plan(sets, mappings)
        disturbance = None if self.playback is None else _PlayedDisturbance(self.playback)
        self.experiment = self._experiment(sets, blocks, disturbance, custom)
        self._check_schedule(sets, custom)
        law = self.experiment.controller
        needed = law.last_tick if isinstance(law, HasPlan) else 0
        self.last_tick = last_tick_of_run(self.timer, {controller: needed} if needed else {})
        if self.playback is not None:
            self.playback.check(self.timer.sample_time, self.last_tick)

    def _experiment(
        self,
        sets: Mapping[str, Sets],
        blocks: Mapping[str, Mapping[str, object]],
        disturbance: DisturbanceSource | None,
        custom: ControllerKind | None,
    ) -> Experiment:
        """Return the experiment; raises ParameterError if a block cannot be built or stepped with its parameters."""
        # With ordinary values, errors are found when the blocks are built.
        if any(has_extremes(kinds.values()) for kinds in sets.values()):
            self._check_start(sets, custom)
        try:
            return Experiment(
                self.timer.sample_time, self.rig.controller, blocks, disturbance=disturbance, sensor=self.rig.sensor
            )
        except (ParameterError, ControllerError):
            raise
        except Exception:
            # Find the parameter at fault; if no single parameter is, the original exception is more informative.
            self._check_start(sets, custom)
            raise

    def _check_start(self, sets: Mapping[str, Sets], custom: ControllerKind | None) -> None:
        for name, kinds in sets.items():
            attempt = self._attempt(name, sets, kinds, custom, is_change=False)
            if attempt is not None:
                try:
                    reject_failing(name, kinds, {kind: kind() for kind in kinds}, attempt)
                except ParameterError as error:
                    raise with_node(error, name) from error.__cause__

    def _check_schedule(self, sets: Mapping[str, Sets], custom: ControllerKind | None) -> None:
        """Reject a schedule if a node cannot run after one of its changes."""
        accepted = dict(sets)
        for name, step in self.schedule:
            attempt = self._attempt(name, sets, step.sets, custom, is_change=True)
            if attempt is not None:
                try:
                    reject_failing(name, step.sets, accepted[name], attempt)
                except ParameterError as error:
                    raise InvalidParameterError('schedule', step.entry, str(error)) from error.__cause__
            accepted[name] = step.sets

    def _attempt(
        self, name: str, sets: Mapping[str, Sets], own: Sets, custom: ControllerKind | None, *, is_change: bool
    ) -> Attempt | None:
        """Return the trial of a node's parameters, the same as in the node itself."""
        if is_change and name == DISTURBANCE_GENERATOR:
            # Use the existing generator, because a new one would read its files again.
            return attempt_change(name, self.experiment.block(name), is_change=True)
        make = custom.make if custom is not None and name == custom.node else None

        def block_of(other: str) -> Any:
            return sets[other][NODES[other].block_parameters] if other in sets else None

        return attempt_for(name, self.timer.sample_time, own, block_of, make=make, is_change=is_change)

    def _optional_topics(self, names: Sequence[str]) -> Iterator[LoopTopic]:
        """Return the optional topics that nodes of this run publish, in the order of the recorder."""
        played = () if self.playback is None else self.playback.topics
        written = {topic for name in names for topic in (played if name == PLAYBACK else outputs_of(name))}
        return (topic for topic in OPTIONAL_TOPICS if topic in written)

    @staticmethod
    def _sets(arguments: RosArguments, node: str, *aliases: str) -> dict[type[Any], Any]:
        """Return the parameter sets of a node, with the same checks as in the node itself."""
        values = {}
        for name in (*aliases, node):
            values.update(arguments.parameters_of(name))
        sets = {}
        try:
            for kind in parameter_sets(node):
                known = {declaration.name for declaration in declarations(kind)}
                sets[kind] = from_mapping(kind, {name: values.pop(name) for name in known & values.keys()})
        except ParameterError as error:
            raise with_node(error, node) from None
        take_standard(values)
        try:
            reject_unknown(values)
        except ParameterError as error:
            # Do not name one node for a parameter that was given for all nodes.
            raise error if arguments.is_for_all(error.name) else with_node(error, node) from None
        return sets

    def _plan(
        self, sets: Mapping[str, Mapping[type[Any], Any]], mappings: Mapping[str, Mapping[str, Value]]
    ) -> list[tuple[str, Step]]:
        """Return the scheduled changes, as pairs of node and step, in the order of the ticks."""
        changes = self.timer.changes
        reject_unknown_nodes(changes, list(self._full_names.values()))
        steps = [
            (name, step)
            for name, kinds in sets.items()
            for step in plan(changes, self._full_names[name], list(kinds), mappings[name])
        ]
        return sorted(steps, key=lambda planned: planned[1].tick)

    def apply_schedule(self, tick: int) -> Iterator[NodeChange]:
        """Apply the scheduled changes up to ``tick``; yield each change with the content of its parameter event."""
        while self.schedule and self.schedule[0][1].tick <= tick:
            name, step = self.schedule.pop(0)
            self.experiment.update(name, step.sets)
            yield NodeChange(
                self._full_names[name], tick * sample_time_to_nanoseconds(self.timer.sample_time), step.values
            )

    def recorded_messages(self, rows: SignalRows) -> dict[str, Any]:
        """Return the messages played back from another run for the ticks of the rows, by topic."""
        if self.playback is None:
            return {}
        return {topic.name: self.playback.messages(topic, rows.first_tick, len(rows)) for topic in self.playback.topics}

    def pieces(self, last_tick: int) -> Iterator[tuple[int, int]]:
        """Yield first tick and number of ticks of each piece; a scheduled change starts a new piece."""
        chunk = CHUNK if self.experiment.is_compiled else PYTHON_CHUNK
        changes = sorted({step.tick for _, step in self.schedule})
        # Merge lazily, because a run of days has too many pieces for a list.
        merged = heapq.merge(changes, range(0, last_tick + 1, chunk), (last_tick + 1,))
        starts = (start for start, _ in itertools.groupby(merged))
        yield from ((start, end - start) for start, end in itertools.pairwise(starts))

    def _check_sample_times(self, sets: dict[str, dict[type[Any], Any]]) -> None:
        for name, kinds in sets.items():
            for values in kinds.values():
                own = getattr(values, 'sample_time', 0.0)
                if own not in (0.0, self.timer.sample_time):
                    allowed = f'{self.timer.sample_time!r} s, the sample_time of deterministic_timer'
                    raise ParameterError(f'{name}:sample_time', own, allowed)

    def not_finite(self, topic: LoopTopic, tick: int, values: tuple[float, ...]) -> str:
        """Return the error message for a value that is not finite, the same as in the node graph."""
        name = dict(self.topics)[topic]
        (node,) = (node.rsplit('/', 1)[-1] for node, found in self.nodes.items() if name in found['outputs'])
        names = self.experiment.estimate_names if topic is ESTIMATES else ()
        return str(NotFiniteError(name, tick, values, node, names))

    def description(self) -> dict[str, Any]:
        """Return the entries of ``run.yaml`` that are known before the run has ended."""
        return {
            'sample_time': self.timer.sample_time,
            'last_tick_planned': self.last_tick,
            'duration': self.last_tick * self.timer.sample_time,
            'rate': 0.0,
            **self.offers,
            'nodes': self.nodes,
        }


class _PlayedDisturbance:
    """Recorded disturbance of another run."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback

    @property
    def topics(self) -> tuple[LoopTopic, ...]:
        """Recorded topics."""
        return self._playback.topics

    def rows(self, first_tick: int, count: int) -> list[NDArray[np.float64]]:
        """Return the recorded rows of each topic."""
        return [self._playback.rows(topic, first_tick, count) for topic in self.topics]


def _of_blocks(name: str, by_kind: Mapping[type[Any], Mapping[str, Value]]) -> dict[str, Value]:
    """Return the parameters of a node for its block and the blocks around it."""
    kinds = (NODES[name].block_parameters, *_AROUND_A_CONTROLLER)
    return {key: value for kind, values in by_kind.items() if kind in kinds for key, value in values.items()}


def _custom_controller(arguments: RosArguments) -> ControllerKind | None:
    """Return the requested controller if it is a custom one, or None if it is part of this package."""
    name = {**arguments.parameters_of('rig'), **arguments.parameters_of('simulate')}.get('controller')
    return load_controller(name) if isinstance(name, str) and name not in CONTROLLERS else None
