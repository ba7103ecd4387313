"""Parameters of the two commands that run the complete graph."""

import dataclasses

from hdd_servo_ros.graph.catalog import CONTROLLERS, SENSORS
from hdd_servo_ros.parameters import ParameterSet, parameter


@dataclasses.dataclass(frozen=True)
class RigParameters(ParameterSet):
    """Parameters of `rig` and `simulate`."""

    controller: str = parameter(
        'adaptive_nn',
        f'controller of the loop: {", ".join(CONTROLLERS)}, the name of an entry point of the group '
        'hdd_servo_ros.controllers, or the import path module:Class of a custom controller',
        read_only=True,
    )
    intra_process: bool = parameter(
        True,
        'pass messages between the nodes of `rig` directly, and publish them over DDS only while another process '
        'subscribes; no effect in `simulate`, which has no DDS',
        read_only=True,
    )
    sensor: str = parameter(
        'ldv',
        'position sensor: ldv for the vibrometer, servo for the servo sectors (node servo_sensor)',
        choices=tuple(SENSORS),
        read_only=True,
    )
    plot: bool = parameter(True, 'plot the run into its directory after it has ended', read_only=True)
