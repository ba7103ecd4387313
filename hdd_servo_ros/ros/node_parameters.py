"""Parameter dataclasses as ROS 2 parameters of a node: descriptors, checks of complete sets, changes during a run."""

import array
import copy
import difflib
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter

from hdd_servo_ros.graph.known_parameters import STANDARD_NAMES
from hdd_servo_ros.messages.exit_codes import one_line
from hdd_servo_ros.parameters import (
    Declaration,
    ParameterError,
    ParameterSet,
    Value,
    declarations,
    from_mapping,
    to_mapping,
)
from hdd_servo_ros.parameters.files import ArgumentError, with_node
from hdd_servo_ros.parameters.ros_yaml import LARGEST_INTEGER, read_value
from hdd_servo_ros.ros.parameter_requests import ParameterRequests

_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
}
_ARRAY_TYPES = {
    bool: Parameter.Type.BOOL_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}
_USE_SIM_TIME = 'use_sim_time'
_CLOCK_OF_NODE = (
    'use /clock as the clock of the node, as in every ROS node; a loop node always uses the time of its tick'
)


def descriptor(declaration: Declaration) -> ParameterDescriptor:
    """Return the descriptor of a declaration, as `ros2 param describe` shows it."""
    description = declaration.description_with_equation
    message = ParameterDescriptor(
        name=declaration.name,
        description=f'{description} [{declaration.unit}]' if declaration.unit else description,
        additional_constraints=declaration.allowed,
        read_only=declaration.read_only,
    )
    lower, upper = max(declaration.minimum, declaration.above), declaration.maximum
    # ROS ranges are closed and two-sided; an open or one-sided bound is checked here and described in the constraints.
    if math.isfinite(declaration.minimum) and math.isfinite(upper) and not declaration.is_sequence:
        if declaration.element_type is float:
            message.floating_point_range = [FloatingPointRange(from_value=lower, to_value=upper)]
        elif declaration.element_type is int:
            message.integer_range = [IntegerRange(from_value=int(lower), to_value=int(upper))]
    return message


def with_soft_range(message: ParameterDescriptor, declaration: Declaration, value: Any) -> ParameterDescriptor:
    """
    Return a descriptor in which every number has a range, so that rqt_reconfigure shows a slider.

    Where the declaration has no bound, the range extends to ten times the default or the value, whichever is larger.
    rclpy must not receive this range, because it rejects values outside a range.

    Parameters
    ----------
    message
        Descriptor from rclpy.
    declaration
        Declaration of the parameter.
    value
        Present value.
    """
    if declaration.is_sequence or declaration.element_type not in (int, float):
        return message
    assert isinstance(declaration.default, int | float)
    span = 10.0 * max(abs(declaration.default), abs(value)) or 1.0
    lower, upper = max(declaration.minimum, declaration.above), declaration.maximum
    if not math.isfinite(lower):
        lower = -span
    if not math.isfinite(upper):
        upper = max(span, lower + span)
    shown = copy.copy(message)
    if declaration.element_type is float:
        largest = sys.float_info.max
        shown.floating_point_range = [FloatingPointRange(from_value=max(lower, -largest), to_value=min(upper, largest))]
    else:
        bounds = (max(int(lower), -LARGEST_INTEGER), min(int(upper), LARGEST_INTEGER))
        shown.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1], step=1)]
    return shown


