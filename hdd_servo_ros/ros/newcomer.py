"""Search for a running graph that a new process would disturb, before it publishes on a loop topic."""

import time
from collections.abc import Iterable, Sequence

import rclpy
from std_msgs.msg import String

from hdd_servo_ros.ros.announcement import DONE, READY, RUNNING, WAITING, Announcement, AnnouncementError, decode
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import CURE, LOCKSTEP, LOCKSTEP_QOS
from hdd_servo_ros.ros.untrusted import MessageError, message_of

_SHORTEST_SEARCH = 0.5
"""On an idle machine, processes discover each other in half of this time [s]."""
_LONGEST_SEARCH = 2.0
"""Longest wait for an announcement of every discovered process; during a run one sends it every 0.4 s [s]."""
_POLLING_PERIOD = 0.02


def outputs_of(nodes: Sequence[LoopNode]) -> list[str]:
    """Return the full names of the topics that nodes publish, or will."""
    return [node.resolve_topic_name(topic.name) for node in nodes for topic in node.outputs]


class Lookout:
    """
    Receiver of the announcements of processes on other machines, active from its construction on.

    Construct it before the nodes of this process, so that it receives while they are constructed. Processes on this
    machine are found by :class:`~hdd_servo_ros.ros.topic_claims.TopicClaims` without any wait.
    """

    def __init__(self) -> None:
        self._node = rclpy.create_node('_lookout', start_parameter_services=False, enable_rosout=False)
        self._subscription = self._node.create_subscription(String, LOCKSTEP, lambda _: None, LOCKSTEP_QOS, raw=True)
        self._started = time.monotonic()
        self._received: dict[str, Announcement] = {}

    def why_not_to_join(self, nodes: Sequence[LoopNode]) -> str:
        """
        Return why the nodes of this process must not join; empty if they may.

        Parameters
        ----------
        nodes
            The nodes; they have not created a publisher of the loop yet.
        """
        own = set(outputs_of(nodes))
        while True:
            self._take()
            reason = _reason(self._received.values(), own)
            elapsed = time.monotonic() - self._started
            # DDS remembers the publisher of a killed process for a while; it sends no announcements.
            is_complete = len(self._received) >= self._node.count_publishers(LOCKSTEP)
            if reason or elapsed > _LONGEST_SEARCH or (elapsed > _SHORTEST_SEARCH and is_complete):
                return reason
            time.sleep(_POLLING_PERIOD)

    def close(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_node()

    def _take(self) -> None:
        while (taken := self._subscription.handle.take_message(String, True)) is not None:
            try:
                announcement = decode(message_of(String, taken[0]).data)
            except (MessageError, AnnouncementError):
                continue  # the processes of that run report it
            self._received[announcement.process] = announcement


def _reason(received: Iterable[Announcement], own: set[str]) -> str:
    for announcement in received:
        if announcement.state in (RUNNING, DONE):
            return f'a run is in progress here ({", ".join(announcement.ticks)}); {CURE}'
        if announcement.state in (WAITING, READY):
            for name, node in (announcement.nodes or {}).items():
                both = sorted(own.intersection(node['outputs']))
                if both:
                    return f'{name} already publishes {both[0]}; {CURE}'
    return ''
