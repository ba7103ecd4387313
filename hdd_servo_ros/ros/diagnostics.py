"""Diagnostics of the loop nodes on `/diagnostics`, published once per second of wall time by the housekeeping."""

import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.loop_node import LoopNode

PERIOD = 1.0
"""Wall time between two reports [s]."""


class DiagnosticsPublisher:
    """
    Publisher of the diagnoses of the nodes of a process; it publishes only while `/diagnostics` has a subscriber.

    Parameters
    ----------
    nodes
        The nodes; the first one owns the publisher.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self._nodes = nodes
        # Absolute, as diagnostics tools expect it.
        self._publisher = nodes[0].create_publisher(DiagnosticArray, '/diagnostics', 10)
        # The values describe the node; the header stamp is wall time, so that viewers show when they were reported.
        self._clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._due = time.monotonic()

    def publish_when_due(self) -> None:
        """Publish if a second has passed since the last time."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + PERIOD
        if not self._publisher.get_subscription_count():
            return
        array = DiagnosticArray()
        array.header.stamp = self._clock.now().to_msg()
        array.status = [_status(node, diagnosis) for node in self._nodes for diagnosis in node.diagnose()]
        self._publisher.publish(array)


def _status(node: LoopNode, diagnosis: Diagnosis) -> DiagnosticStatus:
    values = [KeyValue(key=key, value=_text(value)) for key, value in diagnosis.values.items()]
    return DiagnosticStatus(
        level=diagnosis.level,
        name=f'{node.get_fully_qualified_name().lstrip("/")}: {diagnosis.what}',
        message=diagnosis.message,
        values=values,
    )


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
