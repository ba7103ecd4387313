"""What this process has not discovered yet of the graph before a run, and what must not be in it."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.topics import RECORDED, RECORDER
from hdd_servo_ros.parameters.run_parameters import SampleTimeParameters, TimerParameters
from hdd_servo_ros.ros.announcement import READY
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import Member
from hdd_servo_ros.ros.publishers import UNDISCOVERED_NODE, publishers_of

_EXTERNAL_AFTER = 5.0
"""
How long a publisher may go unannounced before it counts as an external, ordinary ROS node that keeps to the stamps [s].

DDS repeats a lost announcement after 3 s, so that one topic of a node may be known that much before another.
"""
_LEASE = 25.0
"""Longer than DDS remembers a participant that was killed: 20 s unless configured otherwise [s]."""

NamedMetadata = Sequence[tuple[str, Mapping[str, Any]]]
"""Full names and metadata of nodes; a name may occur twice."""


class Discovery:
    """
    What this process still waits for before a run.

    Parameters
    ----------
    member
        This process.
    """

    def __init__(self, member: Member) -> None:
        self._member = member
        self._unannounced_since: dict[str, float] = {}
        self._doubled_since: dict[str, float] = {}

    def missing(self, now: float) -> Iterator[str]:
        """
        Iterate over what is missing at a time of the monotonic clock [s].

        Raises
        ------
        RunError
            If the run cannot start: sample times differ, a topic has two publishers, or one is published beside the
            topic that takes its place.
        """
        member = self._member
        timer = member.timer()
        if timer is None:
            yield 'deterministic_timer'
        else:
            self._check_sample_time(timer.sample_time)
        known = list(member.known_nodes(now))
        for node in member.nodes:
            for port in node.inputs:
                if not _is_replaced(node, port, known):
                    yield from self._missing_for_input(node, port, known, now)
            for port in node.optional_inputs:
                announced = _announced_publishers(port.name, known)
                if announced and port.subscription.get_publisher_count() == 0:
                    yield f'{announced[0]} (not yet discovered on {port.name})'
                elif not announced and node.count_publishers(port.name):
                    # One that does not introduce itself in time is no loop node, and only those are read here.
                    if self._is_external(port.name, now):
                        member.report_ignored_publisher(node, port.name)
                    else:
                        yield f'the publisher of {port.name} to announce itself'
            for publisher in node.loop_publishers:
                readers = sum(publisher.topic_name in metadata['inputs'] for _, metadata in known)
                if publisher.get_subscription_count() < readers:
                    yield f'the readers of {publisher.topic_name}'
        if member.timer_node is not None:
            if member.timer_node.parameters[TimerParameters].record and not _is_recorded(known):
                yield f'{RECORDER} (parameter record of deterministic_timer is true)'
            yield from self._unready()

    def _missing_for_input(self, node: LoopNode, port: Input, known: NamedMetadata, now: float) -> Iterator[str]:
        announced = _announced_publishers(port.name, known)
        if node.count_publishers(port.name) > 1:
            yield self._second_publisher(node, port.name, now)
        if port.subscription.get_publisher_count() == 0:
            yield f'{port.topic.writer} (nobody publishes {port.name})'
        elif announced:
            # From now on it is not external, also while it is too busy to announce itself.
            self._unannounced_since[port.name] = math.inf
        elif not self._is_external(port.name, now):
            yield f'the publisher of {port.name} to announce itself'

    def _unready(self) -> Iterator[str]:
        """
        Iterate over what the timer waits for, including processes known only to others so far.

        A process that does not know all others yet may be ready all the same, without having discovered their readers
        of its topics: they would miss tick 0.
        """
        announcements = self._member.peers.announcements
        known = {self._member.identifier, *announcements}
        for process, announcement in announcements.items():
            names = ', '.join(announcement.nodes or ())
            if announcement.state != READY:
                yield f'{names or process} to get ready'
            unknown = set(announcement.hears or ()) - known
            if unknown:
                yield f'{len(unknown)} more processes known to {names}'
            unheard = known - {process} - set(announcement.hears or ())
            if unheard:
                yield f'{names or process} to hear from {len(unheard)} more processes'

    def _is_external(self, topic: str, now: float) -> bool:
        """Return whether a topic's publisher is external: it had time to announce itself and did not."""
        return now - self._unannounced_since.setdefault(topic, now) > _EXTERNAL_AFTER

    def _check_sample_time(self, sample_time: float) -> None:
        for node in self._member.nodes:
            if node is self._member.timer_node:
                continue
            own = node.parameters[SampleTimeParameters].sample_time
            if own not in (0.0, sample_time):
                raise RunError(
                    f'{node.get_fully_qualified_name()}: invalid value for parameter sample_time: {own!r} s; expected '
                    f'deterministic_timer has {sample_time!r} s'
                )

    def _second_publisher(self, node: LoopNode, topic: str, now: float) -> str:
        """
        Judge a second publisher before the run: DDS remembers one that was killed until its lease has run out.

        Returns
        -------
        str
            What to wait for.

        Raises
        ------
        RunError
            If two different nodes publish the topic, or one has done so for longer than any lease.
        """
        names = publishers_of(node, topic)
        different = len(set(names.split(', '))) > 1 and UNDISCOVERED_NODE not in names
        if different or now - self._doubled_since.setdefault(topic, now) > _LEASE:
            raise RunError(f'{topic}: 2 publishers, one is allowed: {names}')
        return f'one of two publishers of {topic} to disappear ({names})'


def _announced_publishers(topic: str, known: NamedMetadata) -> list[str]:
    """Return the names of the nodes that announce that they publish a topic; :class:`RunError` if there are several."""
    announced = [name for name, metadata in known if topic in metadata['outputs']]
    if len(announced) > 1:
        raise RunError(f'{topic}: {len(announced)} publishers, one is allowed: {", ".join(announced)}')
    return announced


def _is_replaced(node: LoopNode, port: Input, known: NamedMetadata) -> bool:
    """Return whether a node publishes what takes an input's place; :class:`RunError` if one publishes the input too."""
    for other in node.optional_inputs:
        if other.topic.name == port.topic.replaced_by:
            replacing, replaced = _announced_publishers(other.name, known), _announced_publishers(port.name, known)
            if replacing and replaced:
                publishers = f'{other.name} is published by {replacing[0]} and {port.name} by {replaced[0]}'
                raise RunError(f'{publishers}: a run has one of them')
            return bool(replacing)
    return False


def _is_recorded(known: NamedMetadata) -> bool:
    return any(output.endswith(RECORDED.name) for _, metadata in known for output in metadata['outputs'])
