"""
`simulate`: the same experiment as `rig` without middleware, from the same parameters into the same bag.

No ROS import: the loop is one compiled kernel, and its rows are packed into the bytes that the nodes would publish.
"""

import heapq
import itertools
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from hdd_servo_ros.bench.dsp import ControllerOutputParameters
from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.graph.catalogue import CONTROLLERS, NODE_PARAMETERS, refuse_unknown
from hdd_servo_ros.graph.controller_loader import ControllerKind, load_controller
from hdd_servo_ros.graph.help import COMPILING, parse_help
from hdd_servo_ros.messages.cdr import ArrayCodec, VectorCodec, array_rows, clock_rows, stamp_rows, vector_rows
from hdd_servo_ros.messages.errors import NotFiniteError
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.ticks import Ticks, sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import CLOCK, CONTROL, ESTIMATES, HEAD, LDV, LOOP_TOPICS, REFERENCE, LoopTopic
from hdd_servo_ros.numerics.compiled import first_compilation
from hdd_servo_ros.parameters import ParameterError, Value, declarations, from_mapping, to_mapping
from hdd_servo_ros.parameters.events import NodeChange, pack_parameter_event
from hdd_servo_ros.parameters.files import ArgumentError, RosArguments, parse_ros_arguments, with_node
from hdd_servo_ros.parameters.run_parameters import (
    DriveNameParameters,
    RecorderParameters,
    RigParameters,
    TimerParameters,
    last_tick_of_run,
)
from hdd_servo_ros.parameters.schedule import Step, plan, refuse_strangers
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.reporting.progress import Progress
from hdd_servo_ros.reporting.response import write_response
from hdd_servo_ros.simulation.experiment import Experiment

CHUNK = 4096
"""Ticks that are computed, packed and written in one piece."""
PYTHON_CHUNK = 256
"""The same with a controller that is called from Python: signals are looked at between two pieces."""

_OUTPUTS: dict[str, tuple[LoopTopic, ...]] = {
    'deterministic_timer': (CLOCK,),
    'reference_generator': (REFERENCE,),
    'vcm_plant': (HEAD,),
    'ldv_sensor': (LDV,),
    'bag_recorder': (),
}


