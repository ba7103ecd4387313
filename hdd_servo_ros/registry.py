"""Which parameters each node has: the one list for nodes, `simulate`, help texts and documents; no ROS import."""

from collections.abc import Iterator
from typing import Any

from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.open_loop import OpenLoopParameters
from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.loop_parameters import (
    DriveNameParameters,
    PeerParameters,
    RecorderParameters,
    RigParameters,
    SampleTimeParameters,
    TimerParameters,
)
from hdd_servo_ros.parameters import Declaration, declarations
from hdd_servo_ros.signals.reference import ReferenceParameters

CONTROLLERS = {
    'adaptive_nn': 'adaptive_nn_controller',
    'pid': 'pid_controller',
    'open_loop': 'open_loop_controller',
}
"""Values of the parameter ``controller`` of `rig` and `simulate`, and the node each stands for."""

_EVERY_NODE = (PeerParameters, SampleTimeParameters)

NODE_PARAMETERS: dict[str, tuple[type[Any], ...]] = {
    'deterministic_timer': (PeerParameters, TimerParameters),
    'reference_generator': (*_EVERY_NODE, ReferenceParameters),
    'vcm_plant': (*_EVERY_NODE, DriveNameParameters, PlantParameters),
    'ldv_sensor': (*_EVERY_NODE, LdvParameters),
    'adaptive_nn_controller': (*_EVERY_NODE, AdaptiveNnParameters),
    'pid_controller': (*_EVERY_NODE, PidParameters),
    'open_loop_controller': (*_EVERY_NODE, OpenLoopParameters),
    'bag_recorder': (*_EVERY_NODE, RecorderParameters),
    'rig': (RigParameters,),
    'simulate': (RigParameters,),
}


def node_declarations(node: str) -> Iterator[Declaration]:
    """Iterate over the declarations of a node's parameters."""
    for kind in NODE_PARAMETERS[node]:
        yield from declarations(kind)
