"""Disturbances of a drive in use, without ROS and without a clock: runout, flutter, windage, vibration and shock."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
    from hdd_servo_ros.disturbance.parameters import DisturbanceParameters

__all__ = [
    'DisturbanceGenerator',
    'DisturbanceParameters',
]

__getattr__ = lazily(
    __name__,
    {
        'DisturbanceGenerator': '.generator',
        'DisturbanceParameters': '.parameters',
    },
)
