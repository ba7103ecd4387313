"""An ordinary ROS node beside the bench's processes."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node


class Outside(Node):
    """An ordinary node of another process: this one."""

    def __init__(self, context: Context) -> None:
        super().__init__('outside', context=context)
        self.spinning = SingleThreadedExecutor(context=context)
        self.spinning.add_node(self)

    def spin_for(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.spinning.spin_once(timeout_sec=0.05)

    def spin_until(self, condition: Callable[[], object], timeout: float = 200.0) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, 'nothing came'
            self.spinning.spin_once(timeout_sec=0.05)

    def call(self, service_type: Any, name: str, request: Any) -> tuple[Any, float]:
        """Call a service, and return its answer and how long it took [s]."""
        client = self.create_client(service_type, name)
        assert client.wait_for_service(timeout_sec=200.0)
        started = time.monotonic()
        future = client.call_async(request)
        self.spin_until(future.done)
        seconds = time.monotonic() - started
        self.destroy_client(client)
        return future.result(), seconds


@pytest.fixture
def outside(bench, monkeypatch) -> Iterator[Outside]:
    """Give a test an ordinary node in the bench's domain."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = Context()
    rclpy.init(context=context, domain_id=bench.domain)
    node = Outside(context)
    yield node
    node.spinning.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
