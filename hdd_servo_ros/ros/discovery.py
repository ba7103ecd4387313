"""Discovery of the graph before a run: missing nodes and conflicting publishers."""

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
Time after which an unannounced publisher counts as an external node, which must publish the stamp of each tick [s].

DDS repeats a lost discovery message after 3 s; one topic of a node may be known that much earlier than another.
"""
_LEASE = 25.0
"""Longer than the lease of a killed DDS participant: 20 s unless configured otherwise [s]."""

NamedMetadata = Sequence[tuple[str, Mapping[str, Any]]]
"""Full names and metadata of nodes; a name may occur twice."""


class Discovery:
    """
    Missing nodes and topics for which this process waits before a run.

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
        Iterate over the missing nodes and topics at a time of the monotonic clock [s].

        Raises
        ------
        RunError
            If the run cannot start: sample times differ, a topic has two publishers, or a topic is published together
            with the topic that replaces it.
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
                    # A node that does not announce itself in time is not a loop node; optional topics need one.
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
            # From now on it is not external, even while it is too busy to announce itself.
            self._unannounced_since[port.name] = math.inf
        elif not self._is_external(port.name, now):
            yield f'the publisher of {port.name} to announce itself'

    def _unready(self) -> Iterator[str]:
        """
        Iterate over the processes for which the timer waits, including those known only to others.

        A process may be ready without knowing all others. It may then not have discovered all readers of its topics,
        and those would not receive tick 0.
        """
        announcements = self._member.peers.announcements
        known = {self._member.identifier, *announcements}
        for process, announcement in announcements.items():
            names = ', '.join(announcement.nodes or ())
            if announcement.state != READY:
                yield f'{names or process} to get ready'
            unknown = set(announcement.receives or ()) - known
            if unknown:
                yield f'{len(unknown)} more processes known to {names}'
            unreceived = known - {process} - set(announcement.receives or ())
            if unreceived:
                yield f'{names or process} to receive {len(unreceived)} more processes'

    def _is_external(self, topic: str, now: float) -> bool:
        """Return whether the publisher of a topic is external: it did not announce itself in time."""
        return now - self._unannounced_since.setdefault(topic, now) > _EXTERNAL_AFTER

    def _check_sample_time(self, sample_time: float) -> None:
        for node in self._member.nodes:
            if node is self._member.timer_node:
                continue
            own = node.parameters[SampleTimeParameters].sample_time
            if own not in (0.0, sample_time):
                raise RunError(
                    f'{node.get_fully_qualified_name()}: invalid value for parameter sample_time: {own!r} s; expected '
                    f'{sample_time!r} s, the sample time of deterministic_timer'
                )

    def _second_publisher(self, node: LoopNode, topic: str, now: float) -> str:
        """
        Check a second publisher before the run; DDS remembers a killed one until its lease expires.

        Returns
        -------
        str
            What this process waits for.

        Raises
        ------
        RunError
            If two different nodes publish the topic, or the second publisher outlasts the lease.
        """
        names = publishers_of(node, topic)
        different = len(set(names.split(', '))) > 1 and UNDISCOVERED_NODE not in names
        if different or now - self._doubled_since.setdefault(topic, now) > _LEASE:
            raise RunError(f'{topic} has 2 publishers but must have exactly one: {names}')
        return f'one of two publishers of {topic} to disappear ({names})'


def _announced_publishers(topic: str, known: NamedMetadata) -> list[str]:
    """Return the names of the nodes that announce a topic as output; raises :class:`RunError` if there are several."""
    announced = [name for name, metadata in known if topic in metadata['outputs']]
    if len(announced) > 1:
        raise RunError(f'{topic} has {len(announced)} publishers but must have exactly one: {", ".join(announced)}')
    return announced


def _is_replaced(node: LoopNode, port: Input, known: NamedMetadata) -> bool:
    """Return whether the topic that replaces an input is published; :class:`RunError` if the input is published too."""
    for other in node.optional_inputs:
        if other.topic.name == port.topic.replaced_by:
            replacing, replaced = _announced_publishers(other.name, known), _announced_publishers(port.name, known)
            if replacing and replaced:
                publishers = f'{other.name} is published by {replacing[0]} and {port.name} by {replaced[0]}'
                raise RunError(f'{publishers}; a run must have only one of them')
            return bool(replacing)
    return False


def _is_recorded(known: NamedMetadata) -> bool:
    return any(output.endswith(RECORDED.name) for _, metadata in known for output in metadata['outputs'])
