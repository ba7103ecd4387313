"""An ordinary ROS node in the domain of a trial, in the process that checks the trial."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


class ExternalNode:
    """A node outside the run, with its executor."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node = node
        self._executor = executor

    def spin_until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until a condition is true; return whether it became true in time."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.02)
        return True


@contextlib.contextmanager
def external_node(domain: int) -> Iterator[ExternalNode]:
    """Create a node in the domain of a trial, with discovery limited to this machine."""
    before = os.environ.get(_RANGE)
    os.environ[_RANGE] = 'LOCALHOST'
    context = Context()
    try:
        rclpy.init(context=context, domain_id=domain)
        node = rclpy.create_node('external_node', context=context, enable_rosout=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        yield ExternalNode(node, executor)
        executor.shutdown()
        node.destroy_node()  # type: ignore[no-untyped-call]
    finally:
        context.try_shutdown()
        os.environ.pop(_RANGE)
        if before is not None:
            os.environ[_RANGE] = before
