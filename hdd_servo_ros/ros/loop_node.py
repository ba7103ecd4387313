"""A node of the loop: it fires for tick k when all its inputs of tick k have arrived."""

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
    Base of the loop's nodes: it connects one block to topics and ROS parameters.

    A subclass declares its inputs, outputs and parameters, builds its block in :meth:`prepare`, and publishes in
    :meth:`step`.

    Parameters
    ----------
    name
        Node name; equals the executable's.
    kinds
        Parameter dataclasses of the block.
    inputs, outputs
        Loop topics that it reads and writes.
    optional_inputs
        Loop topics that it also reads in a run in which some node publishes them; decided when the run starts. One
        that replaces an input is then read in place of it.

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
        """Directory of the run on the recorder's machine, once that is known."""
        self.last_tick = -1
        self.paced = False
        """Whether :meth:`seconds_until_due` may delay a tick."""
        self.changes = 0
        """How often parameters were changed after tick 0."""
        self._run: RunPlan | None = None
        self._scheduled: Sets = {}
        """What the schedule is about to set."""
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

    # What a subclass provides.

    patience = 0.0
    """For how long the process may sleep on when a message has come, if no node in it is less patient [s]."""

    def attempt(
        self, sets: Sets, sample_time: float, nodes: Mapping[str, Mapping[str, Any]], *, is_change: bool
    ) -> Attempt | None:
        """
        Return how to try parameters of this node before they are accepted; None if there is nothing to try.

        Parameters
        ----------
        sets
            The parameters.
        sample_time
            T [s].
        nodes
            The participating nodes by their full names, each with its ``parameters``.
        is_change
            Whether they are to change in the run.
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
            As of :meth:`attempt`.
        accepted
            Parameters with which it can: the defaults, or those before a change.

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
        """Reject a schedule after one of whose changes this node cannot run; raises :class:`ParameterError`."""
        accepted: Sets = self.parameters.sets
        for step in self.plan(changes):
            try:
                self.check(step.sets, accepted, sample_time, nodes, is_change=True)
            except ParameterError as error:
                raise InvalidParameterError('schedule', step.entry, str(error)) from None
            accepted = step.sets

    def _check_change(self, sets: Sets) -> None:
        """Reject a change with which this node cannot run on; one of the schedule has been tried before the run."""
        if sets == self._scheduled:
            return
        assert self._run is not None
        self.check(sets, self.parameters.sets, self._run.sample_time, self._run.nodes, is_change=True)

    def offers(self) -> dict[str, str]:
        """Return strings that concern the whole run, such as the drive's name."""
        return {}

    def last_tick_needed(self, sample_time: float) -> int:
        """Return the last tick of this node's plan at a sample time [s], 0 if it has none and any number will do."""
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
            The inputs' messages, in the inputs' order, then those of the optional inputs of this run; empty for a
            delayed input that has none yet.
        """
        raise NotImplementedError

    def update(self) -> None:
        """Apply changed parameters; called between two ticks."""

    def housekeep(self) -> None:
        """Do what needs no exact tick; called between two ticks, ten times per second of wall time."""

    def diagnose(self) -> Iterable[Diagnosis]:
        """Iterate over the diagnoses of this node; called once per second of wall time, between two ticks."""
        return ()

    def take_changes_from(self, nodes: Sequence['LoopNode']) -> None:
        """Receive the loop nodes of this process, whose parameter changes need not come over DDS."""

    def report_changes_to(self, take: Callable[[NodeChange], None]) -> None:
        """Give every change of this node's parameters to ``take``, with the time of the parameter event."""
        name = self.get_fully_qualified_name()
        self.parameters.report_to(
            lambda values: take(NodeChange(name, self._ros_clock.now().nanoseconds, values)),
        )

    def _count_change(self) -> None:
        self.changes += self.tick > 0
        self.update()

    @property
    def directory(self) -> str:
        """Directory where this node records the run; empty for one that does not."""
        return ''

    def seconds_until_due(self) -> float:
        """Return for how long this node must not fire yet although its inputs are there [s of wall time]."""
        return 0.0

    def complete(self) -> None:
        """Complete the work after the last tick, such as closing a bag; the run counts as finished after it."""

    def has_all(self, changes: Mapping[str, int] | None) -> bool:
        """Return whether :meth:`complete` may be called, given the number of changes per node, if that is known."""
        return True

    def changes_received(self) -> Mapping[str, int] | None:
        """Return how many parameter events of each node this one has received, by full name; None if it reads none."""
        return None

    def finish(self, outcome: Outcome) -> None:
        """Receive how the run ended; called once, at the very end."""

    @property
    def trial_sample_time(self) -> float:
        """T for a block that is made before that of the run is known [s]."""
        return _TRIAL_SAMPLE_TIME

    def trial(self, make: Callable[[Any, float], Any], kind: type[ParameterSet]) -> Any:
        """
        Make a block before the run's sample time is known.

        It rejects bad parameters while the node starts, and a step of it compiles its kernel: both before others wait.
        """
        try:
            return make(self.parameters[kind], self.trial_sample_time)
        except ParameterError:
            raise
        except Exception:
            # Names the parameter; if none is to blame, what was raised says more.
            self.check_start(self.trial_sample_time, {})
            raise

    # What the lockstep calls.

    def connect(self) -> None:
        """
        Create the loop's publishers and subscriptions.

        Not before the block exists and this process is about to announce itself: a publisher that stays unannounced
        counts as external, and compiling a block takes long the first time.
        """
        group = TakenByLockstep()
        for port in (*self.inputs, *self.optional_inputs):
            port.connect(self, group)
        self.loop_publishers = [
            self.create_publisher(message_class(topic.type_name), topic.name, LOOP_QOS) for topic in self.outputs
        ]
        self._publish = [publisher.handle.publish_raw for publisher in self.loop_publishers]

    def begin(self, run: RunPlan) -> None:
        """Prepare for tick 0 of ``run``."""
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
        """Return why the block cannot be built for a run, with the parameter if one is to blame."""
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
        Fire for the next tick if all its inputs are there.

        Raises
        ------
        StampError
            If an input's message is not the one of the expected tick.
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
        """Return this node's steps of a run's schedule; raises :class:`ParameterError` if it cannot do them."""
        parameters = self.parameters
        return plan(changes, self.get_fully_qualified_name(), parameters.kinds, parameters.as_mapping())

    def _next_halt(self) -> int:
        """Return the tick for which :meth:`try_fire` must check more than its inputs."""
        return min(self.last_tick + 1, self._schedule[0].tick if self._schedule else self.last_tick + 1)

    def _set_halt(self) -> None:
        self._halt = self._next_halt()

    def _passes(self) -> bool:
        """Do what is due before the next tick, such as scheduled changes; return whether the node may fire for it."""
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
        """Whether this node is to wait: somebody, or the wall time, holds up its next tick."""
        return not self.done and self.seconds_until_due() > 0.0

    def missing(self) -> Input | None:
        """Return the input that the next tick waits for, None if it waits for none."""
        return self.inputs[self._arrived] if not self.done and self._arrived < len(self.inputs) else None

    def show_time(self) -> None:
        """Set this node's ROS clock to its next tick, so that parameter events carry it."""
        if self._ticks is not None:
            self._ros_clock.set_ros_time_override(Time(nanoseconds=self._ticks.nanoseconds(max(self.tick, 0))))

    def publish_by(self, output: int, publish: Callable[[bytes], None]) -> None:
        """Publish on one of the outputs by a function from now on, not by its publisher."""
        self._publish[output] = publish

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
        # The sum first, which is quicker; that of finite numbers may overflow.
        if not math.isfinite(x + y + z) and not all(map(math.isfinite, (x, y, z))):
            raise NotFiniteError(self.loop_publishers[output].topic_name, tick, (x, y, z), self.get_name())
        self._publish[output](message)
