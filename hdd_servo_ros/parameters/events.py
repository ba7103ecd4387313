"""``rcl_interfaces/ParameterEvent`` as bytes, without ROS: the changes of a node, and their tick."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.messages.topics import PARAMETER_EVENT_TYPE, PARAMETER_VALUE_FIELDS
from hdd_servo_ros.parameters import Value

_UNSET: dict[str, Any] = {
    'bool_value': False,
    'integer_value': 0,
    'double_value': 0.0,
    'string_value': '',
    'byte_array_value': np.array([], dtype=np.uint8),
    'bool_array_value': np.array([], dtype=np.bool_),
    'integer_array_value': np.array([], dtype=np.int64),
    'double_array_value': np.array([], dtype=np.float64),
    'string_array_value': [],
}
_SCALARS = {bool: 1, int: 2, float: 3, str: 4}
_ARRAY = 5
_DTYPES: dict[type, Any] = {bool: np.bool_, int: np.int64, float: np.float64}


@functools.cache
def _typestore() -> Any:
    # Imported late: it takes longer to load than most bags take to read.
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@dataclasses.dataclass(frozen=True)
class NodeChange:
    """Simultaneous changes of a node: full name, time of the first tick with the new values [ns], values by name."""

    node: str
    time_ns: int
    values: dict[str, Value]


def pack_parameter_event(change: NodeChange) -> bytes:
    """Return the message that a node publishes after a change of its parameters."""
    types = _typestore().types
    stamp = types['builtin_interfaces/msg/Time'](*divmod(change.time_ns, NANOSECONDS))
    parameter, parameter_value = (types[f'rcl_interfaces/msg/{name}'] for name in ('Parameter', 'ParameterValue'))
    changed = [parameter(name, parameter_value(**_fields(value))) for name, value in change.values.items()]
    event = types[PARAMETER_EVENT_TYPE](stamp, change.node, [], changed, [])
    return bytes(_typestore().serialize_cdr(event, PARAMETER_EVENT_TYPE))


def _fields(value: Value) -> dict[str, Any]:
    fields = dict(_UNSET)
    if isinstance(value, tuple):
        kind = type(value[0]) if value else float
        number = _SCALARS[kind] + _ARRAY
        fields[PARAMETER_VALUE_FIELDS[number]] = list(value) if kind is str else np.array(value, dtype=_DTYPES[kind])
    else:
        number = _SCALARS[type(value)]
        fields[PARAMETER_VALUE_FIELDS[number]] = value
    return {'type': number, **fields}


def deserialized_event(message: bytes) -> Any:
    """Return a serialized ``ParameterEvent`` as an object with the message's fields."""
    return _typestore().deserialize_cdr(message, PARAMETER_EVENT_TYPE)


def unpack_parameter_event(message: bytes) -> NodeChange:
    """Return the changes in a serialized ``ParameterEvent``."""
    return change_of_event(deserialized_event(message))


def change_of_event(event: Any) -> NodeChange:
    """
    Return the changes in a ``ParameterEvent`` of rclpy or rosbags.

    Lists that were empty before count as changed, although ROS reports them as new.
    """
    time = event.stamp.sec * NANOSECONDS + event.stamp.nanosec
    changed = (*event.new_parameters, *event.changed_parameters)
    return NodeChange(event.node, time, {each.name: unpack_value(each.value) for each in changed})


def invalid_event_reason(change: NodeChange, event: Any, parameters: Mapping[str, Any]) -> str:
    """
    Return why an event cannot come from the named node of the run; an empty string if it can.

    Parameters
    ----------
    change
            The changes in the event.
    event
        The event itself, see :func:`change_of_event`.
    parameters
        Parameters of the node at tick 0, by name.
    """
    if change.time_ns < 0 or event.stamp.nanosec >= NANOSECONDS:
        return f'stamp {event.stamp.sec} s {event.stamp.nanosec} ns'
    for parameter in (*event.new_parameters, *event.changed_parameters):
        kind = parameter.value.type
        if kind not in PARAMETER_VALUE_FIELDS or kind == _ARRAY:
            return f'a parameter of type {kind}'
        known = parameters.get(parameter.name)
        if known is not None and kind not in _types_of(known):
            return f'parameter {parameter.name[:60]!r} of type {kind}'
    return ''


def _types_of(value: Any) -> tuple[int, ...]:
    """Return the message types with which an event may give a new value of the same parameter."""
    if not isinstance(value, tuple | list):
        return (_SCALARS[type(value)],)
    kinds = (type(value[0]),) if value else tuple(_SCALARS)
    return tuple(_SCALARS[kind] + _ARRAY for kind in kinds)


def unpack_value(value: Any) -> Value:
    """Return the value of a ``ParameterValue``; an empty tuple if it is not set."""
    field = PARAMETER_VALUE_FIELDS.get(value.type)
    if field is None:
        return ()
    found = getattr(value, field)
    if value.type > _ARRAY:
        return tuple(found.tolist() if hasattr(found, 'tolist') else found)
    return found  # type: ignore[no-any-return]
