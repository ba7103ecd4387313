"""
Lockstep: the loop that drives the loop nodes of a process, whether one or all.

A pass calls every node; a node fires when all its inputs of its next tick have arrived. If no node fired, the process
sleeps until a missing message arrives. The results therefore depend neither on the distribution of the nodes over
processes nor on message latency or scheduling.

All other duties of a ROS 2 node (services, events, diagnostics, announcements to the other processes) are done between
two passes, ten times per second, in the same thread: at a tick boundary and without locks.
"""

import contextlib
import math
import signal
import time
from collections.abc import Sequence
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node

from hdd_servo_ros.messages.errors import RunError, StopRequest
from hdd_servo_ros.messages.exit_codes import FAILED
from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME, Outcome, failed, interrupted
from hdd_servo_ros.ros.diagnostics import DiagnosticsPublisher
from hdd_servo_ros.ros.ending import Ending
from hdd_servo_ros.ros.exit_deadline import exit_deadline
from hdd_servo_ros.ros.gathering import Gathering
from hdd_servo_ros.ros.intra_process import IntraProcess
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import Member
from hdd_servo_ros.ros.message_wait import MessageWait
from hdd_servo_ros.ros.watching import PeerEnded, Watching

RCLError: type[Exception] = _rclpy.RCLError

HOUSEKEEPING_PERIOD = 0.1
"""Wall time between two rounds of housekeeping while the loop runs [s]."""
LONGEST_SLEEP = 0.05
"""Longest wait for a message before signals and housekeeping are checked [s]."""
POLLING_PERIOD = 0.02
"""Wall time between two checks of the other processes before and after the loop [s]."""
_CALLBACKS_PER_ROUND = 20
_PATIENCE = 2.0
"""A signal within this time after the first is the same request: `ros2 launch` repeats that of the terminal [s]."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that interrupt a run."""


