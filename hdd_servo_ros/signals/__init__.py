"""Reference signals and their derivatives, without ROS and without a clock."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.signals.reference import Reference, ReferenceParameters

__all__ = [
    'Reference',
    'ReferenceParameters',
]

__getattr__ = lazily(
    __name__,
    {
        'Reference': '.reference',
        'ReferenceParameters': '.reference',
    },
)
