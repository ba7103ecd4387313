"""Base class of the loop nodes: a node fires for tick k when all its inputs of tick k have arrived."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.publisher import Publisher
from rclpy.time import Time

from hdd_servo_ros.analysis.parameter_trial import Attempt, Sets, reject_failing
from hdd_servo_ros.messages.errors import NotFiniteError, RunError
from hdd_servo_ros.messages.outcome import Outcome
from hdd_servo_ros.messages.topics import LoopTopic
from hdd_servo_ros.parameters import InvalidParameterError, ParameterError, ParameterSet
from hdd_servo_ros.parameters.events import NodeChange
from hdd_servo_ros.parameters.run_parameters import PeerParameters, SampleTimeParameters
from hdd_servo_ros.parameters.schedule import Change, Step, plan
from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.loop_input import Input, TakenByLockstep
from hdd_servo_ros.ros.loop_topics import LOOP_QOS, message_class
from hdd_servo_ros.ros.node_parameters import NodeParameters, ParameterNode
from hdd_servo_ros.ros.run_plan import RunPlan

_TRIAL_SAMPLE_TIME = 1e-4


class LoopNode(ParameterNode):
    """
    Base class of the loop nodes: it connects one block to topics and ROS parameters.

    A subclass declares its inputs, outputs and parameters, builds its block in :meth:`prepare`, and publishes in
    :meth:`step`.

    Parameters
    ----------
    name
        Name of the node and of its executable.
    kinds
        Parameter dataclasses of the block.
    inputs, outputs
        Loop topics that the node reads and writes.
    optional_inputs
        Loop topics that the node also reads if a node of the run publishes them; decided when the run starts. An
        optional input that replaces an input is then read instead of it.

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
        """Next tick for which this node fires."""
        self.run_directory: Path | None = None
        """Directory of the run on the machine of the recorder, once it is known."""
        self.last_tick = -1
        self.paced = False
        """Whether :meth:`seconds_until_due` may delay a tick."""
        self.changes = 0
        """Number of parameter changes after tick 0."""
        self._run: RunPlan | None = None
        self._scheduled: Sets = {}
        """Parameter sets that the schedule is about to apply."""
        self._halt = 0
        self._schedule: list[Step] = []
        self._ticks: Any = None
        self._stamps: Any = None
        self._arrived = 0
        self._messages: list[bytes] = []
        self._ros_clock: Any = self.get_clock()
        # With use_sim_time, a TimeSource would set this clock from /clock; the lockstep always sets it itself, exactly.
        self._time_source.detach_node()
        self._time_source._associated_clocks.clear()
        self._ros_clock._set_ros_time_is_active(True)  # type: ignore[attr-defined,unused-ignore]

    # To be provided by a subclass.

    patience = 0.0
    """Time for which the process may sleep on after a message has arrived; the smallest of its nodes counts [s]."""

    def attempt(
        self, sets: Sets, sample_time: float, nodes: Mapping[str, Mapping[str, Any]], *, is_change: bool
    ) -> Attempt | None:
        """
        Return a trial of parameters of this node before they are accepted; None if no trial is needed.

        Parameters
        ----------
        sets
            The parameters.
        sample_time
            T [s].
        nodes
            The participating nodes by their full names, each with its ``parameters``.
        is_change
            Whether the parameters are to be changed during the run.
        """
        return None

    def check(
        self,
        sets: Sets,
        accepted: Sets,
        sample_time: float,
        nodes: Mapping[str, Mapping[str, Any]],
        *,
        is_change: bool,
    ) -> None:
        """
        Reject parameters with which this node cannot run; see :meth:`attempt`.

        Parameters
        ----------
        sets, sample_time, nodes, is_change
            See :meth:`attempt`.
        accepted
            Parameters with which the node can run: the defaults, or those before a change.

        Raises
        ------
        ParameterError
            Names the parameter.
        """
        attempt = self.attempt(sets, sample_time, nodes, is_change=is_change)
        if attempt is not None:
            reject_failing(self.get_name(), sets, accepted, attempt)

    def check_start(self, sample_time: float, nodes: Mapping[str, Mapping[str, Any]]) -> None:
        """Reject the present parameters if this node cannot run with them; raises :class:`ParameterError`."""
        sets = self.parameters.sets
        self.check(sets, {kind: kind() for kind in sets}, sample_time, nodes, is_change=False)

    def check_schedule(
        self, changes: Sequence[Change], sample_time: float, nodes: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Reject a schedule if this node cannot run after one of its changes; raises :class:`ParameterError`."""
        accepted: Sets = self.parameters.sets
        for step in self.plan(changes):
            try:
                self.check(step.sets, accepted, sample_time, nodes, is_change=True)
            except ParameterError as error:
                raise InvalidParameterError('schedule', step.entry, str(error)) from None
            accepted = step.sets

    def _check_change(self, sets: Sets) -> None:
        """Reject a change with which this node cannot continue; scheduled changes were tried before the run."""
        if sets == self._scheduled:
            return
        assert self._run is not None
        self.check(sets, self.parameters.sets, self._run.sample_time, self._run.nodes, is_change=True)

    def offers(self) -> dict[str, str]:
        """Return strings that apply to the whole run, such as the name of the drive."""
        return {}

    def last_tick_needed(self, sample_time: float) -> int:
        """Return the last tick of this node's plan at a sample time [s]; 0 if the node has no plan."""
        return 0

    def prepare(self, run: RunPlan) -> None:
        """Build the block for the sample time of the run; called once, before tick 0."""

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        """
        Execute one tick and publish the outputs.

        Parameters
        ----------
        tick
            The tick k.
        stamp
            Its eight stamp bytes.
        messages
            The messages of the inputs, in their order, then those of the optional inputs of this run; empty for a
            delayed input without a message yet.
        """
        raise NotImplementedError

    def update(self) -> None:
        """Apply changed parameters; called between two ticks."""

    def housekeep(self) -> None:
        """Do work that needs no exact tick; called between two ticks, ten times per second of wall time."""

    def diagnose(self) -> Iterable[Diagnosis]:
        """Iterate over the diagnoses of this node; called once per second of wall time, between two ticks."""
        return ()

    def take_changes_from(self, nodes: Sequence['LoopNode']) -> None:
        """Receive parameter changes of the loop nodes of this process directly, not over DDS."""

    def report_changes_to(self, take: Callable[[NodeChange], None]) -> None:
        """Call ``take`` with every change of this node's parameters and the time of the parameter event."""
        name = self.get_fully_qualified_name()
        self.parameters.report_to(
            lambda values: take(NodeChange(name, self._ros_clock.now().nanoseconds, values)),
        )

    def _count_change(self) -> None:
        self.changes += self.tick > 0
        self.update()

    @property
    def directory(self) -> str:
        """Directory where this node records the run; empty if it does not record."""
        return ''

    def seconds_until_due(self) -> float:
        """Return the wall time [s] for which this node must not fire yet although its inputs have arrived."""
        return 0.0

    def complete(self) -> None:
        """Complete the work after the last tick, such as closing a bag; the run is finished afterward."""

    def has_all(self, changes: Mapping[str, int] | None) -> bool:
        """Return whether :meth:`complete` may be called, given the number of changes of each node if it is known."""
        return True

    def changes_received(self) -> Mapping[str, int] | None:
        """Return the number of received parameter events of each node, by full name; None if this node reads none."""
        return None

    def finish(self, outcome: Outcome) -> None:
        """Receive the outcome of the run; called once, at the very end."""

    @property
    def trial_sample_time(self) -> float:
        """Sample time T of a block that is built before that of the run is known [s]."""
        return _TRIAL_SAMPLE_TIME

    def trial(self, make: Callable[[Any, float], Any], kind: type[ParameterSet]) -> Any:
        """
        Build a block before the sample time of the run is known.

        This rejects invalid parameters while the node starts, and a step of the block compiles its kernel: both before
        other nodes wait.
        """
        try:
            return make(self.parameters[kind], self.trial_sample_time)
        except ParameterError:
            raise
        except Exception:
            # This raises an error that names the parameter; if no parameter is the cause, the first error is raised.
            self.check_start(self.trial_sample_time, {})
            raise

    # Called by the lockstep.

    def connect(self) -> None:
        """
        Create the publishers and subscriptions of the loop.

        Call it only when the block exists and this process is about to announce itself: an unannounced publisher
        counts as external, and the first compilation of a block takes long.
        """
        group = TakenByLockstep()
        for port in (*self.inputs, *self.optional_inputs):
            port.connect(self, group)
        self.loop_publishers = [
            self.create_publisher(message_class(topic.type_name), topic.name, LOOP_QOS) for topic in self.outputs
        ]
        self._publish = [publisher.handle.publish_raw for publisher in self.loop_publishers]

    def begin(self, run: RunPlan) -> None:
        """Prepare for tick 0 of a run."""
        self.last_tick = run.last_tick
        self._ticks = run.ticks
        self._stamps = run.ticks.stamps
        added = tuple(port for port in self.optional_inputs if run.publisher_of(port.name) is not None)
        present = {port.topic.name for port in added}
        self.inputs = (*(port for port in self.inputs if port.topic.replaced_by not in present), *added)
        self._run = run
        self._messages = [b''] * len(self.inputs)
        for port in (*self.inputs, *self.optional_inputs):
            port.begin(run.ticks)
        self._schedule = list(self.plan(run.changes))
        try:
            self.prepare(run)
            self.check_schedule(run.changes, run.sample_time, run.nodes)
        except RunError:
            raise
        except Exception as error:
            raise RunError(self._why_not_prepared(error, run)) from error
        self.parameters.check_further(self._check_change)
        self._set_halt()

    def _why_not_prepared(self, error: Exception, run: RunPlan) -> str:
        """Return why the block cannot be built for a run, with the parameter if one is the cause."""
        if not isinstance(error, ParameterError):
            try:
                self.check_start(run.sample_time, run.nodes)
            except ParameterError as rejected:
                error = rejected
            else:
                raise error
        return str(error) if error.name == 'schedule' else f'{self.get_name()}: {error}'

    @property
    def done(self) -> bool:
        """Whether the last tick has been fired."""
        return self.tick > self.last_tick

    def try_fire(self) -> bool:
        """
        Fire for the next tick if all its inputs have arrived.

        Raises
        ------
        StampError
            If the message of an input is not that of the expected tick.
        """
        tick = self.tick
        if tick >= self._halt and not self._passes():
            return False
        stamp = self._stamps[tick]
        inputs, messages = self.inputs, self._messages
        count = len(inputs)
        arrived = self._arrived
        while arrived < count:
            message = inputs[arrived].take_for(tick, stamp)
            if message is None:
                self._arrived = arrived
                return False
            messages[arrived] = message
            arrived += 1
        if self.paced and self.seconds_until_due() > 0.0:
            self._arrived = count
            return False
        self._arrived = 0
        self.step(tick, stamp, messages)
        self.tick = tick + 1
        return True

    def plan(self, changes: Sequence[Change]) -> tuple[Step, ...]:
        """Return the steps of this node in a schedule; raises :class:`ParameterError` if it cannot do them."""
        parameters = self.parameters
        return plan(changes, self.get_fully_qualified_name(), parameters.kinds, parameters.as_mapping())

    def _next_halt(self) -> int:
        """Return the tick from which :meth:`try_fire` must check more than its inputs."""
        return min(self.last_tick + 1, self._schedule[0].tick if self._schedule else self.last_tick + 1)

    def _set_halt(self) -> None:
        self._halt = self._next_halt()

    def _passes(self) -> bool:
        """Apply scheduled changes that are due before the next tick; return whether the node may fire for it."""
        while self._schedule and self._schedule[0].tick <= self.tick:
            step = self._schedule.pop(0)
            self.show_time()
            self._scheduled = step.sets
            rejected = self.parameters.set(step.values)
            self._scheduled = {}
            if rejected:
                raise RunError(f'{self.get_fully_qualified_name()}: schedule {step.entry!r}: {rejected}')
        self._set_halt()
        return not self.done

    @property
    def is_held(self) -> bool:
        """Whether the next tick of this node is delayed, by a user or by pacing."""
        return not self.done and self.seconds_until_due() > 0.0

    def missing(self) -> Input | None:
        """Return the input for which the next tick waits; None if it waits for none."""
        return self.inputs[self._arrived] if not self.done and self._arrived < len(self.inputs) else None

    def show_time(self) -> None:
        """Set the ROS clock of this node to its next tick, so that parameter events carry its time."""
        if self._ticks is not None:
            self._ros_clock.set_ros_time_override(Time(nanoseconds=self._ticks.nanoseconds(max(self.tick, 0))))

    def publish_by(self, output: int, publish: Callable[[bytes], None]) -> None:
        """Publish on an output by a function from now on instead of by its publisher."""
        self._publish[output] = publish

    def publish_bytes(self, output: int, message: bytes) -> None:
        """Publish a message on an output."""
        self._publish[output](message)

    def publish_vector(self, output: int, tick: int, message: bytes, x: float, y: float, z: float) -> None:
        """
        Publish a vector message whose values must be finite.

        Raises
        ------
        NotFiniteError
            If a value is not finite.
        """
        # The sum is the faster check; the sum of finite numbers may overflow.
        if not math.isfinite(x + y + z) and not all(map(math.isfinite, (x, y, z))):
            raise NotFiniteError(self.loop_publishers[output].topic_name, tick, (x, y, z), self.get_name())
        self._publish[output](message)