class Simulation:
    """
    One run of the loop, described by ROS arguments.

    Parameters
    ----------
    arguments
        The command line.

    Raises
    ------
    ParameterError, ArgumentError
        If a parameter or argument is not allowed; the message names the node.
    """

    def __init__(self, arguments: RosArguments) -> None:
        # First of all, so that the parameters of a controller from outside are known ones.
        outside = _outside_controller(arguments)
        arguments.check_nodes(list(NODE_PARAMETERS))
        self.rig: RigParameters = self._sets(arguments, 'simulate', 'rig')[RigParameters]
        controller = CONTROLLERS[self.rig.controller] if outside is None else outside.node
        outputs = {**_OUTPUTS, controller: (CONTROL, ESTIMATES)}
        names = ['deterministic_timer', 'reference_generator', 'vcm_plant', 'ldv_sensor', controller, 'bag_recorder']
        sets = {name: self._sets(arguments, name) for name in names}
        self.timer: TimerParameters = sets['deterministic_timer'][TimerParameters]
        self.recorder: RecorderParameters = sets['bag_recorder'][RecorderParameters]
        self.frame_id = sets['vcm_plant'][DriveNameParameters].frame_id
        self._check_sample_times(sets)
        mappings = {
            name: {key: value for values in kinds.values() for key, value in to_mapping(values).items()}
            for name, kinds in sets.items()
        }
        self._namespace = arguments.namespace.rstrip('/')
        self.topics = [(topic, self._full_name(topic, arguments)) for topic in LOOP_TOPICS]
        by_topic = dict(self.topics)
        units = {'frame_id': self.frame_id} | {
            key: str(mappings['vcm_plant'][key]) for key in ('length_unit', 'control_unit')
        }
        offers = {'vcm_plant': units, controller: {} if outside is None else outside.offers()}
        self.nodes: dict[str, dict[str, Any]] = {
            f'{self._namespace}/{name}': {
                'outputs': [by_topic[topic] for topic in outputs[name]],
                'offers': offers.get(name, {}),
                'parameters': mappings[name],
            }
            for name in names
        }
        self.offers = {key: text for texts in offers.values() for key, text in texts.items()}
        blocks = {
            name: {
                key: value
                for kind, values in sets[name].items()
                if kind in (NODE_PARAMETERS[name][-1], ControllerOutputParameters)
                for key, value in to_mapping(values).items()
            }
            for name in names
        }
        self.schedule = self._plan(sets, mappings)
        self.experiment = Experiment(self.timer.sample_time, self.rig.controller, blocks)
        needed: int = getattr(self.experiment.controller, 'last_tick', 0)
        self.last_tick = last_tick_of_run(self.timer, {controller: needed} if needed else {})

    @staticmethod
    def _sets(arguments: RosArguments, node: str, *aliases: str) -> dict[type[Any], Any]:
        """Return a node's parameter sets, checked as the node itself would check them."""
        values = {}
        for name in (*aliases, node):
            values.update(arguments.parameters_of(name))
        sets = {}
        try:
            for kind in NODE_PARAMETERS[node]:
                known = {declaration.name for declaration in declarations(kind)}
                sets[kind] = from_mapping(kind, {name: values.pop(name) for name in known & values.keys()})
        except ParameterError as error:
            raise with_node(error, node) from None
        # What every ROS node has, and `ros2 param dump` writes.
        for name in ('use_sim_time', 'start_type_description_service'):
            values.pop(name, None)
        try:
            refuse_unknown(values)
        except ParameterError as error:
            # What was given for all nodes is missing in all.
            raise error if arguments.is_for_all(error.name) else with_node(error, node) from None
        return sets

    def _plan(
        self, sets: Mapping[str, Mapping[type[Any], Any]], mappings: Mapping[str, Mapping[str, Value]]
    ) -> list[tuple[str, Step]]:
        """Return what the schedule changes, node and step, in the order of the ticks."""
        changes = self.timer.changes
        full_names = {name: f'{self._namespace}/{name}' for name in sets}
        refuse_strangers(changes, list(full_names.values()))
        steps = [
            (name, step)
            for name, kinds in sets.items()
            for step in plan(changes, full_names[name], list(kinds), mappings[name])
        ]
        return sorted(steps, key=lambda planned: planned[1].tick)

    def apply_schedule(self, tick: int) -> Iterator[NodeChange]:
        """Make the changes that are due before ``tick``; yield each as a parameter event would say it."""
        while self.schedule and self.schedule[0][1].tick <= tick:
            name, step = self.schedule.pop(0)
            self.experiment.update(name, step.sets)
            yield NodeChange(
                f'{self._namespace}/{name}', tick * sample_time_to_nanoseconds(self.timer.sample_time), step.values
            )

    def pieces(self, last_tick: int) -> Iterator[tuple[int, int]]:
        """Iterate over first tick and count of what is run in one piece: no piece goes beyond a scheduled change."""
        chunk = CHUNK if self.experiment.is_compiled else PYTHON_CHUNK
        changes = sorted({step.tick for _, step in self.schedule})
        # Merged as they come: the pieces of a run of days are too many to keep.
        merged = heapq.merge(changes, range(0, last_tick + 1, chunk), (last_tick + 1,))
        starts = (start for start, _ in itertools.groupby(merged))
        yield from ((start, end - start) for start, end in itertools.pairwise(starts))

    def _check_sample_times(self, sets: dict[str, dict[type[Any], Any]]) -> None:
        for name, kinds in sets.items():
            for values in kinds.values():
                own = getattr(values, 'sample_time', 0.0)
                if own not in (0.0, self.timer.sample_time):
                    allowed = f'deterministic_timer has {self.timer.sample_time!r} s'
                    raise ParameterError(f'{name}:sample_time', own, allowed)

    def _full_name(self, topic: LoopTopic, arguments: RosArguments) -> str:
        name = arguments.remaps.get(topic.name, topic.name)
        return name if name.startswith('/') else f'{self._namespace}/{name}'

    def say_not_finite(self, topic: LoopTopic, tick: int, values: tuple[float, ...]) -> str:
        """Return what the graph says of a message that is not finite."""
        name = dict(self.topics)[topic]
        (node,) = (node.rsplit('/', 1)[-1] for node, said in self.nodes.items() if name in said['outputs'])
        return str(NotFiniteError(name, tick, values, node))

    def description(self) -> dict[str, Any]:
        """Return what ``run.yaml`` says of the run before it has ended."""
        return {
            'sample_time': self.timer.sample_time,
            'last_tick_planned': self.last_tick,
            'duration': self.last_tick * self.timer.sample_time,
            'rate': 0.0,
            **self.offers,
            'nodes': self.nodes,
        }