class Lockstep:
    """
    Drive the loop nodes of this process through a run.

    Parameters
    ----------
    nodes
        The nodes, preferably in the order of the data flow within a tick: one pass is then one tick.
    others
        Nodes of this process outside the loop whose services must be served too.
    intra_process
        Whether the nodes pass messages to each other directly instead of over DDS.
    """

    def __init__(self, nodes: Sequence[LoopNode], others: Sequence[Node] = (), *, intra_process: bool = False) -> None:
        self._nodes = tuple(nodes)
        for node in self._nodes:
            node.connect()
            node.take_changes_from(self._nodes)
        self._member = Member(self._nodes)
        self._gathering = Gathering(self._member)
        self._watching = Watching(self._member)
        self._ending = Ending(self._member)
        self._is_intra_process = intra_process
        self._patience = min(node.patience for node in self._nodes)
        self._diagnostics = DiagnosticsPublisher(self._nodes)
        self._executor = SingleThreadedExecutor()
        for served in (*self._nodes, *others):
            self._executor.add_node(served)
        self._signal = 0
        self._signal_at = 0.0
        self._firing = self._nodes[0]
        self._message_wait = MessageWait(self._nodes[0].context)

    def run(self) -> Outcome:
        """
        Wait for the peers, run all ticks and end together; return the outcome. A failed run raises no error.

        The handlers of :data:`SIGNALS` stay installed, and the caller restores its own after the process has shut down.
        Until then the outcome is known, and a signal cannot change it; only a second one ends the process.
        """
        for number in SIGNALS:
            signal.signal(number, self._take_signal)
        try:
            outcome = self._run()
            self._log(outcome)
            return outcome
        finally:
            self._executor.shutdown()

    def _run(self) -> Outcome:
        try:
            self._gather()
            self._loop()
            self._await_changes()
            for node in self._nodes:
                node.complete()
            self._end_together()
            outcome = FINISHED_OUTCOME
        except _Interrupted:
            outcome = interrupted(f'{signal.Signals(self._signal).name} {self._where()}', self._signal)
        except StopRequest as stop:
            outcome = interrupted(str(stop), signal.SIGINT)
        except PeerEnded as end:
            outcome = end.outcome
        except RunError as error:
            outcome = failed(str(error))
        except Exception as error:
            outcome = failed(f'{type(error).__name__}: {error} {self._where()}')
        # The bag must also contain the parameter changes of the last round.
        with contextlib.suppress(Exception):
            self._serve()
        # Before closing the bag, which takes time, so that the other processes stop waiting.
        with exit_deadline(outcome.exit_code or FAILED):
            self._ending.announce_outcome(outcome)
        self._member.ignored.report()
        for node in self._nodes:
            try:
                node.finish(outcome)
            except Exception as error:
                if outcome == FINISHED_OUTCOME:  # otherwise the first error is reported
                    outcome = failed(f'{node.get_name()}: {error}')
        return outcome

    def _log(self, outcome: Outcome) -> None:
        if outcome != FINISHED_OUTCOME:
            self._nodes[0].get_logger().error(f'run {outcome.status}: {outcome.reason}')

    def _where(self) -> str:
        return f'in {self._firing.get_name()} at tick {self._firing.tick}'

    def _take_signal(self, number: int, frame: FrameType | None) -> None:
        if not self._signal:
            self._signal, self._signal_at = number, time.monotonic()
        elif time.monotonic() - self._signal_at > _PATIENCE:
            # Second request: while a step does not return, the first is not checked.
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    def _check_signal(self) -> None:
        if self._signal:
            raise _Interrupted

    def _housekeeping(self) -> None:
        self._serve()
        self._check_signal()

    def _serve(self) -> None:
        """Process services, events and announcements of other processes; publish diagnostics."""
        self._diagnostics.publish_when_due()
        for node in self._nodes:
            node.housekeep()
        for node in self._nodes:
            node.show_time()
        is_fresh_wait = True
        for _ in range(_CALLBACKS_PER_ROUND * len(self._nodes)):
            if self._spin_once():
                is_fresh_wait = False
            elif is_fresh_wait:
                break
            else:
                # A wait of the executor yields one callback per subscription, however many messages have arrived.
                is_fresh_wait = True

    def _spin_once(self) -> bool:
        """Run one ready callback; return whether there was one."""
        try:
            handler, _, _ = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
        except (rclpy.executors.TimeoutException, rclpy.executors.ConditionReachedException):
            return False
        except RCLError as error:
            # Bytes that are not a request of the type of their service; the error does not name the service.
            self._member.ignored.add_request(str(error))
            return True
        handler()
        if handler.exception() is not None:
            raise handler.exception()
        return True

    def _gather(self) -> None:
        while not self._gathering.gather():
            self._housekeeping()
            time.sleep(POLLING_PERIOD)

    def _loop(self) -> None:
        nodes = self._nodes
        assert self._member.run is not None
        intra_process = IntraProcess(nodes, self._member.run) if self._is_intra_process else None
        monotonic = time.monotonic
        housekeeping_due = progressed_at = monotonic()
        pending = [node for node in nodes if not node.done]
        while pending:
            progressed = False
            for node in nodes:
                self._firing = node
                if node.try_fire():
                    progressed = True
            now = monotonic()
            if now >= housekeeping_due:
                self._housekeeping()
                if intra_process is not None:
                    intra_process.follow_subscriptions()
                if progressed:
                    progressed_at = now
                self._watching.watch(now - progressed_at)
                self._watching.check_stall(now - progressed_at)
                housekeeping_due = monotonic() + HOUSEKEEPING_PERIOD
            if progressed:
                progressed_at = now
            else:
                pending = [node for node in nodes if not node.done]
                if pending:
                    self._sleep(pending)

    def _sleep(self, pending: Sequence[LoopNode]) -> None:
        """Wait until a missing message arrives, a node is due, or housekeeping is due."""
        self._check_signal()
        seconds = LONGEST_SLEEP
        missing = []
        for node in pending:
            port = node.missing()
            if port is None:
                seconds = min(seconds, node.seconds_until_due())
            elif port.queue is None:  # otherwise a node of this process publishes it, and is waiting itself
                missing.append(port)
        if not missing:
            time.sleep(max(seconds, 0.0))
        elif seconds > 0.0:
            self._message_wait.wait(tuple(missing), seconds)
            if self._patience:
                time.sleep(self._patience)

    def _await_changes(self) -> None:
        """Wait until the recorder has received every parameter event, before it closes the bag."""
        deadline = math.inf
        self._housekeeping()
        while not all(node.has_all(changes := self._ending.final_changes()) for node in self._nodes):
            if changes is not None:
                deadline = min(deadline, time.monotonic() + self._member.timeout)
                if time.monotonic() > deadline:
                    received = next(filter(None, (node.changes_received() for node in self._nodes)), {})
                    raise RunError(
                        'the recorder has not received one parameter event for each change, or an external node '
                        f'publishes events in the name of a node: changes {changes}, events {dict(received)}'
                    )
            time.sleep(POLLING_PERIOD)
            self._housekeeping()
            self._watching.watch()

    def _end_together(self) -> None:
        while not self._ending.announce_done():
            self._housekeeping()
            self._watching.watch()
            time.sleep(POLLING_PERIOD)


class _Interrupted(Exception):
    """A signal requests the end of the run."""