class ParameterNode(Node):
    """
    ROS node that rejects unknown parameters by name; the services of rclpy would return an empty list.

    Parameters
    ----------
    name
        Node name.

    Raises
    ------
    ParameterError, ArgumentError
        If rclpy rejects the node's name, namespace or one of the parameters that every node has.
    """

    def __init__(self, name: str) -> None:
        self.declared: dict[str, Declaration] = {}
        """Declaration of each parameter, by its ROS name."""
        try:
            super().__init__(name, start_parameter_services=False)
        except InvalidParameterTypeException as error:
            # The error provides name and value only in its message.
            found = re.search(r"parameter '(\w+)' to '(.*)' of type", str(error))
            given, value = found.groups() if found else ('use_sim_time', '')
            raise ParameterError(given, read_value(value), 'true or false') from None
        except Exception as error:
            raise ArgumentError(f'{name}: {one_line(error)}') from None
        self._parameter_service = ParameterRequests(self)

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Return the descriptor of a parameter as other processes receive it."""
        message = super().describe_parameter(name)
        if name not in self.declared:
            return message
        return with_soft_range(message, self.declared[name], self.get_parameter(name).value)

    def _as_declared(self, parameter: Parameter) -> Parameter:
        """Return a parameter with integers converted to doubles where doubles are declared, as on a command line."""
        declaration = self.declared.get(parameter.name)
        if declaration is None or declaration.element_type is not float:
            return parameter
        if parameter.type_ == Parameter.Type.INTEGER and not declaration.is_sequence:
            return Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))
        if parameter.type_ == Parameter.Type.INTEGER_ARRAY and declaration.is_sequence:
            return Parameter(
                parameter.name, Parameter.Type.DOUBLE_ARRAY, [float(element) for element in parameter.value]
            )
        return parameter

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Change parameters one by one; return the result of each."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Change parameters together, or none if one is rejected."""
        if not parameter_list:
            return SetParametersResult(successful=True)  # no change, hence no event
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                similar = difflib.get_close_matches(parameter.name, self._parameters, n=1)
                hint = f'; did you mean {similar[0]}?' if similar else ''
                reason = f'{self.get_fully_qualified_name()} has no parameter {parameter.name}{hint}'
                return SetParametersResult(successful=False, reason=reason)
        given = [self._as_declared(parameter) for parameter in parameter_list]
        for parameter in given:
            declaration = self.declared.get(parameter.name)
            # rclpy rejects another type too, but names neither the parameter nor the allowed values.
            if declaration is not None and parameter.type_ != _type_of(declaration):
                rejection = ParameterError(parameter.name, _as_list(parameter.value), declaration.allowed)
                return SetParametersResult(successful=False, reason=str(rejection))
        return super().set_parameters_atomically(given)


