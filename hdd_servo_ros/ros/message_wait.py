"""Wait for loop messages without an executor."""

from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from hdd_servo_ros.ros.loop_input import Input


class MessageWait:
    """
    Wait for a message on any of several inputs.

    Parameters
    ----------
    context
        ROS context of the nodes of the inputs.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._wait_set: _rclpy.WaitSet | None = None
        self._inputs: tuple[Input, ...] = ()

    def wait(self, inputs: tuple[Input, ...], seconds: float) -> None:
        """Wait until one of the inputs has a message, at most for ``seconds`` [s]."""
        # After a wait, a wait set keeps only the subscriptions that were ready: it can be reused if its only one was.
        wait_set = self._wait_set
        if wait_set is None or inputs != self._inputs:
            wait_set = self._wait_set = _rclpy.WaitSet(len(inputs), 0, 0, 0, 0, 0, self._context.handle)
            wait_set.clear_entities()
            for port in inputs:
                wait_set.add_subscription(port.subscription.handle)
            self._inputs = inputs
        wait_set.wait(int(seconds * 1e9))
        if len(inputs) > 1 or not wait_set.is_ready('subscription', 0):
            self._wait_set = None
