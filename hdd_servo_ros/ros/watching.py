"""During a run: detect peers that are gone, messages that were lost and second publishers."""

import math
import time

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.outcome import FINISHED, Outcome
from hdd_servo_ros.ros.announcement import DONE
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import PERIODS, Member
from hdd_servo_ros.ros.publishers import publishers_of

_STALLED = 1.0
"""A loop that fires no node for this long stands still [s]."""
_PATIENCE_WHILE_RUNNING = 3.0
"""How many times the timeout a peer may be silent as long as ticks go on."""
_UNDER_WAY = 0.5
"""How long the first message after a pause may take [s]."""
_REPEATED_WITHIN = 1.0
"""Time beyond ``peer_timeout`` that a lost message is given; DDS repeats it within 3 s [s]."""
_GRAPH_CHECK_PERIOD = 0.5
"""Wall time between two counts of each topic's publishers [s]."""
_SECOND_PUBLISHER = 1.5
"""How long a second publisher of a topic may be there: one that came too late by mistake introduces itself [s]."""
_LATECOMER = 25.0
"""
The same for the topics of a process that has introduced itself as one that has come too late, and ends [s].

Longer than DDS remembers it, should it be killed.
"""


class PeerEnded(Exception):
    """A peer has announced that the run ends, and how."""

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
            For how long no node of this process has fired [s].

        Raises
        ------
        RunError
            If a peer is silent for too long, or a topic has a second publisher.
        PeerEnded
            If a peer has announced that the run ends.
        """
        member = self._member
        assert member.run is not None
        now = time.monotonic()
        member.announce_when_due(now, PERIODS[member.state])
        if member.outcome_of_peer is not None:
            raise PeerEnded(member.outcome_of_peer)
        # While ticks go on, most of the others must be alive, and only their announcements are late: DDS repeats what
        # got lost after a while, and a busy machine loses much.
        patience = member.timeout if stalled > _STALLED else _PATIENCE_WHILE_RUNNING * member.timeout
        for process in member.run.processes:
            silence = member.peers.silence(process, now)
            if process != member.identifier and silence > patience:
                self._reject_silent(process, silence)
        if now - self._graph_checked_at > _GRAPH_CHECK_PERIOD:
            self._graph_checked_at = now
            # Nothing else would notice a second publisher of a topic that stays inside a process.
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
            return  # it had nothing left to do
        names = process if announcement is None else ', '.join(announcement.ticks)
        raise RunError(
            f'lost a peer: nothing received for {silence:.1f} s from {names}; '
            f'{", ".join(_progress(node) for node in self._member.nodes)}'
        )

    def check_stall(self, stalled: float) -> None:
        """
        Find out why the loop stands still.

        Parameters
        ----------
        stalled
            For how long [s].

        Raises
        ------
        RunError
            If a message was published and did not arrive, if its publisher is external and does not respond, or if
            no node of the run has fired for ``peer_timeout`` although nothing holds it up.
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
                        f'{port.name}: nothing for tick {expected} in {stalled:.1f} s; '
                        f'published by {publishers_of(node, port.name)}'
                    )
            elif ticks[publisher] > expected and self._is_overdue(port.name, expected):
                raise RunError(f'{port.name}: tick {expected} was published by {publisher} and did not arrive')

    def _check_standstill(self, stalled: float) -> None:
        """
        End a run none of whose nodes fires any more, whatever the cause.

        The process of the timer alone judges: no other knows whether the run is paused, or when the next tick is due.
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
        End the run if a topic has a second publisher that stays.

        One that has come too late by mistake is given the time to end: until its run begins it publishes nothing.
        """
        count = node.count_publishers(topic)
        if count <= 1:
            self._doubled_since.pop(topic, None)
            return
        seconds = now - self._doubled_since.setdefault(topic, now)
        is_latecomer = now - self._member.latecomers.get(topic, -math.inf) < _LATECOMER
        if seconds > (_LATECOMER if is_latecomer else _SECOND_PUBLISHER):
            publishers = publishers_of(node, topic)
            raise RunError(f'{topic}: {count} publishers at tick {node.tick}, one is allowed: {publishers}')

    def _is_overdue(self, topic: str, tick: int) -> bool:
        """Return whether a message has been overdue for a while: right after a pause, the first one is under way."""
        now = time.monotonic()
        return now - self._overdue_since.setdefault((topic, tick), now) > _UNDER_WAY


def _progress(node: LoopNode) -> str:
    port = node.missing()
    if port is None:
        return f'{node.get_name()} is at tick {node.tick}'
    return f'{port.name} is missing for tick {node.tick - port.delay}'
