"""Sources of the position error of a run, and the parameter that switches each source off."""

from collections.abc import Iterable, Mapping
from typing import Any

from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.graph.catalog import BASE_SENSOR, SENSORS
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR

Switch = tuple[str, str, Any]
"""Node, parameter, and the value that switches the source off."""

SENSOR_NOISE = 'sensor noise'
ACCELEROMETER_NOISE = 'accelerometer noise'
_METHOD = 'feedforward.method'


def error_sources(
    nodes: Mapping[str, Mapping[str, Any]], changes: Iterable[tuple[str, str, Any]] = ()
) -> dict[str, Switch]:
    """
    Return the error sources that are enabled in a run, at its start or after a change.

    Parameters
    ----------
    nodes
        Parameters of the nodes at the start of the run, by node name without namespace.
    changes
        Node, parameter and new value of each change during the run.

    Returns
    -------
    dict
        Parameter that switches each source off, by name of the source: the sources of ``disturbance_generator``, the
        noise of the position sensor, and that of the accelerometers if a controller uses them.
    """
    later = list(changes)
    switches: dict[str, Switch] = {
        name: (DISTURBANCE_GENERATOR, f'{name}.enabled', False) for name in DisturbanceParameters().sources
    }
    sensor = next((node for node in SENSORS.values() if node in nodes), '')
    switches[SENSOR_NOISE] = (sensor, 'noise', False if sensor == SENSORS['ldv'] else 0.0)
    if any(parameters.get(_METHOD, 'none') != 'none' for parameters in nodes.values()):
        switches[ACCELEROMETER_NOISE] = (BASE_SENSOR, 'noise', 0.0)

    def is_on(node: str, name: str, off: Any) -> bool:
        values = [nodes.get(node, {}).get(name, off), *(value for n, p, value in later if (n, p) == (node, name))]
        return any(value != off for value in values)

    return {source: switch for source, switch in switches.items() if is_on(*switch)}
