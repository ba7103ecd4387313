"""
Lower bound of the time per tick: serialized publish and take of the loop messages in one process, and nothing else.

Each topic has as many readers as in the rig. Prints the real-time factor of this alone.
"""

import sys
import time

import rclpy
from rclpy.node import Node

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.ros.loop_topics import LOOP_QOS, message_class

READERS = {'clock': 3, 'reference': 2, 'head': 2, 'ldv': 2, 'control': 3, 'estimates': 1}


def main():
    ticks = int(sys.argv[1])
    rclpy.init(args=[])
    writer, reader = Node('writer'), Node('reader')
    names = AdaptiveNn(AdaptiveNnParameters(), 1e-4).estimate_names
    vector = VectorCodec('seagate_7200_10').pack(bytes(8), 1.0, 2.0, 3.0)
    payloads = {'clock': ClockCodec.pack(bytes(8)), 'estimates': ArrayCodec(names).pack([0.0] * len(names))}
    steps = []
    for topic in LOOP_TOPICS:
        kind = message_class(topic.type_name)
        publish = writer.create_publisher(kind, topic.name, LOOP_QOS).handle.publish_raw
        subscriptions = [
            reader.create_subscription(kind, topic.name, lambda _: None, LOOP_QOS) for _ in range(READERS[topic.name])
        ]
        steps.append((publish, payloads.get(topic.name, vector), [s.handle.take_message for s in subscriptions], kind))
    time.sleep(1.0)
    started = time.perf_counter()
    for _ in range(ticks):
        for publish, payload, takes, kind in steps:
            publish(payload)
            for take in takes:
                assert take(kind, True) is not None
    elapsed = time.perf_counter() - started
    print(f'real_time_factor {ticks * 1e-4 / elapsed:.5g}')


if __name__ == '__main__':
    main()
