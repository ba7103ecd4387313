"""`bag_recorder`: records every topic of the run in a rosbag2 bag."""

import collections
import contextlib
import functools
import math
import subprocess
import sys
from array import array
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rcl_interfaces.msg import ParameterEvent
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.messages.cdr import ReportCodec, numbers
from hdd_servo_ros.messages.errors import NotFiniteError, RunError
from hdd_servo_ros.messages.outcome import Outcome
from hdd_servo_ros.messages.scope_blocks import Block, ScopeMessage, make_block
from hdd_servo_ros.messages.topics import PARAMETER_EVENTS, RECORDER, SCOPE
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.messages.unpacking import signals_of_messages
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.events import NodeChange, change_of_event, invalid_event_reason, pack_parameter_event
from hdd_servo_ros.parameters.run_parameters import RecorderParameters
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.ros.diagnosis import OK, Diagnosis
from hdd_servo_ros.ros.ignored_messages import IgnoredMessages
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.run_plan import RunPlan
from hdd_servo_ros.ros.untrusted import MessageError, message_of

_SCOPE_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
_PARAMETER_EVENTS_QOS = QoSProfile(depth=20_000, reliability=ReliabilityPolicy.RELIABLE)
"""Depth for all events between two rounds of housekeeping; a schedule may change every node at every tick."""
_REPORT_EVERY = 64
"""Ticks between two reports to the timer; much less than its window."""


