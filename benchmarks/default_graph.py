"""
The same graph as ordinary rclpy nodes, with callbacks, message objects and ``SingleThreadedExecutor``.

This is the baseline of the benchmarks. Blocks, messages and recording are the same; only the transport differs.
``python -m benchmarks.default_graph TICKS BAG [NODE ...]`` runs the named nodes, all by default, in one process.
"""

import functools
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3Stamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from benchmarks.bare_writer import BareWriter
from hdd_servo_ros.bench.ldv import Ldv, LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.messages.topics import LOOP_TOPICS, QUEUE_DEPTH
from hdd_servo_ros.signals.reference import Reference, ReferenceParameters

T = 1e-4
PATIENCE = 5.0
"""Timeout of the recorder for the next message [s]."""
TYPES = {'clock': Clock, 'estimates': Float64MultiArray}


def tick_of(stamp):
    return (stamp.sec * 1_000_000_000 + stamp.nanosec) // 100_000


class DefaultNode(Node):
    """Node that collects inputs by tick and calls ``fire`` once all inputs of a tick have arrived."""

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def __init__(self, name, last_tick):
        super().__init__(name)
        self.last_tick = last_tick
        self.waiting: dict[int, dict[str, Any]] = {}
        self.out = {t: self.create_publisher(TYPES.get(t, Vector3Stamped), t, QUEUE_DEPTH) for t in self.outputs}
        for topic in self.inputs:
            kind = TYPES.get(topic, Vector3Stamped)
            self.create_subscription(kind, topic, functools.partial(self.take, topic), QUEUE_DEPTH)

    def take(self, topic, message):
        stamp = message.clock if topic == 'clock' else message.header.stamp
        tick = tick_of(stamp)
        found = self.waiting.setdefault(tick, {})
        found[topic] = message
        if len(found) == len(self.inputs):
            del self.waiting[tick]
            self.fire(tick, stamp, found)

    def fire(self, tick, stamp, messages):
        raise NotImplementedError

    def publish(self, topic, stamp, x, y, z):
        message = Vector3Stamped()
        message.header.stamp = stamp
        message.header.frame_id = 'seagate_7200_10'
        message.vector.x, message.vector.y, message.vector.z = x, y, z
        self.out[topic].publish(message)


class DefaultTimer(DefaultNode):
    inputs = ('control',)
    outputs = ('clock',)
    done = False

    def publish_clock(self, tick):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(tick * 100_000, 1_000_000_000)
        self.out['clock'].publish(message)

    def fire(self, tick, stamp, messages):
        if tick == 0:
            self.started = time.perf_counter()
        if tick < self.last_tick:
            self.publish_clock(tick + 1)
        else:
            elapsed = time.perf_counter() - self.started
            self.done = True
            print(f'real_time_factor {self.last_tick * T / elapsed:.5g}', flush=True)


class DefaultReference(DefaultNode):
    inputs = ('clock',)
    outputs = ('reference',)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.block = Reference(ReferenceParameters(), T)

    def fire(self, tick, stamp, messages):
        self.publish('reference', stamp, *self.block.step(tick))


class DefaultPlant(DefaultNode):
    inputs = ('clock', 'control')
    outputs = ('head',)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.block = Plant(PlantParameters(), T)

    def take(self, topic, message):
        if topic == 'control':  # of the previous tick
            tick = tick_of(message.header.stamp) + 1
            if tick > self.last_tick:
                return
        else:
            tick = tick_of(message.clock)
        found = self.waiting.setdefault(tick, {})
        found[topic] = message
        if tick == 0 or len(found) == 2:
            del self.waiting[tick]
            self.fire(tick, found['clock'].clock, found)

    def fire(self, tick, stamp, messages):
        head = self.block.output() if tick == 0 else self.block.step(tick, messages['control'].vector.x, 0.0)
        self.publish('head', stamp, *head)


class DefaultSensor(DefaultNode):
    inputs = ('head',)
    outputs = ('ldv',)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.block = Ldv(LdvParameters(), T)

    def fire(self, tick, stamp, messages):
        vector = messages['head'].vector
        self.publish('ldv', stamp, *self.block.step(tick, vector.x, vector.y), 0.0)


class DefaultController(DefaultNode):
    inputs = ('reference', 'ldv')
    outputs = ('control', 'estimates')

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.block = AdaptiveNn(AdaptiveNnParameters(), T)
        sensor = LdvParameters()
        self.scales = SensorScales(sensor.displacement_scale, sensor.velocity_scale)

    def fire(self, tick, stamp, messages):
        ldv, reference = messages['ldv'].vector, messages['reference'].vector
        u = self.block.step(self.scales.inputs(tick, ldv.x, ldv.y, reference.x, reference.y, reference.z))
        self.publish('control', stamp, *u)
        names = self.block.estimate_names
        message = Float64MultiArray(data=self.block.estimates.tolist())
        message.layout.dim = [MultiArrayDimension(label=','.join(names), size=len(names), stride=len(names))]
        self.out['estimates'].publish(message)


class DefaultRecorder(Node):
    def __init__(self, name, last_tick, bag):
        super().__init__(name)
        topics = [(f'/{topic.name}', topic.type_name, QUEUE_DEPTH) for topic in LOOP_TOPICS]
        self.writer = BareWriter(bag, topics)
        self.left = (last_tick + 1) * len(topics)
        self.last_taken = None
        for index, topic in enumerate(LOOP_TOPICS):
            self.create_subscription(
                TYPES.get(topic.name, Vector3Stamped),
                topic.name,
                functools.partial(self.take, index),
                QUEUE_DEPTH,
                raw=True,
            )

    def take(self, index, message):
        self.writer.write((index,), (time.time_ns(),), (message,))
        self.left -= 1
        self.last_taken = time.monotonic()

    def is_done(self):
        """Whether every message has arrived or the timeout is over; messages that overran the queue are lost."""
        silent = self.last_taken is not None and time.monotonic() - self.last_taken > PATIENCE
        return self.left == 0 or silent


NODES = {
    'timer': DefaultTimer,
    'reference': DefaultReference,
    'plant': DefaultPlant,
    'sensor': DefaultSensor,
    'controller': DefaultController,
    'recorder': DefaultRecorder,
}


def main():
    last_tick, bag = int(sys.argv[1]), Path(sys.argv[2])
    names = sys.argv[3:] or list(NODES)
    rclpy.init(args=[])
    nodes = [NODES[name](f'stock_{name}', last_tick, *([bag] if name == 'recorder' else [])) for name in names]
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    by_name = dict(zip(names, nodes, strict=True))
    timer, recorder = by_name.get('timer'), by_name.get('recorder')
    expected = {'clock': 3, 'reference': 2, 'head': 2, 'ldv': 2, 'control': 3, 'estimates': 1}
    ready = False
    while not ready:  # until every topic has all its readers, as seen by this process
        executor.spin_once(timeout_sec=0.05)
        ready = all(
            publisher.get_subscription_count() >= expected[topic]
            for node in nodes
            for topic, publisher in getattr(node, 'out', {}).items()
        )
    if timer is not None:
        time.sleep(1.0)  # for the discovery by the other processes
        timer.publish_clock(0)
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if (recorder is None or recorder.is_done()) and (timer is None or timer.done) and (timer or recorder):
            break
        executor.spin_once(timeout_sec=0.2)
    if recorder is not None:
        recorder.writer.close()
        print(f'lost {recorder.left}', flush=True)


if __name__ == '__main__':
    main()
