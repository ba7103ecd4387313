"""Parameters of the two commands that run the whole graph."""

import dataclasses

from hdd_servo_ros.graph.catalog import CONTROLLERS, SENSORS
from hdd_servo_ros.parameters import ParameterSet, parameter


@dataclasses.dataclass(frozen=True)
class RigParameters(ParameterSet):
    """Parameters of `rig` and `simulate`."""

    controller: str = parameter(
        'adaptive_nn',
        f'controller of the loop: {", ".join(CONTROLLERS)}, the name of an entry point of the group '
        'hdd_servo_ros.controllers, or the import path module:Class of your own',
        read_only=True,
    )
    intra_process: bool = parameter(
        True,
        'whether the nodes of `rig` hand each other their messages, which are then published over DDS only while '
        'another process subscribes to them; `simulate` has no DDS',
        read_only=True,
    )
    sensor: str = parameter(
        'ldv',
        'what measures the head: ldv, the vibrometer, or servo, the servo sectors (node servo_sensor)',
        choices=tuple(SENSORS),
        read_only=True,
    )
    plot: bool = parameter(True, 'whether to draw the run into its folder when it has ended', read_only=True)
