"""Input of a loop node: a subscription whose messages are read in tick order."""

import collections
from collections.abc import Callable
from typing import Any, NoReturn

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.subscription import Subscription

from hdd_servo_ros.messages.cdr import STAMP, array_names_and_offset
from hdd_servo_ros.messages.checked import LITTLE_ENDIAN, check_message
from hdd_servo_ros.messages.errors import RunError, StampError
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LoopTopic
from hdd_servo_ros.ros.loop_topics import LOOP_QOS, message_class
from hdd_servo_ros.ros.publishers import publishers_of


class TakenByLockstep(CallbackGroup):
    """Callback group of loop subscriptions: executors leave their messages to the lockstep."""

    def can_execute(self, entity: object) -> bool:
        """Return that no executor may take a message."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Return that no executor may begin to execute a callback."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing, because no execution has begun."""


class Input:
    """
    Loop topic that a node reads.

    Parameters
    ----------
    topic
        The topic.
    delay
        The node needs the message of tick k - ``delay`` at tick k, and no message while k < ``delay``.
    """

    def __init__(self, topic: LoopTopic, delay: int = 0) -> None:
        self.topic = topic
        self.delay = delay
        self.subscription: Subscription
        self.name: str
        self._node: Node
        self._take: Callable[[type, bool], Any]
        self._type: type
        self._ticks: Ticks
        self.queue: collections.deque[bytes] | None = None
        """Queue that a node of this process fills with the messages; None if they arrive over DDS."""
        self.take: Callable[[], bytes | None] = self._take_message
        """Return the next message as bytes; None if no message has arrived."""
        self.take_for: Callable[[int, bytes], bytes | None] = self._take_checked
        """
        Return the message needed for a tick of the reader: None if it has not arrived, empty if none is needed.

        The arguments are the tick and its eight stamp bytes. It raises :class:`RunError` if the next message belongs
        to another tick or is not a message of the topic.
        """
        self._is_array = not topic.codec.is_stamped
        self._array_stamp: slice | None = None
        """Slice of the element t of an array message, which has no header; known from the first message on."""
        self._size = 0
        """Size of the last message that was checked to be valid [bytes]."""
        self._begin = LITTLE_ENDIAN
        """First bytes of a message of that size that needs no further check."""

    def connect(self, node: Node, group: CallbackGroup) -> None:
        """Subscribe."""
        self._node = node
        self._type = message_class(self.topic.type_name)
        self.subscription = node.create_subscription(
            self._type, self.topic.name, lambda _: None, LOOP_QOS, callback_group=group, raw=True
        )
        self.name = self.subscription.topic_name
        self._take = self.subscription.handle.take_message

    def begin(self, ticks: Ticks) -> None:
        """Receive the ticks of the run."""
        self._ticks = ticks

    def read_locally(self) -> collections.deque[bytes]:
        """
        Read the messages from a queue from now on instead of over DDS; called before tick 0.

        Returns
        -------
        deque
            Queue to which the publisher, a node of this process, appends its message of every tick.
        """
        queue = self.queue = collections.deque([b''] * self.delay)
        self.take = lambda: queue.popleft() if queue else None
        # No check: the publisher is a node of this run, and a queue neither loses nor repeats messages.
        self.take_for = lambda tick, stamp: queue.popleft() if queue else None
        return queue

    def _take_message(self) -> bytes | None:
        taken = self._take(self._type, True)
        return None if taken is None else taken[0]

    def _take_checked(self, tick: int, stamp: bytes) -> bytes | None:
        if self.delay:
            if tick < self.delay:
                return b''
            stamp = self._ticks.stamp(tick - self.delay)
        taken = self._take(self._type, True)
        if taken is None:
            return None
        message: bytes = taken[0]
        if len(message) != self._size or not message.startswith(self._begin):
            self._examine(message, tick - self.delay)
        if self._is_array:
            self._check_array(message, tick - self.delay)
        elif message[STAMP] != stamp:
            self._reject(tick - self.delay, self._ticks.tick_of(message[STAMP]))
        return message

    def _examine(self, message: bytes, expected: int) -> None:
        """Reject an invalid message; the next message with this size and beginning is not checked again."""
        try:
            check_message(self.topic.codec, message)
        except ValueError as error:
            publishers = publishers_of(self._node, self.name)
            raise RunError(f'{self.name}: at tick {expected}: {error}; published by {publishers}') from None
        if self._is_array:
            _, offset = array_names_and_offset(message)
            self._array_stamp = slice(offset, offset + 8)
            self._begin = message[:offset]
        self._size = len(message)

    def _check_array(self, message: bytes, expected: int) -> None:
        assert self._array_stamp is not None
        stamp = message[self._array_stamp]
        if stamp != self._ticks.seconds_bytes(expected):
            self._reject(expected, self._ticks.tick_of_seconds(stamp))

    def _reject(self, expected: int, received: float) -> NoReturn:
        raise StampError(self.name, expected, received, publishers_of(self._node, self.name))
