"""Block parameters of a node, from all its parameters in a parameter file."""

from collections.abc import Mapping
from typing import Any, TypeVar

from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters, DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.feedforward_parameters import ControllerFeedforwardParameters, FeedforwardParameters
from hdd_servo_ros.control.observer import ControllerObserverParameters, ObserverParameters
from hdd_servo_ros.control.runout_parameters import ControllerRunoutParameters, RunoutParameters
from hdd_servo_ros.control.seek_parameters import ControllerSeekParameters, SeekParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError, declarations, from_mapping

Kind = TypeVar('Kind')
_HasMethod = SeekParameters | FeedforwardParameters | RunoutParameters
"""Parameters of an optional block around the control law."""


def block_parameters(node: str, values: Mapping[str, object]) -> Any:
    """
    Return the block parameters of a node from all parameters of the node.

    Parameters of the node itself, such as timeouts and the name of the drive, are ignored.

    Raises
    ------
    ParameterError
        If a value or a name is invalid; the node precedes the name.
    """
    kinds = NODES[node].parameter_sets
    kind = kinds[-1]
    other = {declaration.name for declared in kinds[:-1] for declaration in declarations(declared)}
    return _constructed(kind, node, {name: value for name, value in values.items() if name not in other})


def dsp_parameters(node: str, values: Mapping[str, object]) -> DspParameters:
    """Return the DSP parameters of a controller, from all parameters of its node."""
    return _own(ControllerOutputParameters, node, values).dsp


def input_parameters(node: str, values: Mapping[str, object]) -> ControllerInputParameters:
    """Return the scales of the sensor outputs in a controller, from all parameters of its node."""
    return _own(ControllerInputParameters, node, values)


def observer_parameters(node: str, values: Mapping[str, object]) -> ObserverParameters:
    """Return the observer parameters of a controller, from all parameters of its node."""
    return _own(ControllerObserverParameters, node, values).observer


def feedforward_parameters(node: str, values: Mapping[str, object]) -> FeedforwardParameters:
    """
    Return the feedforward parameters of a controller, from all parameters of its node.

    Raises
    ------
    ParameterError
        If a value is invalid, or the controller does not follow the reference and so has no error to reduce.
    """
    found = _own(ControllerFeedforwardParameters, node, values).feedforward
    _reject_without_error(node, 'feedforward.method', found)
    return found


def runout_parameters(node: str, values: Mapping[str, object]) -> RunoutParameters:
    """Return the runout cancellation parameters of a controller; see :func:`feedforward_parameters`."""
    found = _own(ControllerRunoutParameters, node, values).runout
    _reject_without_error(node, 'runout.method', found)
    return found


def seek_parameters(node: str, values: Mapping[str, object]) -> SeekParameters:
    """Return the seek parameters of a controller; see :func:`feedforward_parameters`."""
    found = _own(seek_kind(node), node, values).seek
    _reject_without_error(node, 'seek.method', found)
    return found


def seek_kind(node: str) -> type[ControllerSeekParameters]:
    """Return the parameter dataclass of a controller node that contains its seek parameters."""
    return next(kind for kind in NODES[node].parameter_sets if issubclass(kind, ControllerSeekParameters))


def reject_other_units(name: str, used: _HasMethod, drive: PlantParameters) -> None:
    """Raise :class:`ParameterError` of ``name`` if parameters in um and V are used with a drive in other units."""
    units = drive.length_unit, drive.control_unit
    if used.is_used and units != ('um', 'V'):
        allowed = f'none with a drive in {units[0]} and {units[1]}, because its parameters are in um and V'
        raise ParameterError(name, used.method, allowed)


def sensor_scales(own: ControllerInputParameters, sensor: LdvParameters) -> SensorScales:
    """Return the sensor scales of a controller: its own if they are given, otherwise those of the sensor."""
    return SensorScales(
        own.displacement_scale or sensor.displacement_scale,
        own.velocity_scale or sensor.velocity_scale,
    )


def _constructed(kind: type[Any], node: str, values: Mapping[str, object]) -> Any:
    try:
        return from_mapping(kind, values)
    except ParameterError as error:
        raise error.renamed(f'{node}.{error.name}') from None


def _own(kind: type[Kind], node: str, values: Mapping[str, object]) -> Kind:
    """Return the parameters of one kind, from all parameters of a node."""
    own = {declaration.name for declaration in declarations(kind)}
    found: Kind = _constructed(kind, node, {name: value for name, value in values.items() if name in own})
    return found


def _reject_without_error(node: str, name: str, used: _HasMethod) -> None:
    if used.is_used and not NODES[node].follows_reference:
        allowed = 'none, because this controller does not follow the reference'
        raise ParameterError(f'{node}.{name}', used.method, allowed)