def _outside_controller(arguments: RosArguments) -> ControllerKind | None:
    """Return the controller that was asked for if it is none of this package's."""
    name = {**arguments.parameters_of('rig'), **arguments.parameters_of('simulate')}.get('controller')
    return load_controller(name) if isinstance(name, str) and name not in CONTROLLERS else None


class Packer:
    """Turns rows into messages, in the order in which the recorder of the graph writes them."""

    def __init__(self, ticks: Ticks, frame_id: str, controller: Controller) -> None:
        self._ticks = ticks
        self._vector = VectorCodec(frame_id)
        self._array = ArrayCodec(controller.estimate_names)

    def pack(self, rows: SignalRows) -> tuple[list[int], list[int], list[memoryview]]:
        """Return topic, time [ns] and payload of every message of the rows."""
        count = len(rows)
        times = np.arange(rows.first_tick, rows.first_tick + count, dtype=np.int64) * self._ticks.sample_time_ns
        stamps = stamp_rows(times)
        by_topic = (
            clock_rows(stamps),
            vector_rows(self._vector, stamps, rows.reference),
            vector_rows(self._vector, stamps, rows.head),
            vector_rows(self._vector, stamps, rows.ldv),
            vector_rows(self._vector, stamps, rows.control),
            array_rows(self._array, rows[ESTIMATES.name]),
        )
        kinds = len(by_topic)
        payloads: list[Any] = [None] * (count * kinds)
        for place, messages in enumerate(by_topic):
            size = messages.shape[1]
            flat = messages.reshape(-1).data
            payloads[place::kinds] = [flat[start : start + size] for start in range(0, count * size, size)]
        return list(range(kinds)) * count, np.repeat(times, kinds).tolist(), payloads


def first_not_finite(rows: SignalRows) -> tuple[LoopTopic, int, tuple[float, ...]] | None:
    """Return topic, tick and values of the first message that is not finite, None if all are."""
    found = []
    signals = {REFERENCE: rows.reference, HEAD: rows.head, LDV: rows.ldv, CONTROL: rows.control}
    for order, (topic, values) in enumerate(signals.items()):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            found.append((int(bad[0]), order, topic))
    if not found:
        return None
    row, _, topic = min(found)
    x, y, z = signals[topic][row].tolist()
    return topic, rows.first_tick + row, (x, y, z)


