"""A node of the loop: it fires for tick k when all its inputs of tick k have arrived."""

import importlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.time import Time

from hdd_servo_ros.messages.cdr import STAMP, array_names_and_offset
from hdd_servo_ros.messages.errors import NotFiniteError, RunError, StampError
from hdd_servo_ros.messages.outcome import Outcome
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import ARRAY_TYPE, QUEUE_DEPTH, LoopTopic
from hdd_servo_ros.parameters import ParameterSet
from hdd_servo_ros.parameters.run_parameters import PeerParameters, SampleTimeParameters
from hdd_servo_ros.parameters.schedule import Change, Step, plan
from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.node_parameters import NodeParameters, ParameterNode
from hdd_servo_ros.ros.run_plan import RunPlan

_TRIAL_SAMPLE_TIME = 1e-4
UNKNOWN_NODE = 'a node that has not said its name or is gone'
LOOP_QOS = QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy.RELIABLE)


def message_class(type_name: str) -> Any:
    """Return the Python class of a message type named like ``std_msgs/msg/String``."""
    package, _, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


class _TakenByLockstep(CallbackGroup):
    """Keeps executors away from loop subscriptions: the lockstep takes their messages itself, in tick order."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class Input:
    """
    A loop topic that a node reads.

    Parameters
    ----------
    topic
        The topic.
    delay
        At tick k the message of tick k - ``delay`` is needed; none before that tick exists.
    """

    def __init__(self, topic: LoopTopic, delay: int = 0) -> None:
        self.topic = topic
        self.delay = delay
        self.subscription: Subscription
        self.name: str
        self._node: Node
        self._take: Callable[[type, bool], Any]
        self._type: type
        self._ticks: Ticks
        self._stamp_bytes: Callable[[int], bytes]
        # An array message has no header; where its element t stands depends on its label.
        self._is_array = topic.type_name == ARRAY_TYPE
        self._stamp: slice | None = None if self._is_array else STAMP

    def connect(self, node: Node, group: CallbackGroup) -> None:
        """Subscribe."""
        self._node = node
        self._type = message_class(self.topic.type_name)
        self.subscription = node.create_subscription(
            self._type, self.topic.name, lambda _: None, LOOP_QOS, callback_group=group, raw=True
        )
        self.name = self.subscription.topic_name
        self._take = self.subscription.handle.take_message

    def begin(self, ticks: Ticks) -> None:
        """Get to know the time line of the run."""
        self._ticks = ticks
        self._stamp_bytes = ticks.seconds_bytes if self._is_array else ticks.stamp

    def take(self) -> bytes | None:
        """Return the next message as bytes, None if there is none."""
        taken = self._take(self._type, True)
        return None if taken is None else taken[0]

    def take_for(self, tick: int) -> bytes | None:
        """
        Return the message that the reader's tick needs, None if it is not there yet, empty if there is none to be.

        Raises
        ------
        StampError
            If the next message is not that of the tick.
        """
        expected = tick - self.delay
        if expected < 0:
            return b''
        taken = self._take(self._type, True)
        if taken is None:
            return None
        message: bytes = taken[0]
        if self._stamp is None:
            _, offset = array_names_and_offset(message)
            self._stamp = slice(offset, offset + 8)
        if message[self._stamp] != self._stamp_bytes(expected):
            received = (self._ticks.tick_of_seconds if self._is_array else self._ticks.tick_of)(message[self._stamp])
            raise StampError(self.name, expected, received, publishers_of(self._node, self.name))
        return message


class LoopNode(ParameterNode):
    """
    Base of the loop's nodes: a block with wires on it.

    A subclass says its wires and parameters, builds its block in :meth:`prepare`, and publishes in :meth:`step`.

    Parameters
    ----------
    name
        Node name; equals the executable's.
    kinds
        Parameter dataclasses of the block.
    inputs, outputs
        Loop topics that it reads and writes.
    optional_inputs
        Loop topics that it reads as well in a run in which some node publishes them; decided when the run starts.

    Raises
    ------
    ParameterError
        If a parameter is not allowed.
    """

    def __init__(
        self,
        name: str,
        kinds: Sequence[type[ParameterSet]],
        inputs: Sequence[Input],
        outputs: Sequence[LoopTopic],
        *,
        sample_time_kind: type[ParameterSet] = SampleTimeParameters,
        optional_inputs: Sequence[Input] = (),
    ) -> None:
        super().__init__(name)
        self.parameters = NodeParameters(self, [PeerParameters, sample_time_kind, *kinds])
        self.parameters.on_change(self._count_change)
        self.inputs = tuple(inputs)
        self.optional_inputs = tuple(optional_inputs)
        self.outputs = tuple(outputs)
        self.loop_publishers: list[Publisher] = []
        self._publish: list[Callable[[bytes], None]] = []
        self.tick = 0
        """The next tick that this node fires for."""
        self.run_directory: Path | None = None
        """Where the run is recorded, once that is known; on the recorder's machine."""
        self.last_tick = -1
        self.changes = 0
        """How often parameters were changed behind tick 0."""
        self._halt = 0
        self._schedule: list[Step] = []
        self._ticks: Any = None
        self._arrived = 0
        self._messages: list[bytes] = []
        self._ros_clock: Any = self.get_clock()
        # What a TimeSource does on /clock, if use_sim_time says so: here the lockstep knows the time better, always.
        self._time_source.detach_node()
        self._time_source._associated_clocks.clear()
        self._ros_clock._set_ros_time_is_active(True)  # type: ignore[attr-defined,unused-ignore]

    # What a subclass provides.

    def offers(self) -> dict[str, str]:
        """Return texts that concern the whole run, such as the drive's name."""
        return {}

    def last_tick_needed(self, sample_time: float) -> int:
        """Return the last tick that this node has a plan for at a sample time [s], 0 if any number of ticks will do."""
        return 0

    def prepare(self, run: RunPlan) -> None:
        """Build the block for the run's sample time; called once, before tick 0."""

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        """
        Do the work of one tick and publish the outputs.

        Parameters
        ----------
        tick
            The tick k.
        stamp
            Its eight stamp bytes.
        messages
            The inputs' messages, in the inputs' order, those of the optional ones that take part behind them; of a
            delayed input an empty one before it has any.
        """
        raise NotImplementedError

    def update(self) -> None:
        """Take over parameters that were changed; called between two ticks."""

    def housekeep(self) -> None:
        """Do what needs no exact tick; called between two ticks, ten times a second of wall time."""

    def diagnose(self) -> Iterable[Diagnosis]:
        """Iterate over how this node is; asked once a second of wall time, between two ticks."""
        return ()

    def _count_change(self) -> None:
        self.changes += self.tick > 0
        self.update()

    paced = False
    """Whether :meth:`seconds_until_due` has a say."""

    @property
    def directory(self) -> str:
        """Where this node records the run; empty for one that does not."""
        return ''

    def seconds_until_due(self) -> float:
        """Return for how long this node must not fire yet although its inputs are there [s of wall time]."""
        return 0.0

    def complete(self) -> None:
        """Do what is left after the last tick, such as closing a bag; the run counts as finished after it."""

    def has_all(self, changes: Mapping[str, int] | None) -> bool:
        """Return whether :meth:`complete` may be called, after so many parameter changes a node, if that is known."""
        return True

    def finish(self, outcome: Outcome) -> None:
        """Learn how the run ended; called once, at the very end."""

    def trial(self, make: Callable[[Any, float], Any], kind: type[ParameterSet]) -> Any:
        """
        Make a block before the run's sample time is known.

        It refuses bad parameters while the node starts, and a step of it compiles its kernel: both before others wait.
        """
        return make(self.parameters[kind], _TRIAL_SAMPLE_TIME)

    # What the lockstep calls.

    def connect(self) -> None:
        """
        Create the loop's publishers and subscriptions.

        Only now, when the block is there and this process is about to say who it is: a publisher that stays unexplained
        counts as a stranger's, and compiling a block takes long the first time.
        """
        group = _TakenByLockstep()
        for wire in (*self.inputs, *self.optional_inputs):
            wire.connect(self, group)
        self.loop_publishers = [
            self.create_publisher(message_class(topic.type_name), topic.name, LOOP_QOS) for topic in self.outputs
        ]
        self._publish = [publisher.handle.publish_raw for publisher in self.loop_publishers]

    def begin(self, run: RunPlan) -> None:
        """Prepare for tick 0 of ``run``."""
        self.last_tick = run.last_tick
        self._ticks = run.ticks
        self.inputs += tuple(wire for wire in self.optional_inputs if run.publisher_of(wire.name) is not None)
        self._messages = [b''] * len(self.inputs)
        for wire in (*self.inputs, *self.optional_inputs):
            wire.begin(run.ticks)
        self._schedule = list(self.plan(run.changes))
        self.prepare(run)
        self._set_halt()

    @property
    def done(self) -> bool:
        """Whether the last tick has been fired."""
        return self.tick > self.last_tick

    def try_fire(self) -> bool:
        """
        Fire for the next tick if all its inputs are there.

        Raises
        ------
        StampError
            If an input's message is not the one of the expected tick.
        """
        tick = self.tick
        if tick >= self._halt and not self._passes():
            return False
        inputs, messages = self.inputs, self._messages
        arrived = self._arrived
        while arrived < len(inputs):
            message = inputs[arrived].take_for(tick)
            if message is None:
                self._arrived = arrived
                return False
            messages[arrived] = message
            arrived += 1
        self._arrived = arrived
        if self.paced and self.seconds_until_due() > 0.0:
            return False
        self._arrived = 0
        self.step(tick, self._ticks.stamp(tick), messages)
        self.tick = tick + 1
        return True

    def plan(self, changes: Sequence[Change]) -> tuple[Step, ...]:
        """Return what a run's schedule says for this node; raises :class:`ParameterError` if that cannot be done."""
        parameters = self.parameters
        return plan(changes, self.get_fully_qualified_name(), parameters.kinds, parameters.as_mapping())

    def _next_halt(self) -> int:
        """Return the tick for which :meth:`try_fire` must look for more than its inputs."""
        return min(self.last_tick + 1, self._schedule[0].tick if self._schedule else self.last_tick + 1)

    def _set_halt(self) -> None:
        self._halt = self._next_halt()

    def _passes(self) -> bool:
        """Do what is due before the next tick, such as scheduled changes; return whether it may be fired for."""
        while self._schedule and self._schedule[0].tick <= self.tick:
            step = self._schedule.pop(0)
            self.show_time()
            refused = self.parameters.set(step.values)
            if refused:
                raise RunError(f'{self.get_fully_qualified_name()}: schedule {step.entry!r}: {refused}')
        self._set_halt()
        return not self.done

    def missing(self) -> Input | None:
        """Return the input that the next tick waits for, None if it waits for none."""
        return self.inputs[self._arrived] if not self.done and self._arrived < len(self.inputs) else None

    def show_time(self) -> None:
        """Let this node's ROS clock stand at its next tick, so that parameter events carry it."""
        if self._ticks is not None:
            self._ros_clock.set_ros_time_override(Time(nanoseconds=self._ticks.nanoseconds(max(self.tick, 0))))

    def publish_bytes(self, output: int, message: bytes) -> None:
        """Publish on one of the outputs."""
        self._publish[output](message)

    def publish_vector(self, output: int, tick: int, message: bytes, x: float, y: float, z: float) -> None:
        """
        Publish a vector message whose values must be finite.

        Raises
        ------
        NotFiniteError
            If one is not.
        """
        if not math.isfinite(x + y + z):
            raise NotFiniteError(self.loop_publishers[output].topic_name, tick, (x, y, z), self.get_name())
        self._publish[output](message)


def last_ticks_needed(nodes: Iterable[LoopNode], sample_time: float) -> dict[str, int]:
    """Return the last tick of each node that has a plan at a sample time [s], by its full name."""
    needed = {node.get_fully_qualified_name(): node.last_tick_needed(sample_time) for node in nodes}
    return {name: tick for name, tick in needed.items() if tick}


def publishers_of(node: Node, topic: str) -> str:
    """Return the names of the nodes that publish a topic, for messages."""
    names = [
        UNKNOWN_NODE if 'UNKNOWN' in info.node_name else f'{info.node_namespace.rstrip("/")}/{info.node_name}'
        for info in node.get_publishers_info_by_topic(topic)
    ]
    return ', '.join(sorted(names)) or 'nobody now'
