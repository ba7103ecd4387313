"""Which nodes fill the roles of a run: its controller, and the nodes that its arguments ask for."""

from hdd_servo_ros.graph.catalog import BASE_SENSOR, CONTROLLER, DISTURBANCE_SOURCE, NODES, POSITION_SENSOR, SENSORS
from hdd_servo_ros.messages.topics import LDV
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import RosArguments

PLAYBACK, RECORDED_RUN = 'playback', 'recorded_run'
"""The node that plays back, and the parameter that gives it something to play."""
DISTURBANCE_GENERATOR = 'disturbance_generator'
_FEEDFORWARD, _NO_FEEDFORWARD = 'feedforward.method', 'none'
"""The parameter of a controller that may need the acceleration of the base, and its value for one that does not."""


def roles_of_run(controller: str, arguments: RosArguments, sensor: str = 'ldv') -> dict[str, str]:
    """
    Return the name of the node that fills each role of a run.

    An optional node is included if the arguments name it: by a section of its own in a parameter file, or by a
    parameter that is given for it alone. The accelerometer is also included if the controller has a feedforward.

    Parameters
    ----------
    controller
        Name of the controller's node.
    arguments
        The command line.
    sensor
        Value of the parameter ``sensor`` of `rig` and `simulate`.

    Raises
    ------
    ParameterError
        If a controller needs the vibrometer and another sensor is asked for, or a recorded disturbance and generated
        ones are asked for at once.
    """
    roles = {CONTROLLER: controller}
    if sensor != 'ldv':
        if controller in NODES and NODES[controller].needs_ldv:
            raise ParameterError('sensor', sensor, f'ldv, since {controller} measures /{LDV.name}')
        roles[POSITION_SENSOR] = SENSORS[sensor]
    recorded_run = arguments.parameters_of(PLAYBACK).get(RECORDED_RUN)
    if recorded_run:
        roles[DISTURBANCE_SOURCE] = PLAYBACK
    if arguments.names(DISTURBANCE_GENERATOR):
        if recorded_run:
            allowed = f'empty with parameters of {DISTURBANCE_GENERATOR}: a run has one {DISTURBANCE_SOURCE}'
            raise ParameterError(f'{PLAYBACK}:{RECORDED_RUN}', recorded_run, allowed)
        roles[DISTURBANCE_SOURCE] = DISTURBANCE_GENERATOR
    has_feedforward = arguments.parameters_of(controller).get(_FEEDFORWARD, _NO_FEEDFORWARD) != _NO_FEEDFORWARD
    if has_feedforward or arguments.names(BASE_SENSOR):
        roles[BASE_SENSOR] = BASE_SENSOR
    return roles
