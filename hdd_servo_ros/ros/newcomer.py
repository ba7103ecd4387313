"""Before a process publishes anything of the loop: the search for a graph that it would disturb."""

import time
from collections.abc import Iterable, Sequence

import rclpy
from std_msgs.msg import String

from hdd_servo_ros.ros.announcement import DONE, READY, RUNNING, WAITING, Announcement, AnnouncementError, decode
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import CURE, LOCKSTEP, LOCKSTEP_QOS
from hdd_servo_ros.ros.untrusted import MessageError, message_of

_LISTENS_FOR = 0.5
"""How long to listen at least; on an idle machine processes have found each other in half of this [s]."""
_HEARS_ALL_WITHIN = 2.0
"""How long to listen at most for those that are there; a process of a run speaks every 0.4 s [s]."""
_POLLING_PERIOD = 0.02


def outputs_of(nodes: Sequence[LoopNode]) -> list[str]:
    """Return the full names of the topics that nodes publish, or will."""
    return [node.resolve_topic_name(topic.name) for node in nodes for topic in node.outputs]


class Lookout:
    """
    Listens to the announcements of the processes of other machines, from its construction on.

    To be made before the nodes of this process: what they take to be made is time to listen. Processes of this machine
    are found by :class:`~hdd_servo_ros.ros.topic_claims.TopicClaims`, for which nobody need wait.
    """

    def __init__(self) -> None:
        self._node = rclpy.create_node('_lookout', start_parameter_services=False, enable_rosout=False)
        self._subscription = self._node.create_subscription(String, LOCKSTEP, lambda _: None, LOCKSTEP_QOS, raw=True)
        self._started = time.monotonic()
        self._heard: dict[str, Announcement] = {}

    def why_not_to_join(self, nodes: Sequence[LoopNode]) -> str:
        """
        Return why the nodes of this process cannot take part, an empty text if they may.

        Parameters
        ----------
        nodes
            The nodes, which have created no publisher of the loop yet.
        """
        own = set(outputs_of(nodes))
        while True:
            self._take()
            reason = _reason(self._heard.values(), own)
            elapsed = time.monotonic() - self._started
            # Of a process that was killed, DDS remembers the publisher for a while; nothing is heard of it.
            is_heard_out = len(self._heard) >= self._node.count_publishers(LOCKSTEP)
            if reason or elapsed > _HEARS_ALL_WITHIN or (elapsed > _LISTENS_FOR and is_heard_out):
                return reason
            time.sleep(_POLLING_PERIOD)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_node()

    def _take(self) -> None:
        while (taken := self._subscription.handle.take_message(String, True)) is not None:
            try:
                announcement = decode(message_of(String, taken[0]).data)
            except (MessageError, AnnouncementError):
                continue  # those whose run it is say so
            self._heard[announcement.process] = announcement


def _reason(heard: Iterable[Announcement], own: set[str]) -> str:
    for announcement in heard:
        if announcement.state in (RUNNING, DONE):
            return f'a run is in progress here, of {", ".join(announcement.ticks)}; {CURE}'
        if announcement.state in (WAITING, READY):
            for name, node in (announcement.nodes or {}).items():
                both = sorted(own.intersection(node['outputs']))
                if both:
                    return f'{name} is here already and publishes {both[0]}; {CURE}'
    return ''
