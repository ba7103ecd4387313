"""Drive model without ROS: actuator, pivot friction, head resonances, and the step function that combines them."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.drive.actuator import ActuatorParameters
    from hdd_servo_ros.drive.friction.curves import friction_along, friction_curve
    from hdd_servo_ros.drive.friction.parameters import FrictionParameters
    from hdd_servo_ros.drive.plant import Plant, PlantParameters
    from hdd_servo_ros.drive.resonance import ResonanceParameters
    from hdd_servo_ros.drive.temperature import TemperatureParameters
    from hdd_servo_ros.drive.transfer import (
        frequency_response,
        head_state_space,
        sampled_frequency_response,
    )

__all__ = [
    'ActuatorParameters',
    'FrictionParameters',
    'Plant',
    'PlantParameters',
    'ResonanceParameters',
    'TemperatureParameters',
    'frequency_response',
    'friction_along',
    'friction_curve',
    'head_state_space',
    'sampled_frequency_response',
]

__getattr__ = lazily(
    __name__,
    {
        'ActuatorParameters': '.actuator',
        'FrictionParameters': '.friction.parameters',
        'Plant': '.plant',
        'PlantParameters': '.plant',
        'ResonanceParameters': '.resonance',
        'TemperatureParameters': '.temperature',
        'frequency_response': '.transfer',
        'friction_along': '.friction.curves',
        'friction_curve': '.friction.curves',
        'head_state_space': '.transfer',
        'sampled_frequency_response': '.transfer',
    },
)
