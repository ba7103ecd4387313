"""Closed-loop simulation without middleware: compiled kernel, experiment, and the command ``simulate``."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.simulation.experiment import Experiment

__all__ = [
    'Experiment',
]

__getattr__ = lazily(
    __name__,
    {
        'Experiment': '.experiment',
    },
)