class NodeParameters:
    """
    Parameters of a node, declared from dataclasses and always checked as complete sets.

    Parameters
    ----------
    node
        Node that declares them.
    kinds
        Parameter dataclasses; their names must not overlap.

    Raises
    ------
    ParameterError
        If a given value is invalid.
    """

    def __init__(self, node: Node, kinds: Sequence[type[ParameterSet]]) -> None:
        self._node = node
        self.kinds = tuple(kinds)
        self._names = {kind: {declaration.name for declaration in declarations(kind)} for kind in self.kinds}
        self._on_change: Callable[[], None] | None = None
        self._report: Callable[[dict[str, Value]], None] | None = None
        self._further_check: Callable[[Mapping[type[ParameterSet], ParameterSet]], None] | None = None
        given: dict[str, Any] = {
            name: _plain(found.value)
            # Not automatically_declare_parameters_from_overrides: it raises for an empty list, which has no type there.
            for name, found in node._parameter_overrides.items()
            if name not in STANDARD_NAMES
        }
        known = set().union(*self._names.values())
        self.unknown = {name: value for name, value in given.items() if name not in known}
        """Given values of parameters that this node does not have; they may be intended for other nodes."""
        try:
            self._declare({name: value for name, value in given.items() if name in known})
        except ParameterError as error:
            raise with_node(error, node.get_name()) from None
        node.set_descriptor(_USE_SIM_TIME, ParameterDescriptor(type=_TYPES[bool].value, description=_CLOCK_OF_NODE))
        node.add_on_set_parameters_callback(self._check_change)
        node.add_post_set_parameters_callback(self._take_change)

    def _declare(self, given: Mapping[str, object]) -> None:
        self._sets = self._checked(given)
        values = self.as_mapping()
        for kind in self.kinds:
            for declaration in declarations(kind):
                if isinstance(self._node, ParameterNode):
                    self._node.declared[declaration.name] = declaration
                if values[declaration.name] == () and declaration.default != ():
                    raise ParameterError(declaration.name, [], f'{declaration.allowed}, not empty')
                _declare(self._node, declaration, values[declaration.name])

    def _checked(self, values: Mapping[str, object]) -> dict[type[ParameterSet], ParameterSet]:
        return {
            kind: from_mapping(kind, {name: value for name, value in values.items() if name in self._names[kind]})
            for kind in self.kinds
        }

    def __getitem__(self, kind: type[Any]) -> Any:
        """Return the present values as an instance of a parameter dataclass."""
        return self._sets[kind]

    @property
    def sets(self) -> dict[type[ParameterSet], ParameterSet]:
        """The present values: an instance of each parameter dataclass."""
        return dict(self._sets)

    def as_mapping(self) -> dict[str, Value]:
        """Return all present values by their ROS names."""
        mapping: dict[str, Value] = {}
        for values in self._sets.values():
            mapping.update(to_mapping(values))
        return mapping

    def on_change(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` after every accepted change."""
        self._on_change = callback

    def report_to(self, report: Callable[[dict[str, Value]], None]) -> None:
        """Call ``report`` with the new values of every accepted change, by name."""
        self._report = report

    def check_further(self, check: Callable[[Mapping[type[ParameterSet], ParameterSet]], None]) -> None:
        """Reject changes for which ``check`` raises ParameterError; it receives all parameter sets after the change."""
        self._further_check = check

    def set(self, values: Mapping[str, Value]) -> str:
        """Change parameters together, as `ros2 param set` does; return why they are rejected, or an empty string."""
        declared = {declaration.name: declaration for kind in self.kinds for declaration in declarations(kind)}
        changes = []
        for name, value in values.items():
            plain = list(value) if isinstance(value, tuple) else value
            changes.append(Parameter(name, _type_of(declared[name]), plain))
        result = self._node.set_parameters_atomically(changes)
        return '' if result.successful else result.reason

    def _changed(self, changes: Sequence[Parameter]) -> dict[type[ParameterSet], ParameterSet]:
        values: dict[str, object] = dict(self.as_mapping())
        for change in changes:
            if any(change.name in names for names in self._names.values()):
                values[change.name] = _plain(change.value)
        return self._checked(values)

    def _check_change(self, changes: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed = self._changed(changes)
            if self._further_check is not None:
                self._further_check(changed)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_change(self, changes: Sequence[Parameter]) -> None:
        self._sets = self._changed(changes)
        if self._on_change is not None:
            self._on_change()
        if self._report is not None:
            self._report({change.name: _plain(change.value) for change in changes})


def _as_list(value: Any) -> Any:
    """Return an array as a list, as users write it, and any other value unchanged."""
    return list(value) if isinstance(value, array.array) else value


def _type_of(declaration: Declaration) -> Parameter.Type:
    return (_ARRAY_TYPES if declaration.is_sequence else _TYPES)[declaration.element_type]


def _plain(value: Any) -> Any:
    """Return a ROS value as this package represents it: a list, array or unset list becomes a tuple."""
    if value is None:
        return ()
    return tuple(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def _declare(node: Node, declaration: Declaration, value: Value) -> None:
    name, message = declaration.name, descriptor(declaration)
    if value == ():
        # rclpy interprets an empty list as bytes, so the type is declared first. If one such parameter stayed unset,
        # the node would respond to a request for all parameters (`ros2 param dump`) with an empty list.
        element_type = _ARRAY_TYPES[declaration.element_type]
        node.declare_parameter(name, element_type, ignore_override=True)
        node.set_parameters([Parameter(name, element_type, [])])
        message.type = element_type.value
        node.set_descriptor(name, message)
    else:
        given = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(name, given, message, ignore_override=True)
