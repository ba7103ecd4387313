"""Receiver of `scope`: blocks from the recorder and the end of the run, in a separate thread."""

import contextlib
import queue
import threading
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String

from hdd_servo_ros.messages import exit_codes
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED
from hdd_servo_ros.messages.scope_blocks import ScopeMessage, read_scope_message
from hdd_servo_ros.messages.topics import SCOPE
from hdd_servo_ros.reporting.live_view import LiveView
from hdd_servo_ros.ros.announcement import Announcement, AnnouncementError, decode
from hdd_servo_ros.ros.ignored_messages import IgnoredMessages
from hdd_servo_ros.ros.untrusted import MessageError, message_of

_BEST_EFFORT = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
_PRESENCE_PERIOD = 0.2
_GONE_AFTER = 10
"""Consecutive checks without a recorder after which its run is over; not a time, because drawing may be slow."""


class FeedError(Exception):
    """Receiving has failed; the message contains the reason."""

    exit_code = exit_codes.FAILED


class Feed:
    """
    Data from the recorder of the first run that is discovered; other runs are ignored.

    Parameters
    ----------
    view
        View that receives the data when :meth:`pour` is called.
    """

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._received: queue.SimpleQueue[ScopeMessage] = queue.SimpleQueue()
        self._run = ''
        self._processes: set[str] = set()
        self._has_reported_end = False
        self._absent = 0
        self._fault: Exception | None = None
        self._node = rclpy.create_node('scope')
        self._ignored = IgnoredMessages(self._node)
        # Raw, because bytes that are not a message of the type must not end the thread.
        for kind, topic, take in ((Float64MultiArray, SCOPE, self._take_block), (String, 'lockstep', self._take_state)):
            self._node.create_subscription(kind, topic, take, _BEST_EFFORT, raw=True)
        self._node.create_timer(_PRESENCE_PERIOD, self._check_presence)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread."""
        self._executor.shutdown()
        self._thread.join()

    def _spin(self) -> None:
        try:
            with contextlib.suppress(ExternalShutdownException):
                self._executor.spin()
        except Exception as error:
            self._fault = error

    def _take_block(self, message: bytes) -> None:
        try:
            received = read_scope_message(message_of(Float64MultiArray, message))
        except ValueError as error:
            self._ignore(SCOPE, str(error))
            return
        self._run = self._run or received.run
        if received.run == self._run:
            self._received.put(received)
        else:
            self._ignore(SCOPE, 'a block of another run')

    def _take_state(self, message: bytes) -> None:
        try:
            announcement = decode(message_of(String, message).data)
        except (MessageError, AnnouncementError) as error:
            self._ignore('lockstep', str(error))
            return
        self._take_announcement(announcement)

    def _take_announcement(self, announcement: Announcement) -> None:
        if not self._run:
            return
        run: dict[str, Any] | None = announcement.run
        if announcement.process == self._run and run is not None:
            self._processes.update(run['processes'])
        if announcement.process == self._run or announcement.process in self._processes:
            self._has_reported_end |= announcement.state in (FINISHED, FAILED, INTERRUPTED)

    def _ignore(self, topic: str, why: str) -> None:
        self._ignored.add(self._node.resolve_topic_name(topic), why, [])

    def _check_presence(self) -> None:
        self._absent = 0 if self._node.count_publishers(SCOPE) else self._absent + 1

    def pour(self) -> bool:
        """
        Pass the received data to the view; return whether there was any.

        Raises
        ------
        FeedError
            If receiving has failed.
        """
        if self._fault is not None:
            raise FeedError(f'receiving failed: {self._fault}')
        count = self._received.qsize()
        for _ in range(count):
            received = self._received.get()
            self._view.add(received.block, received.units)
        return count > 0

    @property
    def has_ended(self) -> bool:
        """Whether the discovered run is over: it reported its end, or its recorder has disappeared."""
        return not self._view.is_empty and (self._has_reported_end or self._absent >= _GONE_AFTER)