def simulate(simulation: Simulation, *, progress: bool) -> tuple[int, Path | None]:
    """
    Run a simulation, recording it unless its timer's parameter ``record`` is false.

    Returns
    -------
    exit_code, directory
        As of `rig`; the run's folder, None if it was not recorded.
    """
    last_tick, parameters = simulation.last_tick, simulation.recorder
    simulation.experiment.compile()
    for warning in simulation.experiment.warnings():
        print(f'simulate: warning: {warning}', file=sys.stderr)
    recorder = None
    if simulation.timer.record:
        recorder = RunRecorder(
            parameters.run_dir,
            parameters.storage,
            simulation.topics,
            simulation.description(),
            separate_process=False,
        )
    interrupted: list[int] = []

    def take_signal(number: int, frame: FrameType | None) -> None:
        if interrupted:
            # Asked twice: a step that never returns keeps the first from being looked at.
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        interrupted.append(number)

    previous = {number: signal.signal(number, take_signal) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    status, reason, exit_code = FINISHED, '', 0
    warned: frozenset[str] = frozenset()
    try:
        packer = Packer(Ticks(simulation.timer.sample_time), simulation.frame_id, simulation.experiment.controller)
        rows: SignalRows | None = None
        shown = Progress('simulate', last_tick, simulation.timer.sample_time) if progress else None
        if shown is not None:
            shown.show(0)
        for first_tick, count in simulation.pieces(last_tick):
            if rows is None or len(rows) != count:
                rows = simulation.experiment.empty_rows(first_tick, count)
            try:
                for change in simulation.apply_schedule(first_tick):
                    if recorder is not None:
                        recorder.write_parameter_event(change.time_ns, pack_parameter_event(change))
                rows = simulation.experiment.run(first_tick, count, rows)
            except ControllerError as error:
                status, reason, exit_code = FAILED, str(error), 1
                # A change that fails does so after the tick before.
                rows = rows.starting_at(first_tick).before(max(error.tick, first_tick))
            warned = _warn_of_saturation(simulation.experiment, warned)
            bad = first_not_finite(rows)
            if bad is not None:
                told = getattr(simulation.experiment.controller, 'fault', str)()
                status, reason, exit_code = FAILED, told or simulation.say_not_finite(*bad), 1
                rows = rows.before(bad[1])
            if recorder is not None and len(rows):
                recorder.write_ticks(rows.first_tick + len(rows) - 1, *packer.pack(rows))
            if shown is not None:
                shown.show(first_tick + len(rows) - 1)
            if interrupted:
                name = signal.Signals(interrupted[0]).name
                status, reason = INTERRUPTED, f'{name} at tick {first_tick + count - 1}'
                exit_code = 128 + interrupted[0]
            if status != FINISHED:
                break
        if shown is not None:
            shown.close()
    except BaseException as error:
        status, reason, exit_code = FAILED, f'{type(error).__name__}: {error}', 1
        raise
    finally:
        if recorder is not None:
            recorder.finish(status, reason)
        if isinstance(simulation.experiment.controller, SignalAnalyzer):
            for line in write_response(
                simulation.experiment.controller, None if recorder is None else recorder.directory
            ):
                print(f'simulate: {line}', file=sys.stderr)
        for number, handler in previous.items():
            signal.signal(number, handler)
    if status != FINISHED:
        print(f'simulate: run {status}: {reason}', file=sys.stderr)
    return exit_code, None if recorder is None else recorder.directory


def _warn_of_saturation(experiment: Experiment, warned: frozenset[str]) -> frozenset[str]:
    """Tell of vibrometer outputs that have saturated since, as the node does; return all those told of."""
    warnings = experiment.ldv.saturation_warnings()
    for output in sorted(warnings.keys() - warned):
        print(f'simulate: warning: ldv_sensor: {warnings[output]}', file=sys.stderr)
    return frozenset(warnings)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment; exit codes as of `rig`."""
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    try:
        parsed = parse_ros_arguments(command_line)
        parse_help('simulate', parsed.others)
        if first_compilation():
            print(f'simulate: {COMPILING}', file=sys.stderr, flush=True)
        simulation = Simulation(parsed)
        exit_code, directory = simulate(simulation, progress=simulation.timer.progress)
    except (ParameterError, ArgumentError, ControllerError, OSError) as error:
        print(f'simulate: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        # Compiling takes a while, and nothing is recorded yet.
        print('simulate: interrupted before the run began', file=sys.stderr)
        return 128 + signal.SIGINT
    if exit_code == 0 and directory is not None:
        # Imported late: a run that draws nothing need not wait for matplotlib.
        from hdd_servo_ros.reporting.show import show_run

        show_run(directory, plot=simulation.rig.plot)
    return exit_code


if __name__ == '__main__':
    sys.exit(main())
