"""
Custom controllers: found by entry point or import path, checked, and registered like the built-in ones.

This module does not import ROS, because `simulate` runs custom controllers too.
"""

import dataclasses
import hashlib
import importlib
import importlib.metadata
import inspect
import re
import sys
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.control.outside import ControllerError, OutsideController, described
from hdd_servo_ros.graph.catalog import CONTROLLERS, common_controller_parameters, register_controller
from hdd_servo_ros.messages.controller_inputs import NO_INPUTS
from hdd_servo_ros.parameters import InvalidParameterError, ParameterError, ParameterSet, declarations

ENTRY_POINTS = 'hdd_servo_ros.controllers'
"""Group of the entry points with which an installed package provides controllers."""

_STEP_ARGUMENTS = ('inputs',)
_FORMER_STEP_ARGUMENTS = ('tick', 'displacement_volts', 'velocity_volts', 'x_d', 'dx_d', 'ddx_d')
_CHANGED_STEP = (
    'step now takes one argument: inputs, with inputs.tick, inputs.position [um] and '
    'inputs.velocity [um/s] (or inputs.displacement_volts and inputs.velocity_volts [V]), '
    'inputs.desired_position [um], inputs.desired_velocity [um/s] and inputs.desired_acceleration [um/s^2]; '
    'see docs/tutorial-own-controller.md'
)


@dataclasses.dataclass(frozen=True)
class ControllerKind:
    """
    Custom controller class that has been checked.

    Attributes
    ----------
    name
        Name given by the user: that of an entry point, or an import path.
    node
        Name of its node: the class attribute ``node_name``, or the class name in snake_case.
    kind
        The class.
    parameters
        Its parameter dataclass.
    """

    name: str
    node: str
    kind: type[Any]
    parameters: type[ParameterSet]

    def make(self, parameters: Any, sample_time: float) -> OutsideController:
        """Construct a controller for T [s]; raises :class:`ParameterError` if that fails."""
        return OutsideController(self.node, self.kind, parameters, sample_time)

    def trial(self, parameters: Any, sample_time: float) -> OutsideController:
        """Construct a controller and try one step with zeros, to reject a broken controller before a run."""
        made = self.make(parameters, sample_time)
        try:
            made.step(NO_INPUTS)
        except ControllerError as error:
            raise self.rejected_trial(error) from error
        return made

    def rejected_trial(self, error: ControllerError) -> ParameterError:
        """Return the error of a failed step with zeros, with advice if ``step`` accepts six arguments."""
        signature = _signature_of(self.kind.step)
        # The former arguments may be hidden in *args or defaults, where only the trial detects them.
        former = signature is not None and _takes(signature, ('self', *_FORMER_STEP_ARGUMENTS))
        hint = f'; {self.kind.__name__}.{_CHANGED_STEP}' if former else ''
        return _rejected(self.name, f'the trial step with zeros failed: {error}{hint}')

    def offers(self) -> dict[str, str]:
        """Return the entries of ``run.yaml``: location of the class, and digest of its file."""
        path = Path(inspect.getfile(self.kind))
        module = path.stem if self.kind.__module__ == '__main__' else self.kind.__module__
        return {
            'controller_class': f'{module}:{self.kind.__qualname__}',
            'controller_sha256': hashlib.sha256(path.read_bytes()).hexdigest(),
        }


def load_controller(name: str) -> ControllerKind:
    """
    Find a custom controller, check it, and register its node and parameters in the catalog.

    Parameters
    ----------
    name
        Name of an entry point of the group ``hdd_servo_ros.controllers``, or an import path ``module:Class``. Modules
        are searched on ``sys.path`` and then in the working directory.

    Raises
    ------
    ParameterError
        If the controller does not exist, its module cannot be imported, or the class is not valid.
    """
    path = name if ':' in name else _entry_point(name)
    module_name, _, attribute = path.partition(':')
    if not re.fullmatch(r'\w+(\.\w+)*:\w+(\.\w+)*', path):
        raise _rejected(name, f'{path!r} is not an import path module:Class')
    found: Any = _import(name, module_name)
    for part in attribute.split('.'):
        if not hasattr(found, part):
            file = getattr(sys.modules[module_name], '__file__', None)
            raise _rejected(name, f'{module_name} ({file}) has no {attribute}')
        found = getattr(found, part)
    return checked_controller(found, name)


def checked_controller(kind: Any, name: str) -> ControllerKind:
    """
    Check a class and register its node and parameters in the catalog.

    Raises
    ------
    ParameterError
        If it is not a class, lacks ``update`` or ``step``, does not annotate its parameters, if these are not declared
        properly, or if a name already exists.
    """
    if not isinstance(kind, type):
        raise _rejected(name, f'{kind!r} is not a class')
    for method, arguments in (('step', _STEP_ARGUMENTS), ('update', ('parameters',))):
        if not callable(getattr(kind, method, None)):
            raise _rejected(name, f'class {kind.__name__} lacks {method}({", ".join(arguments)})')
        if method == 'step':
            _reject_former_step(name, kind.__name__, _signature_of(getattr(kind, method)), ('self',))
        _check_call(name, getattr(kind, method), f'{kind.__name__}.{method}', ('self', *arguments))
    _check_call(name, kind, kind.__name__, ('parameters', 'sample_time'))
    parameters = _parameters_of(kind, name)
    _check_parameters(parameters, name)
    node = getattr(kind, 'node_name', None) or snake_case(kind.__name__)
    if not isinstance(node, str) or not re.fullmatch(r'[A-Za-z_][A-Za-z0-9_]*', node):
        raise _rejected(name, f'node name {node!r} does not consist of letters, digits and underscores')
    purpose = (inspect.getdoc(kind) or f'The controller {kind.__name__}.').partition('\n')[0]
    try:
        register_controller(node, parameters, purpose)
    except ValueError as error:
        raise _rejected(name, f'{error}; give class {kind.__name__} an attribute node_name') from None
    return ControllerKind(name, node, kind, parameters)