class BagRecorder(CatalogNode):
    """
    Recorder that writes all messages of a tick before those of the next one.

    Parameters
    ----------
    process
        Process that writes the bag, from :func:`~hdd_servo_ros.recording.writer_process.launch_writer`; if None, this
        process writes it.
    """

    patience = 5e-3
    """A few ticks, much less than the window of the timer: no node waits for it, and waking up costs time [s]."""

    def __init__(self, *, process: 'subprocess.Popen[bytes] | None' = None) -> None:
        super().__init__(RECORDER)
        given = self.parameters[RecorderParameters].run_dir
        if given and Path(given).exists():
            allowed = 'a directory that does not exist yet, because a run is never overwritten'
            raise ParameterError(f'{self.get_name()}:run_dir', given, allowed)
        self._process = process
        self._recorder: RunRecorder | None = None
        self._run: RunPlan | None = None
        self._scope = self.create_publisher(Float64MultiArray, SCOPE, _SCOPE_QOS)
        self._is_watched = False
        self._watched: list[tuple[bytes, ...]] = []
        self._changes: collections.Counter[str] = collections.Counter()
        self._own_changes: list[NodeChange] = []
        self._own_nodes: frozenset[str] = frozenset()
        self._parameter_events = self.create_subscription(
            ParameterEvent, PARAMETER_EVENTS, self._take_parameter_event, _PARAMETER_EVENTS_QOS, raw=True
        )
        self._ignored = IgnoredMessages(self)

    @property
    def directory(self) -> str:
        """Directory of the run; empty before it is created."""
        return '' if self._recorder is None else str(self._recorder.directory)

    def prepare(self, run: RunPlan) -> None:
        self._run = run
        self._report_codec = ReportCodec(run.identifier)
        parameters = self.parameters[RecorderParameters]
        try:
            self._recorder = RunRecorder(
                parameters.run_dir,
                parameters.storage,
                [(port.topic, port.name) for port in self.inputs],
                run.description(),
                separate_process=self._process is not None,
                process=self._process,
                recorded=parameters.topics,
                options=BagOptions.of(parameters),
            )
        except ParameterError as error:
            raise RunError(str(error)) from None
        except OSError as error:
            raise RunError(
                f'{self.get_name()}: invalid value for parameter run_dir: {parameters.run_dir!r}; expected {error}'
            ) from None

    def try_fire(self) -> bool:
        return self._fire_together() if self._queues else super().try_fire()

    @functools.cached_property
    def _queues(self) -> list[collections.deque[bytes]]:
        """Queues of the inputs if nodes of this process fill all of them; otherwise empty."""
        queues = [port.queue for port in self.inputs if port.queue is not None]
        return queues if len(queues) == len(self.inputs) else []

    def _fire_together(self, *, with_fewer: bool = False) -> bool:
        """
        Fire for all ticks up to the next report or scheduled change at once, when their messages have arrived.

        This costs a fraction of the time for firing tick by tick.

        Parameters
        ----------
        with_fewer
            Whether to fire for fewer ticks if not all messages have arrived.
        """
        tick, queues = self.tick, self._queues
        if tick >= self._halt and not self._passes():
            return False
        most = min(-tick % _REPORT_EVERY + 1, self._halt - tick)
        least = 1 if with_fewer else most
        if len(queues[0]) < least:
            return False
        count = min(most, *map(len, queues))
        if count < least:
            return False
        columns = [[queue.popleft() for _ in range(count)] for queue in queues]
        assert self._recorder is not None
        for index, publisher in self._external:
            for offset, message in enumerate(columns[index]):
                self._reject_not_finite(tick + offset, index, publisher, message)
        stamps = [self._ticks.nanoseconds(each) for each in range(tick, tick + count)]
        self._recorder.write_columns(tick, stamps, columns)
        if self._is_watched:
            self._watched.extend(zip(*columns, strict=True))
        self._report(tick + count - 1)
        self.tick = tick + count
        return True

    @functools.cached_property
    def _external(self) -> list[tuple[int, str]]:
        """Index and publisher of the inputs from external nodes; nodes of this package check their own values."""
        assert self._run is not None
        publishers = [
            (index, self._run.publisher_of(port.name) or 'an external node')
            for index, port in enumerate(self.inputs)
            if port.topic.codec.width != 0
        ]
        return [(index, name) for index, name in publishers if name.rsplit('/', 1)[-1] not in NODES]

    def _reject_not_finite(self, tick: int, index: int, publisher: str, message: bytes) -> None:
        port = self.inputs[index]
        try:
            values = numbers(port.topic.codec, message)
        except ValueError as error:
            raise RunError(f'{port.name}: tick {tick}: {error}; published by {publisher}') from None
        if not all(map(math.isfinite, values)):
            raise NotFiniteError(port.name, tick, values, publisher)

    def _fire_once(self) -> bool:
        return self._fire_together(with_fewer=True) if self._queues else self.try_fire()

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        assert self._recorder is not None
        for index, publisher in self._external:
            self._reject_not_finite(tick, index, publisher, messages[index])
        self._recorder.write_tick(tick, self._ticks.nanoseconds(tick), messages)
        if self._is_watched:
            self._watched.append(tuple(messages))
        self._report(tick)

    def _report(self, tick: int) -> None:
        if not tick % _REPORT_EVERY:
            self.publish_bytes(0, self._report_codec.pack(self._ticks.stamp(tick)))

    def take_changes_from(self, nodes: Sequence[LoopNode]) -> None:
        # Any node may publish a parameter event under another name; changes passed on directly are genuine.
        self._own_nodes = frozenset(node.get_fully_qualified_name() for node in nodes)
        for node in nodes:
            node.report_changes_to(self._own_changes.append)

    def _take_parameter_event(self, message: bytes) -> None:
        """Record a change of a node in another process."""
        if self._run is None:
            return
        try:
            event = message_of(ParameterEvent, message)
        except MessageError as error:
            self._ignored.add(PARAMETER_EVENTS, str(error), self._run.nodes)
            return
        node = self._run.nodes.get(event.node)
        if node is None:
            return  # every node of the domain publishes here
        change = change_of_event(event)
        why_not = invalid_event_reason(change, event, node['parameters'])
        if why_not:
            self._ignored.add(PARAMETER_EVENTS, f'{why_not} in the name of {event.node}', self._run.nodes)
        elif event.node not in self._own_nodes:
            self._take_change(change)

    def _take_change(self, change: NodeChange) -> None:
        """Record a change; ``run.yaml`` already contains the declarations of a starting node."""
        if self._recorder is None or self._run is None or not self._recorder.is_open:
            return
        # The declarations of a starting node are stamped with wall time.
        in_run = change.time_ns <= self._ticks.nanoseconds(self.last_tick + 1)
        if change.values and change.node in self._run.nodes and in_run:
            # The serializer of rclpy leaves uninitialized padding after the message, which some readers cannot parse.
            self._recorder.write_parameter_event(change.time_ns, pack_parameter_event(change))
            self._changes[change.node] += change.time_ns > 0

    def housekeep(self) -> None:
        # Only from tick 0 on, because the queues do not exist before. Services are processed next, and a change of this
        # node must carry the tick of the other nodes.
        if self.tick and self._queues:
            self._fire_together(with_fewer=True)
        own, self._own_changes[:] = list(self._own_changes), []
        for change in own:
            self._take_change(change)
        # Read here and not by the executor, which needs a new wait for each message.
        while (taken := self._parameter_events.handle.take_message(ParameterEvent, True)) is not None:
            self._take_parameter_event(taken[0])
        if self._recorder is not None:
            # Ten times per second: a killed process loses no more than that, even in a slow or paused run.
            self._recorder.flush()
        watched, self._watched = self._watched, []
        if watched:
            topics = [port.topic for port in self.inputs]
            first_tick = self.tick - len(watched)
            signals = signals_of_messages(first_tick, self._ticks.sample_time, topics, watched)
            self._scope.publish(self._scope_message(make_block(signals)))
        self._is_watched = self._scope.get_subscription_count() > 0

    def _scope_message(self, block: Block) -> Float64MultiArray:
        assert self._run is not None
        rows, columns = block.rows.shape
        offers = self._run.description()
        units = Units(*(str(offers.get(key, '')) for key in ('length_unit', 'control_unit')))
        about, names = ScopeMessage(self._run.identifier, units, block).labels
        message = Float64MultiArray(data=array('d', block.rows.tobytes()))
        message.layout.dim = [
            MultiArrayDimension(label=about, size=rows, stride=rows * columns),
            MultiArrayDimension(label=names, size=columns, stride=columns),
        ]
        return message

    def diagnose(self) -> Iterable[Diagnosis]:
        values = {'recorded ticks': self.tick, 'directory': self.directory}
        yield Diagnosis('recording', OK, 'recording' if self._recorder is not None else 'waiting for the run', values)

    def has_all(self, changes: Mapping[str, int] | None) -> bool:
        if changes is None:
            return False
        for node, count in self._changes.items():
            if count > changes.get(node, 0):
                raise RunError(
                    f'{PARAMETER_EVENTS}: {count} changes of {node} were recorded, but it made {changes.get(node, 0)}: '
                    'an external node publishes in its name'
                )
        return all(self._changes[node] == count for node, count in changes.items())

    def changes_received(self) -> Mapping[str, int]:
        return dict(self._changes)

    def complete(self) -> None:
        assert self._recorder is not None
        self._recorder.close_bag()

    def finish(self, outcome: Outcome) -> None:
        self._ignored.report()
        if self._recorder is None and self._process is not None:
            self._process.communicate()  # closes its pipe, which ends the process
        if self._recorder is not None:
            # Keep the messages that have arrived; the reason is known if one of them ended the run.
            with contextlib.suppress(Exception):
                while self._recorder.is_open and self._fire_once():
                    pass
            self._recorder.finish(outcome.status, outcome.reason)
            self.get_logger().info(f'run {outcome.status}: {self._recorder.directory}')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('bag_recorder', BagRecorder, arguments)


if __name__ == '__main__':
    sys.exit(main())
