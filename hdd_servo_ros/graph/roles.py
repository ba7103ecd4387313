"""Which nodes fill the roles of a run: its controller, and `playback` where a recorded run is to be played back."""

from hdd_servo_ros.graph.catalogue import CONTROLLER, DISTURBANCE_SOURCE
from hdd_servo_ros.parameters.files import RosArguments

PLAYBACK, RECORDED_RUN = 'playback', 'recorded_run'
"""The node that plays back, and the parameter that gives it something to play."""


def roles_of_run(controller: str, arguments: RosArguments) -> dict[str, str]:
    """Return the name of the node that fills each role: that of the controller, and what the arguments ask for."""
    roles = {CONTROLLER: controller}
    if arguments.parameters_of(PLAYBACK).get(RECORDED_RUN):
        roles[DISTURBANCE_SOURCE] = PLAYBACK
    return roles
