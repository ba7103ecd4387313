"""Membership of this process in a run: sending its announcements and receiving those of other processes."""

import dataclasses
import os
import socket
import time
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.outcome import FAILED, INTERRUPTED, Outcome
from hdd_servo_ros.messages.topics import CLOCK
from hdd_servo_ros.parameters.run_parameters import PeerParameters, TimerParameters
from hdd_servo_ros.ros.announcement import (
    DONE,
    READY,
    RUNNING,
    WAITING,
    Announcement,
    AnnouncementError,
    TimerAnnouncement,
    decode,
)
from hdd_servo_ros.ros.ignored_messages import IgnoredMessages
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.node_metadata import metadata_of
from hdd_servo_ros.ros.peer_table import PeerTable
from hdd_servo_ros.ros.publishers import publishers_of
from hdd_servo_ros.ros.run_plan import RunPlan
from hdd_servo_ros.ros.typed_json import shown
from hdd_servo_ros.ros.untrusted import MessageError, message_of

PERIODS = {WAITING: 0.1, READY: 0.1, RUNNING: 0.4, DONE: 0.1}
"""Wall time between two announcements in each state [s]."""
CURE = 'wait for its end, or choose another namespace (--ros-args -r __ns:=/bench2) or another ROS_DOMAIN_ID'
"""Advice when another graph is already running."""
LOCKSTEP = 'lockstep'
"""Topic of the announcements."""
LOCKSTEP_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
_MOST_UNKNOWN = 100
"""Largest number of processes without known nodes whose last announcement is kept until a run starts."""
_LONGEST_REASON = 1000
"""Characters of a peer's reason that are reported."""


