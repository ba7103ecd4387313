"""Supervision during a run: detect lost peers, lost messages and second publishers."""

import math
import time

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.outcome import FINISHED, Outcome
from hdd_servo_ros.ros.announcement import DONE
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import PERIODS, Member
from hdd_servo_ros.ros.publishers import publishers_of

_STALLED = 1.0
"""A loop in which no node fires for this long is stalled [s]."""
_PATIENCE_WHILE_RUNNING = 3.0
"""Multiple of ``peer_timeout`` for which a peer may be silent while ticks continue."""
_UNDER_WAY = 0.5
"""Longest transmission time of the first message after a pause [s]."""
_REPEATED_WITHIN = 1.0
"""Time after ``peer_timeout`` within which a lost message may still arrive; DDS repeats it within 3 s [s]."""
_GRAPH_CHECK_PERIOD = 0.5
"""Wall time between two counts of each topic's publishers [s]."""
_SECOND_PUBLISHER = 1.5
"""How long a second publisher of a topic is accepted; a process that joins after the start announces itself [s]."""
_LATE_PUBLISHER = 25.0
"""
The same for the topics of a process that joined after the start, announced itself, and is about to end [s].

Longer than the lease of its DDS participant, in case the process is killed.
"""


class PeerEnded(Exception):
    """A peer has announced the end of the run; ``outcome`` is how it ended."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


class Watching:
    """
    Checks on the other processes during a run.

    Parameters
    ----------
    member
        This process.
    """

    def __init__(self, member: Member) -> None:
        self._member = member
        self._overdue_since: dict[tuple[str, int], float] = {}
        self._doubled_since: dict[str, float] = {}
        self._ticks: dict[str, int] = {}
        self._still_since = math.inf
        self._graph_checked_at = 0.0

    def watch(self, stalled: float = math.inf) -> None:
        """
        Check the others.

        Parameters
        ----------
        stalled
            Time for which no node of this process has fired [s].

        Raises
        ------
        RunError
            If a peer is silent for too long or a topic has a second publisher.
        PeerEnded
            If a peer has announced that the run ends.
        """
        member = self._member
        assert member.run is not None
        now = time.monotonic()
        member.announce_when_due(now, PERIODS[member.state])
        if member.outcome_of_peer is not None:
            raise PeerEnded(member.outcome_of_peer)
        # While ticks continue, most other processes are alive and only their announcements are late: a busy machine
        # loses many messages, and DDS repeats them only after a while.
        patience = member.timeout if stalled > _STALLED else _PATIENCE_WHILE_RUNNING * member.timeout
        for process in member.run.processes:
            silence = member.peers.silence(process, now)
            if process != member.identifier and silence > patience:
                self._reject_silent(process, silence)
        if now - self._graph_checked_at > _GRAPH_CHECK_PERIOD:
            self._graph_checked_at = now
            # No other check detects a second publisher of a topic whose messages do not leave this process.
            readers = {port.name: node for node in member.nodes for port in node.inputs}
            for topic, reader in readers.items():
                self._check_publishers(reader, topic, now)
            optional = {port.name: node for node in member.nodes for port in node.optional_inputs}
            for topic, reader in optional.items():
                if member.run.publisher_of(topic) is None and reader.count_publishers(topic):
                    member.report_ignored_publisher(reader, topic)

    def _reject_silent(self, process: str, silence: float) -> None:
        announcement = self._member.peers.announcements.get(process)
        if announcement is not None and announcement.state in (DONE, FINISHED):
            return  # it had completed its work
        names = process if announcement is None else ', '.join(announcement.ticks)
        raise RunError(
            f'lost a peer: no message for {silence:.1f} s (peer_timeout) from {names}; '
            f'{", ".join(_progress(node) for node in self._member.nodes)}'
        )

    def check_stall(self, stalled: float) -> None:
        """
        Determine why the loop is stalled.

        Parameters
        ----------
        stalled
            Time for which it has been stalled [s].

        Raises
        ------
        RunError
            If a published message did not arrive, if its external publisher does not respond, or if no node of the
            run has fired for ``peer_timeout`` although the timer is not held.
        """
        member = self._member
        run = member.run
        assert run is not None
        self._check_standstill(stalled)
        if stalled < member.timeout + _REPEATED_WITHIN:
            self._overdue_since.clear()
            return
        ticks = member.peers.ticks()
        ticks.update({node.get_fully_qualified_name(): node.tick for node in member.nodes})
        for node in member.nodes:
            port = node.missing()
            if port is None:
                continue
            expected = node.tick - port.delay
            publisher = run.publisher_of(port.name)
            if publisher is None:
                if ticks[run.timer] > expected and self._is_overdue(port.name, expected):
                    raise RunError(
                        f'{port.name}: no message for tick {expected} in {stalled:.1f} s; '
                        f'published by {publishers_of(node, port.name)}'
                    )
            elif ticks[publisher] > expected and self._is_overdue(port.name, expected):
                raise RunError(f'{port.name}: tick {expected} was published by {publisher} and did not arrive')

    def _check_standstill(self, stalled: float) -> None:
        """
        End a run in which no node fires any more, whatever the cause.

        Only the process of the timer decides: the others know neither whether the run is paused nor when the next tick
        is due.
        """
        member = self._member
        timer = member.timer_node
        if timer is None:
            return
        now = time.monotonic()
        ticks = {**member.peers.ticks(), **{node.get_fully_qualified_name(): node.tick for node in member.nodes}}
        if stalled < _STALLED or timer.is_held or ticks != self._ticks:
            self._ticks = ticks
            self._still_since = math.inf
            return
        self._still_since = min(self._still_since, now)
        if now - self._still_since > member.timeout + _REPEATED_WITHIN:
            raise RunError(
                f'no node has fired for {stalled:.1f} s (parameter peer_timeout); '
                f'{", ".join(_progress(node) for node in member.nodes)}; '
                f'next ticks: {", ".join(f"{name} {tick}" for name, tick in ticks.items())}'
            )

    def _check_publishers(self, node: LoopNode, topic: str, now: float) -> None:
        """
        End the run if a topic has a second publisher that persists.

        A process that joined after the start is given time to end: it publishes nothing before its own run begins.
        """
        count = node.count_publishers(topic)
        if count <= 1:
            self._doubled_since.pop(topic, None)
            return
        seconds = now - self._doubled_since.setdefault(topic, now)
        is_late = now - self._member.late_outputs.get(topic, -math.inf) < _LATE_PUBLISHER
        if seconds > (_LATE_PUBLISHER if is_late else _SECOND_PUBLISHER):
            publishers = publishers_of(node, topic)
            raise RunError(
                f'{topic} has {count} publishers at tick {node.tick} but must have exactly one: {publishers}'
            )

    def _is_overdue(self, topic: str, tick: int) -> bool:
        """Return whether a message has been overdue for a while; right after a pause it may still be in transit."""
        now = time.monotonic()
        return now - self._overdue_since.setdefault((topic, tick), now) > _UNDER_WAY


def _progress(node: LoopNode) -> str:
    port = node.missing()
    if port is None:
        return f'{node.get_name()} is at tick {node.tick}'
    return f'{port.name} is missing for tick {node.tick - port.delay}'