def reject_former_object(controller: object) -> None:
    """Raise :class:`ParameterError` for an object whose ``step`` takes the six arguments of former versions."""
    name = type(controller).__name__
    _reject_former_step(name, name, _signature_of(getattr(controller, 'step', None)), ())


def snake_case(name: str) -> str:
    """Return a class name in snake_case: MyController becomes my_controller, and PIController pi_controller."""
    return re.sub(r'(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])', '_', name).lower()


def _rejected(name: str, reason: str) -> ParameterError:
    return InvalidParameterError('controller', name, reason)


def _entry_point(name: str) -> str:
    """Return the import path of an entry point."""
    offered = importlib.metadata.entry_points(group=ENTRY_POINTS)
    paths = sorted({point.value.replace(' ', '') for point in offered if point.name == name})
    if len(paths) > 1:
        raise _rejected(name, f'several installed packages offer it: {", ".join(paths)}')
    if not paths:
        names = ', '.join([*CONTROLLERS, *sorted(point.name for point in offered)])
        raise ParameterError(
            'controller', name, f'one of {names}, or the import path module:Class of a custom controller'
        )
    return paths[0]


def _import(name: str, module: str) -> Any:
    here = str(Path.cwd())
    # The path contains the directory of the executable, but not the working directory; at the end it shadows nothing.
    if here not in sys.path and '' not in sys.path:
        sys.path.append(here)
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f'{error.name}.')):
            reason = f'module {error.name} is neither on sys.path nor in {here}'
            if module.endswith('.py'):
                reason += '; give the module without .py'
        else:
            reason = f'importing {module} raised {described(error)}'
        raise _rejected(name, reason) from None
    except (Exception, SystemExit) as error:
        reason = f'importing {module} raised {described(error)}'
        raise _rejected(name, reason) from error


def _signature_of(function: Any) -> inspect.Signature | None:
    """Return the signature of a function; None if it is unknown, as for some compiled functions."""
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):
        return None


def _reject_former_step(name: str, kind: str, step: inspect.Signature | None, before: tuple[str, ...]) -> None:
    """Reject a ``step`` that takes the six arguments of former versions after those ``before``, with advice."""
    if step is None:
        return
    if list(step.parameters)[len(before) : len(before) + 1] == ['tick'] or (
        _takes(step, (*before, *_FORMER_STEP_ARGUMENTS)) and not _takes(step, (*before, *_STEP_ARGUMENTS))
    ):
        raise _rejected(name, f'{kind}.{_CHANGED_STEP}')


def _takes(signature: inspect.Signature, arguments: Sequence[str]) -> bool:
    try:
        signature.bind(*arguments)
    except TypeError:
        return False
    return True


def _check_call(name: str, function: Any, shown: str, arguments: Sequence[str]) -> None:
    """Reject a function that cannot be called with the given arguments."""
    signature = _signature_of(function)
    if signature is not None and not _takes(signature, arguments):
        raise _rejected(name, f'{shown}{signature} cannot be called with ({", ".join(arguments)})')


def _parameters_of(kind: type[Any], name: str) -> Any:
    """Return the annotated type of the first constructor argument of a class."""
    first = next(iter(inspect.signature(kind).parameters))
    try:
        found = typing.get_type_hints(kind.__init__).get(first)
    except Exception as error:
        raise _rejected(name, f'the annotations of {kind.__name__}.__init__ raised {described(error)}') from error
    if found is None:
        reason = f'{kind.__name__}.__init__ does not annotate {first} with its parameter dataclass'
        raise _rejected(name, reason)
    return found


def _is_parameter_dataclass(kind: Any) -> bool:
    if not isinstance(kind, type) or not issubclass(kind, ParameterSet):
        return False
    return bool(getattr(getattr(kind, '__dataclass_params__', None), 'frozen', False))


def _check_parameters(parameters: Any, name: str) -> None:
    """Reject an invalid parameter dataclass: undeclared fields, bad defaults, or parameters that every node has."""
    if not _is_parameter_dataclass(parameters):
        shown = getattr(parameters, '__name__', repr(parameters))
        raise _rejected(name, f'{shown} is not a frozen dataclass derived from hdd_servo_ros.parameters.ParameterSet')
    for field in dataclasses.fields(parameters):
        if 'declaration' not in field.metadata and not dataclasses.is_dataclass(field.default_factory):
            raise _rejected(name, f'{parameters.__name__}.{field.name} is not declared by parameter() or group()')
    try:
        parameters()
    except ParameterError as error:
        raise _rejected(name, f'the defaults of {parameters.__name__}: {error}') from None
    taken = {declaration.name for common in common_controller_parameters() for declaration in declarations(common)}
    for declaration in declarations(parameters):
        if declaration.name in taken:
            raise _rejected(name, f'{parameters.__name__}.{declaration.name}: every node has a parameter of that name')