class Member:
    """
    Membership of this process in a run: its state, its announcements and those of other processes.

    It neither carries loop data nor decides when a node fires.

    Parameters
    ----------
    nodes
        The connected loop nodes of this process; the first one owns the publisher and the subscription.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self.nodes = nodes
        self.identifier = f'{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:8]}'
        self.state = WAITING
        self.run: RunPlan | None = None
        self.timer_node = next((node for node in nodes if CLOCK in node.outputs), None)
        self.peers = PeerTable(time.monotonic())
        self.timeout = max(node.parameters[PeerParameters].peer_timeout for node in nodes)
        """Parameter ``peer_timeout`` [s]."""
        self.outcome_of_peer: Outcome | None = None
        """Outcome of the first peer that announced a failed or interrupted run."""
        self.ignored = IgnoredMessages(nodes[0])
        self.late_outputs: dict[str, float] = {}
        """Inputs of this process that a process that joined after the start publishes too, and when it last did [s]."""
        self._unknown: dict[str, Announcement] = {}
        """Before a run: the last announcement of each process without known nodes, in case the run includes it."""
        self._reported: set[str] = set()
        self._announced_at = 0.0
        self._publisher = nodes[0].create_publisher(String, LOCKSTEP, LOCKSTEP_QOS)
        # Raw, because the deserializer of the executor would raise on bytes that are not a string message.
        self._subscription = nodes[0].create_subscription(String, LOCKSTEP, self._receive, LOCKSTEP_QOS, raw=True)

    def report_ignored_publisher(self, node: LoopNode, topic: str) -> None:
        """Warn once that the publisher of an optional loop topic is not a loop node of this run."""
        if topic not in self._reported:
            self._reported.add(topic)
            node.get_logger().warning(
                f'{topic} is ignored: its publisher {publishers_of(node, topic)} is not a loop node of this run; '
                'derive it from LoopNode and start it with the other nodes, as in examples/disturbance_node.py'
            )

    # Sending.

    def announce(self, reason: str = '') -> None:
        """Send an announcement."""
        directory = next((node.directory for node in self.nodes if node.directory), '')
        if directory:
            directory = str(Path(directory).absolute())
        gathering = self.state in (WAITING, READY)
        announcement = Announcement(
            self.identifier,
            self.state,
            reason,
            ticks={node.get_fully_qualified_name(): node.tick for node in self.nodes},
            changes={node.get_fully_qualified_name(): node.changes for node in self.nodes},
            nodes=self._own_nodes() if self.run is None else None,
            receives=list(self.peers.announcements) if gathering else None,
            directory=directory or None,
            timer=self._own_timer(),
            run=self._own_run(),
        )
        if directory:
            self._set_directory(directory)
        self._publisher.publish(String(data=announcement.encode()))
        self._announced_at = time.monotonic()

    def announce_when_due(self, now: float, period: float) -> None:
        """Send an announcement if a period [s] has passed since the last one."""
        if now - self._announced_at > period:
            self.announce()

    def wait_for_acknowledgments(self, timeout: Duration) -> None:
        """Wait until all remaining processes have received the announcements."""
        self._publisher.wait_for_all_acked(timeout)

    def _own_timer(self) -> TimerAnnouncement | None:
        if self.timer_node is None:
            return None
        timer = self.timer_node.parameters[TimerParameters]
        schedule = timer.schedule if self.state in (WAITING, READY) else None
        return TimerAnnouncement(timer.sample_time, timer.last_tick, timer.rate, schedule)

    def _own_run(self) -> dict[str, Any] | None:
        if self.timer_node is None or self.run is None or self.state != RUNNING:
            return None
        return dataclasses.asdict(self.run)

    def _own_nodes(self) -> dict[str, dict[str, Any]]:
        return metadata_of(self.nodes, self.timer())

    def _set_directory(self, directory: str) -> None:
        for node in self.nodes:
            node.run_directory = Path(directory)

    # Receiving.

    def _receive(self, message: bytes) -> None:
        try:
            announcement = decode(message_of(String, message).data)
        except (MessageError, AnnouncementError) as error:
            self._ignore(str(error))
            return
        if announcement.process == self.identifier:
            return
        if not self._may_take_part(announcement) or not self.peers.receive(announcement, time.monotonic()):
            return
        if announcement.directory:
            self._set_directory(announcement.directory)
        if announcement.state in (FAILED, INTERRUPTED):
            self._receive_end(announcement)
        if announcement.run and self.run is None:
            self._receive_start(announcement)

    def _may_take_part(self, announcement: Announcement) -> bool:
        """Return whether the sender participates in the run, or may do so before the run; report any other."""
        process = announcement.process
        if self.run is not None:
            if process in self.run.processes:
                return True
            if not announcement.nodes:
                self._ignore(f'process {shown(process)} does not participate in this run')
            else:  # it joined after the start, and will end by itself
                outputs = {topic for node in announcement.nodes.values() for topic in node['outputs']}
                read = {port.name for node in self.nodes for port in node.inputs}
                self.late_outputs.update(dict.fromkeys(outputs & read, time.monotonic()))
            return False
        if announcement.nodes or process in self.peers.announcements:
            return True
        if announcement.run:
            return self._starts_its_own_run(announcement)
        # Without nodes: a process of another run, or of a run whose start this process has not received yet.
        if not announcement.ticks or announcement.state in (WAITING, READY):
            self._ignore(f'process {shown(process)} announces no nodes')
        elif announcement.state in (FAILED, INTERRUPTED):
            self._ignore(f'process {shown(process)} has {announcement.state} and never announced a node')
        if announcement.ticks and (process in self._unknown or len(self._unknown) < _MOST_UNKNOWN):
            self._unknown[process] = announcement
        return False

    def _ignore(self, why: str) -> None:
        names = {node.get_fully_qualified_name() for node in self.nodes}
        if self.run is not None:
            names |= set(self.run.nodes)
        else:
            names |= {name for each in self.peers.announcements.values() for name in each.ticks}
        self.ignored.add(self._subscription.topic_name, why, names)

    def _receive_end(self, announcement: Announcement) -> None:
        process = announcement.process
        if self.run is None and announcement.state == INTERRUPTED:
            # Before a run, a user may stop a node and start it again.
            self.peers.remove(process, time.monotonic())
        elif self.outcome_of_peer is None and (self.run is None or process in self.run.processes):
            self.outcome_of_peer = Outcome(announcement.state, _reason_of(announcement))

    def _receive_start(self, announcement: Announcement) -> None:
        run = announcement.run
        assert run is not None
        if not self._starts_its_own_run(announcement):
            return
        if self.identifier not in run['processes']:
            names = ', '.join(node.get_fully_qualified_name() for node in self.nodes)
            raise RunError(f'{names} joined after the start: a run is in progress here; {CURE}')
        self.start(RunPlan(**run))

    def _starts_its_own_run(self, announcement: Announcement) -> bool:
        """Return whether a process announces a run of its own timer; report it if not."""
        run = announcement.run
        assert run is not None
        is_own = announcement.process in run['processes'] and run['timer'] in announcement.ticks
        if not is_own:
            self._ignore(f'process {shown(announcement.process)} starts a run that belongs to another timer')
        return is_own

    # State shared by this process and the others.

    def start(self, run: RunPlan) -> None:
        """Start the run in this process and announce it."""
        for node in self.nodes:
            node.begin(run)
        # Preparing may take long on a busy machine; announcements received meanwhile are still unread.
        self.peers.expect(run.processes, time.monotonic())
        self.run = run
        self.state = RUNNING
        for process, announcement in self._unknown.items():
            is_peer = process in run.processes and self.peers.receive(announcement, time.monotonic())
            if is_peer and announcement.state in (FAILED, INTERRUPTED):
                self._receive_end(announcement)
        self._unknown.clear()
        self.announce()

    def timer(self) -> TimerAnnouncement | None:
        """Return the announcement of the timer, in this process or another; None while it is unknown."""
        return self.peers.timer() if self.timer_node is None else self._own_timer()

    def known_nodes(self, now: float) -> Iterator[tuple[str, dict[str, Any]]]:
        """Iterate over names and metadata of all nodes of this process and the others."""
        yield from self._own_nodes().items()
        yield from self.peers.nodes(now)

    def others_are(self, *states: str) -> bool:
        """Return whether all other processes are known and in one of the given states."""
        announcements = self.peers.announcements
        processes = announcements if self.run is None else self.run.processes
        return all(
            process in announcements and announcements[process].state in states
            for process in processes
            if process != self.identifier
        )


def _reason_of(announcement: Announcement) -> str:
    """Return the reason why a peer ended, as one non-empty line."""
    reason = ' '.join(announcement.reason.split())[:_LONGEST_REASON]
    names = ', '.join(announcement.ticks) or announcement.process
    return reason or f'{shown(names)} has {announcement.state} and gave no reason'
