"""Which parameters each node has: the one list for nodes, `simulate`, help texts and documents; no ROS import."""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzerParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.open_loop import OpenLoopParameters
from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import Declaration, ParameterError, declarations
from hdd_servo_ros.parameters.run_parameters import (
    DriveNameParameters,
    PeerParameters,
    PlaybackParameters,
    RecorderParameters,
    RigParameters,
    SampleTimeParameters,
    TimerParameters,
)
from hdd_servo_ros.signals.reference import ReferenceParameters

CONTROLLERS = {
    'adaptive_nn': 'adaptive_nn_controller',
    'pid': 'pid_controller',
    'open_loop': 'open_loop_controller',
    'signal_analyzer': 'signal_analyzer',
}
"""Values of the parameter ``controller`` of `rig` and `simulate`, and the node each stands for."""

_EVERY_NODE = (PeerParameters, SampleTimeParameters)
_EVERY_CONTROLLER = (*_EVERY_NODE, ControllerInputParameters, ControllerOutputParameters)

NODE_PARAMETERS: dict[str, tuple[type[Any], ...]] = {
    'deterministic_timer': (PeerParameters, TimerParameters),
    'reference_generator': (*_EVERY_NODE, ReferenceParameters),
    'vcm_plant': (*_EVERY_NODE, DriveNameParameters, PlantParameters),
    'ldv_sensor': (*_EVERY_NODE, LdvParameters),
    'adaptive_nn_controller': (*_EVERY_CONTROLLER, AdaptiveNnParameters),
    'pid_controller': (*_EVERY_CONTROLLER, PidParameters),
    'open_loop_controller': (*_EVERY_CONTROLLER, OpenLoopParameters),
    'signal_analyzer': (*_EVERY_CONTROLLER, SignalAnalyzerParameters),
    'playback': (*_EVERY_NODE, PlaybackParameters),
    'bag_recorder': (*_EVERY_NODE, RecorderParameters),
    'rig': (RigParameters,),
    'simulate': (RigParameters,),
}


def register_controller(node: str, kind: type[Any]) -> None:
    """
    Add the node of a controller from outside: with the parameters that every controller's node has, and its own.

    Parameters
    ----------
    node
        Its name.
    kind
        Its own parameters.

    Raises
    ------
    ValueError
        If another node has its name.
    """
    if node in NODE_PARAMETERS and NODE_PARAMETERS[node][-1] is not kind:
        raise ValueError(f'there is another node {node}')
    NODE_PARAMETERS[node] = (*NODE_PARAMETERS['pid_controller'][:-1], kind)


def refuse_unknown(given: Mapping[str, object], own: Iterable[str] = ()) -> None:
    """
    Refuse parameters that no node has: ``-p x:=1`` is for all nodes, so that a node must pass over what others have.

    Parameters
    ----------
    given
        Names and values.
    own
        Names that are known beside those of this package's nodes.

    Raises
    ------
    ParameterError
        If a name is known nowhere.
    """
    known = {declaration.name for node in NODE_PARAMETERS for declaration in node_declarations(node)}.union(own)
    for name, value in given.items():
        if name not in known:
            similar = difflib.get_close_matches(name, known, n=1)
            hint = f'; did you mean {similar[0]}?' if similar else ''
            raise ParameterError(name, value, f'no such parameter{hint}')


def node_declarations(node: str) -> Iterator[Declaration]:
    """Iterate over the declarations of a node's parameters."""
    for kind in NODE_PARAMETERS[node]:
        yield from declarations(kind)
