"""Nodes that fill the roles of a run: the controller, and optional nodes requested by the arguments."""

from hdd_servo_ros.graph.catalog import BASE_SENSOR, CONTROLLER, DISTURBANCE_SOURCE, NODES, POSITION_SENSOR, SENSORS
from hdd_servo_ros.messages.topics import LDV
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import RosArguments

PLAYBACK, RECORDED_RUN = 'playback', 'recorded_run'
"""Node that plays back a recorded disturbance, and its parameter that names the run."""
DISTURBANCE_GENERATOR = 'disturbance_generator'
_FEEDFORWARD, _NO_FEEDFORWARD = 'feedforward.method', 'none'
"""Controller parameter that requires the acceleration of the base, and its value without this requirement."""


def roles_of_run(controller: str, arguments: RosArguments, sensor: str = 'ldv') -> dict[str, str]:
    """
    Return the name of the node that fills each role of a run.

    An optional node is included if the arguments name it: by its own section in a parameter file, or by a parameter
    for this node only. The accelerometer is also included if the controller has a feedforward.

    Parameters
    ----------
    controller
        Name of the controller node.
    arguments
        The command line.
    sensor
        Value of the parameter ``sensor`` of `rig` and `simulate`.

    Raises
    ------
    ParameterError
        If the controller needs the vibrometer and another sensor is requested, or a recorded and a generated
        disturbance are requested together.
    """
    roles = {CONTROLLER: controller}
    if sensor != 'ldv':
        if controller in NODES and NODES[controller].needs_ldv:
            raise ParameterError('sensor', sensor, f'ldv, because {controller} measures /{LDV.name}')
        roles[POSITION_SENSOR] = SENSORS[sensor]
    recorded_run = arguments.parameters_of(PLAYBACK).get(RECORDED_RUN)
    if recorded_run:
        roles[DISTURBANCE_SOURCE] = PLAYBACK
    if arguments.names(DISTURBANCE_GENERATOR):
        if recorded_run:
            allowed = f'an empty string with parameters of {DISTURBANCE_GENERATOR}: a run has one {DISTURBANCE_SOURCE}'
            raise ParameterError(f'{PLAYBACK}:{RECORDED_RUN}', recorded_run, allowed)
        roles[DISTURBANCE_SOURCE] = DISTURBANCE_GENERATOR
    has_feedforward = arguments.parameters_of(controller).get(_FEEDFORWARD, _NO_FEEDFORWARD) != _NO_FEEDFORWARD
    if has_feedforward or arguments.names(BASE_SENSOR):
        roles[BASE_SENSOR] = BASE_SENSOR
    return roles
