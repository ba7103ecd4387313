"""Digest of all signals of a run, identical for a run in memory and its recording."""

import hashlib

import numpy as np

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS


def signals_digest(signals: Signals) -> str:
    """
    Return the BLAKE2b digest of a run's signals, 32 hexadecimal digits.

    The digest covers name, shape and every bit of each signal topic of the run, including the ground truth and the
    estimates, in the order of :data:`~hdd_servo_ros.messages.topics.SIGNAL_TOPICS`.
    """
    digest = hashlib.blake2b(digest_size=16)
    for topic in SIGNAL_TOPICS:
        if topic.name in signals:
            rows = np.ascontiguousarray(signals[topic.name], dtype='<f8')
            digest.update(f'{topic.name} {rows.shape}'.encode())
            digest.update(rows.data)
    return digest.hexdigest()
