"""Membership of this process in a run: what it announces to the others, and what it receives from them."""

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
"""What to do about a graph that is there already."""
LOCKSTEP = 'lockstep'
"""Topic of the announcements."""
LOCKSTEP_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
_MOST_UNHEARD = 100
"""Of how many processes that have shown no nodes the last announcement is kept until a run starts."""
_LONGEST_REASON = 1000
"""Characters of a peer's reason that are repeated."""


class Member:
    """
    Membership of this process in a run: its state, its announcements, and what the others have announced.

    Nothing here carries loop data, and nothing here decides when a node fires.

    Parameters
    ----------
    nodes
        The loop nodes of this process, connected; the first one lends its publisher and subscription.
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
        """How the run has ended for the first peer that has announced an end other than a finished run."""
        self.ignored = IgnoredMessages(nodes[0])
        self.latecomers: dict[str, float] = {}
        """Inputs that a process publishes too which has come after the start, and when it was heard of last [s]."""
        self._unheard: dict[str, Announcement] = {}
        """Before a run, the last announcement of each process whose nodes were never announced; a run may name it."""
        self._reported: set[str] = set()
        self._announced_at = 0.0
        self._publisher = nodes[0].create_publisher(String, LOCKSTEP, LOCKSTEP_QOS)
        # Raw: what is not even a string must not reach the deserializer of an executor, which would raise.
        self._subscription = nodes[0].create_subscription(String, LOCKSTEP, self._receive, LOCKSTEP_QOS, raw=True)

    def report_ignored_publisher(self, node: LoopNode, topic: str) -> None:
        """Say, once, that an optional topic of the loop is published by who is no loop node of this run."""
        if topic not in self._reported:
            self._reported.add(topic)
            node.get_logger().warning(
                f'{topic} is ignored: {publishers_of(node, topic)} publishes it and is no loop node of this run; such '
                'a node is a LoopNode that starts together with the others, as examples/disturbance_node.py is'
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
            hears=list(self.peers.announcements) if gathering else None,
            directory=directory or None,
            timer=self._own_timer(),
            run=self._own_run(),
        )
        if directory:
            self._set_directory(directory)
        self._publisher.publish(String(data=announcement.encode()))
        self._announced_at = time.monotonic()

    def announce_when_due(self, now: float, period: float) -> None:
        """Send an announcement, if a period [s] has passed since the last one."""
        if now - self._announced_at > period:
            self.announce()

    def wait_for_acknowledgments(self, timeout: Duration) -> None:
        """Wait until all processes that are left have received what was sent."""
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
        """Return whether the sender has a part in the run, or before it may have one; report a stranger."""
        process = announcement.process
        if self.run is not None:
            if process in self.run.processes:
                return True
            if not announcement.nodes:
                self._ignore(f'process {shown(process)} has no part in this run')
            else:  # it has come too late, and will leave by itself
                outputs = {topic for node in announcement.nodes.values() for topic in node['outputs']}
                read = {port.name for node in self.nodes for port in node.inputs}
                self.latecomers.update(dict.fromkeys(outputs & read, time.monotonic()))
            return False
        if announcement.nodes or process in self.peers.announcements:
            return True
        if announcement.run:
            return self._starts_its_own_run(announcement)
        # Without nodes: of another run, or of one that starts and that this process has not heard of yet.
        if not announcement.ticks or announcement.state in (WAITING, READY):
            self._ignore(f'process {shown(process)} announces no nodes')
        elif announcement.state in (FAILED, INTERRUPTED):
            self._ignore(f'process {shown(process)} has {announcement.state}, and no node of it was ever announced')
        if announcement.ticks and (process in self._unheard or len(self._unheard) < _MOST_UNHEARD):
            self._unheard[process] = announcement
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
            # Before a run, a node that a person stops may be started again.
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
        """Return whether the run that a process announces is one of its own timer; report another."""
        run = announcement.run
        assert run is not None
        is_own = announcement.process in run['processes'] and run['timer'] in announcement.ticks
        if not is_own:
            self._ignore(f'process {shown(announcement.process)} starts a run that is not its own')
        return is_own

    # What this process and the others know together.

    def start(self, run: RunPlan) -> None:
        """Start the run in this process, and announce that."""
        for node in self.nodes:
            node.begin(run)
        # To begin may take long on a busy machine, and what the others have announced meanwhile is not read yet.
        self.peers.expect(run.processes, time.monotonic())
        self.run = run
        self.state = RUNNING
        for process, announcement in self._unheard.items():
            is_taken = process in run.processes and self.peers.receive(announcement, time.monotonic())
            if is_taken and announcement.state in (FAILED, INTERRUPTED):
                self._receive_end(announcement)
        self._unheard.clear()
        self.announce()

    def timer(self) -> TimerAnnouncement | None:
        """Return what the timer announces, be it in this process or another; None as long as it is unknown."""
        return self.peers.timer() if self.timer_node is None else self._own_timer()

    def known_nodes(self, now: float) -> Iterator[tuple[str, dict[str, Any]]]:
        """Iterate over names and metadata of all nodes of this process and the others."""
        yield from self._own_nodes().items()
        yield from self.peers.nodes(now)

    def others_are(self, *states: str) -> bool:
        """Return whether all other processes are in one of some states; one that is still unknown is in none."""
        announcements = self.peers.announcements
        processes = announcements if self.run is None else self.run.processes
        return all(
            process in announcements and announcements[process].state in states
            for process in processes
            if process != self.identifier
        )


def _reason_of(announcement: Announcement) -> str:
    """Return why a peer has ended, in one line that is never empty."""
    reason = ' '.join(announcement.reason.split())[:_LONGEST_REASON]
    names = ', '.join(announcement.ticks) or announcement.process
    return reason or f'{shown(names)} has {announcement.state} and gave no reason'
