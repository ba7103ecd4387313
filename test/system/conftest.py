"""An ordinary ROS node beside the bench's processes."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor


@pytest.fixture
def outside(bench, monkeypatch):
    """An ordinary node of another process: this one."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=bench.domain)
    node = rclpy.create_node('outside', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.spin_for = lambda seconds: _spin_for(executor, seconds)
    node.spin_until = lambda condition: _spin_until(executor, condition)
    node.call = lambda *arguments: _call(node, *arguments)
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def _spin_for(executor, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)


def _spin_until(executor, condition, timeout=40.0):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, 'nothing came'
        executor.spin_once(timeout_sec=0.05)


def _call(node, service_type, name, request):
    """Call a service, and return its answer and how long it took [s]."""
    client = node.create_client(service_type, name)
    assert client.wait_for_service(timeout_sec=20.0)
    started = time.monotonic()
    future = client.call_async(request)
    node.spin_until(future.done)
    seconds = time.monotonic() - started
    node.destroy_client(client)
    return future.result(), seconds
