"""
Parameters of a block: one declaration for the block, its node and the documentation.

The parameters of a block are a frozen dataclass with fields made by :func:`parameter`. Each declaration provides the
checks at construction, the ROS 2 descriptor and the help text. Nested dataclasses give dotted names
(``friction.stiffness``).
"""

import dataclasses
import functools
import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar, cast

import numpy as np

from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS
from hdd_servo_ros.messages.shown import shown

Value = bool | int | float | str | tuple[bool, ...] | tuple[int, ...] | tuple[float, ...] | tuple[str, ...]
Block = TypeVar('Block')


class ParameterError(ValueError):
    """
    Parameter value that is not allowed.

    The message reads ``invalid value for parameter NAME: VALUE; expected ALLOWED``.

    Parameters
    ----------
    name
        Name of the parameter, with the prefix of its group.
    value
        The rejected value.
    allowed
        What is allowed: a phrase that follows "expected".
    where
        File and line of the value; empty if it is not from a file, or the file is not known here.
    """

    exit_code = WRONG_ARGUMENTS

    def __init__(self, name: str, value: object, allowed: str, where: str = '') -> None:
        self.name = name
        self.value = value
        self.allowed = allowed
        self.where = where
        super().__init__(self._message())

    def _message(self) -> str:
        origin = f'; given in {self.where}' if self.where else ''
        return f'invalid value for parameter {self.name}: {shown(self.value)}; expected {self.allowed}{origin}'

    def renamed(self, name: str) -> 'ParameterError':
        """Return the same error for another name, such as the full name of the parameter."""
        return type(self)(name, self.value, self.allowed, self.where)

    def located(self, where: str) -> 'ParameterError':
        """Return the same error with the file and line of the value."""
        return type(self)(self.name, self.value, self.allowed, where)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.name, self.value, self.allowed, self.where)


class InvalidParameterError(ParameterError):
    """
    Parameter value that is rejected for a reason that does not fit after "expected".

    The message reads ``invalid value for parameter NAME: VALUE; REASON``. The reason is the argument ``allowed`` of
    :class:`ParameterError`.
    """

    def _message(self) -> str:
        origin = f'; given in {self.where}' if self.where else ''
        return f'invalid value for parameter {self.name}: {shown(self.value)}; {self.allowed}{origin}'


class UnknownParameterError(ParameterError):
    """
    Parameter name that is not declared.

    The message reads ``unknown parameter NAME; HINT``. The hint is the argument ``allowed`` of :class:`ParameterError`,
    and may be empty.
    """

    def _message(self) -> str:
        origin = f' (given in {self.where})' if self.where else ''
        return f'unknown parameter {self.name}{origin}' + (f'; {self.allowed}' if self.allowed else '')


@dataclasses.dataclass(frozen=True)
class Declaration:
    """
    Declaration of one parameter: meaning, unit and allowed values.

    Raises
    ------
    ParameterError
        From :meth:`check`, for a value that is not allowed.

    Examples
    --------
    >>> from hdd_servo_ros.parameters import Declaration
    >>> declaration = Declaration('gain', 0.5, 'feedback gain', unit='V/um', minimum=0.0)
    >>> declaration.allowed
    'a finite number at least 0 [V/um]'
    >>> declaration.check(2)
    2.0
    """

    name: str
    default: Value
    description: str
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    above: float = -math.inf
    """Exclusive lower bound."""
    choices: tuple[str, ...] = ()
    read_only: bool = False
    """Whether the value is fixed once the node has started."""
    element: type = float
    """Type of the elements of a list with an empty default."""
    equation: str = ''
    """Number of the thesis's equation with this parameter, such as ``'4.16'``; empty for none."""

    @property
    def is_sequence(self) -> bool:
        """Whether the value is a list."""
        return isinstance(self.default, tuple)

    @property
    def element_type(self) -> type:
        """Type of the value, or of the elements of a list."""
        if isinstance(self.default, tuple):
            return type(self.default[0]) if self.default else self.element
        return type(self.default)

    @property
    def allowed(self) -> str:
        """Description of the allowed values; fits after "expected"."""
        kind = {bool: 'true or false', int: 'an integer', float: 'a finite number', str: 'a string'}[self.element_type]
        text = ' '.join([self._choices or kind, self._bounds]).strip()
        if self.is_sequence:
            text = f'a list, each element {text}'
        return f'{text} [{self.unit}]' if self.unit else text

    @property
    def type_and_range(self) -> str:
        """ROS type of the value and its allowed range, for tables."""
        kind = {bool: 'bool', int: 'int', float: 'float', str: 'string'}[self.element_type]
        kind = f'list of {kind}' if self.is_sequence else kind
        return ', '.join(part for part in (kind, self._choices, self._bounds) if part)

    @property
    def description_with_equation(self) -> str:
        """Description with the number of the thesis's equation, for help output."""
        return f'{self.description} (thesis eq. {self.equation})' if self.equation else self.description

    @property
    def _choices(self) -> str:
        return 'one of ' + ', '.join(self.choices) if self.choices else ''

    @property
    def _bounds(self) -> str:
        bounds = []
        if self.above > -math.inf:
            bounds.append(f'above {self.above:g}')
        if self.minimum > -math.inf:
            bounds.append(f'at least {self.minimum:g}')
        if self.maximum < math.inf:
            bounds.append(f'at most {self.maximum:g}')
        return ' and '.join(bounds)

    def check(self, value: object) -> Value:
        """
        Return ``value``, converted to the declared type.

        Raises
        ------
        ParameterError
            If the value has another type, is not finite, or is outside the bounds or choices.
        """
        if not self.is_sequence:
            return cast(Value, self._check_element(value, value))
        if isinstance(value, str) or not hasattr(value, '__iter__'):
            raise ParameterError(self.name, value, self.allowed)
        return tuple(self._check_element(element, value) for element in value)

    def _check_element(self, element: object, value: object) -> Any:
        kind = self.element_type
        if isinstance(element, np.generic):
            element = element.item()
        if kind is float and isinstance(element, int) and not isinstance(element, bool):
            element = float(element)
        wrong = type(element) is not kind
        if not wrong and kind in (int, float):
            assert isinstance(element, int | float)
            wrong = not (math.isfinite(element) and self.minimum <= element <= self.maximum and element > self.above)
        if not wrong and self.choices:
            wrong = element not in self.choices
        if wrong:
            raise ParameterError(self.name, value, self.allowed)
        return element


def parameter(
    default: Value,
    description: str,
    *,
    unit: str = '',
    minimum: float = -math.inf,
    maximum: float = math.inf,
    above: float = -math.inf,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
    element: type = float,
    equation: str = '',
) -> Any:
    """
    Declare a field of a parameter dataclass; see :class:`Declaration` for the arguments.

    Parameters
    ----------
    default
        Default value; its type is that of the parameter. A tuple declares a list.
    description
        One line for help output and documentation.
    unit
        Unit of the value; empty for a ratio, a count or a seed.
    minimum, maximum
        Inclusive bounds.
    above
        Exclusive lower bound.
    choices
        Allowed strings; empty for any.
    read_only
        Whether the value is fixed once the node has started.
    element
        Type of the elements of a list with an empty default.
    equation
        Number of the thesis's equation with this parameter, such as ``'4.16'``.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterSet, parameter
    >>> @dataclasses.dataclass(frozen=True)
    ... class Spring(ParameterSet):
    ...     stiffness: float = parameter(0.02, 'stiffness', unit='V/um', minimum=0.0)

    >>> Spring(stiffness=0.1)
    Spring(stiffness=0.1)
    >>> Spring(stiffness=-1.0)
    Traceback (most recent call last):
        ...
    ParameterError: invalid value for parameter stiffness: -1.0; expected a finite number at least 0 [V/um]
    """
    bounds = (minimum, maximum, above)
    declaration = Declaration('', default, description, unit, *bounds, choices, read_only, element, equation)
    return dataclasses.field(default=default, metadata={'declaration': declaration})


def group(parameters: type[Any]) -> Any:
    """
    Declare a nested parameter dataclass; its names are prefixed with the name of the field and a dot.

    Parameters
    ----------
    parameters
        The nested dataclass.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterSet, group, parameter, to_mapping
    >>> @dataclasses.dataclass(frozen=True)
    ... class Spring(ParameterSet):
    ...     stiffness: float = parameter(0.02, 'stiffness', unit='V/um', minimum=0.0)
    >>> @dataclasses.dataclass(frozen=True)
    ... class Contact(ParameterSet):
    ...     spring: Spring = group(Spring)
    >>> to_mapping(Contact())
    {'spring.stiffness': 0.02}
    """
    return dataclasses.field(default_factory=parameters)


class ParameterSet:
    """
    Base class of parameter dataclasses; checks every field on construction.

    A subclass with rules for several parameters overrides :meth:`check_together`.

    Raises
    ------
    ParameterError
        If a value is not allowed; reports name, value and allowed values.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter
    >>> @dataclasses.dataclass(frozen=True)
    ... class Band(ParameterSet):
    ...     lowest: float = parameter(10.0, 'lowest frequency', unit='Hz', above=0.0)
    ...     highest: float = parameter(100.0, 'highest frequency', unit='Hz', above=0.0)
    ...
    ...     def check_together(self):
    ...         if self.highest < self.lowest:
    ...             raise ParameterError('highest', self.highest, f'at least lowest, which is {self.lowest:g} Hz')
    >>> Band(highest=5.0)
    Traceback (most recent call last):
        ...
    ParameterError: invalid value for parameter highest: 5.0; expected at least lowest, which is 10 Hz
    """

    def __post_init__(self) -> None:
        for declaration in _own_declarations(type(self)):  # type: ignore[arg-type]
            object.__setattr__(self, declaration.name, declaration.check(getattr(self, declaration.name)))
        self.check_together()

    def check_together(self) -> None:
        """Check rules that involve several parameters; raises :class:`ParameterError`."""


def declarations(parameters: type[Any], prefix: str = '') -> Iterator[Declaration]:
    """
    Iterate over the declarations of a parameter dataclass, with dotted names for nested ones.

    Parameters
    ----------
    parameters
        The dataclass.
    prefix
        Prefix of each name.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterSet, declarations, parameter
    >>> @dataclasses.dataclass(frozen=True)
    ... class Spring(ParameterSet):
    ...     stiffness: float = parameter(0.02, 'stiffness', unit='V/um', minimum=0.0)

    >>> [(found.name, found.default, found.unit) for found in declarations(Spring)]
    [('stiffness', 0.02, 'V/um')]
    """
    return iter(_all_declarations(parameters, prefix))  # type: ignore[arg-type]


# A process that makes many runs uses the same declarations hundreds of times in each. (mypy 2.4 mistakes the hash of a
# class for that of its instances.)
@functools.cache
def _own_declarations(parameters: Any) -> tuple[Declaration, ...]:
    """Return the declarations of the dataclass's own fields, with their names."""
    return tuple(
        dataclasses.replace(field.metadata['declaration'], name=field.name)
        for field in dataclasses.fields(parameters)
        if 'declaration' in field.metadata
    )


@functools.cache
def _all_declarations(parameters: Any, prefix: str) -> tuple[Declaration, ...]:
    found: list[Declaration] = []
    for field in dataclasses.fields(parameters):
        declaration = field.metadata.get('declaration')
        if declaration is not None:
            found.append(dataclasses.replace(declaration, name=prefix + field.name))
        else:
            found += declarations(_group_type(field), f'{prefix}{field.name}.')
    return tuple(found)


_PACKAGE = __name__.partition('.')[0]


def from_mapping(parameters: type[Block], values: Mapping[str, object], prefix: str = '') -> Block:
    """
    Construct a parameter dataclass from dotted names; missing names keep their defaults.

    Raises
    ------
    ParameterError
        If a name is unknown or a value is not allowed; the error has the dotted name.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterSet, from_mapping, parameter
    >>> @dataclasses.dataclass(frozen=True)
    ... class Spring(ParameterSet):
    ...     stiffness: float = parameter(0.02, 'stiffness', unit='V/um', minimum=0.0)

    >>> from_mapping(Spring, {'stiffness': 0.05})
    Spring(stiffness=0.05)
    """
    key = _exact(parameters, values)
    if key is None:
        return _constructed(parameters, values, prefix)
    found: Block | None = _CHECKED.get(key)
    if found is None:
        found = _constructed(parameters, values, prefix)
        if len(_CHECKED) >= _MOST_CHECKED:
            _CHECKED.clear()
        _CHECKED[key] = found
    return found


_CHECKED: dict[tuple[type[Any], str], Any] = {}
"""
Cache of constructed parameter sets of this package: most sets of a run are the same in the next run, and checking them
takes longer than a short run.
"""
_MOST_CHECKED = 512
_PLAIN = frozenset((bool, int, float, str))


def _exact(parameters: type[Any], values: Mapping[str, object]) -> tuple[type[Any], str] | None:
    """
    Return a key that is unique to these parameters, including their types and bits; None if it cannot exist.

    Sets of other packages are constructed each time, because they need not be immutable.
    """
    for value in values.values():
        if type(value) is tuple:
            if not _PLAIN.issuperset(map(type, value)):
                return None
        elif type(value) not in _PLAIN:
            return None
    if parameters.__module__.partition('.')[0] != _PACKAGE or not parameters.__dataclass_params__.frozen:
        return None
    # The shortest decimal representation of a float is unique, including the sign of zero.
    return parameters, repr(list(values.items()))


def _constructed(parameters: type[Block], values: Mapping[str, object], prefix: str) -> Block:
    arguments: dict[str, Any] = {}
    known = set()
    for field in dataclasses.fields(parameters):  # type: ignore[arg-type]
        if 'declaration' in field.metadata:
            known.add(field.name)
            if field.name in values:
                arguments[field.name] = values[field.name]
        else:
            inner = f'{field.name}.'
            nested = {name[len(inner) :]: value for name, value in values.items() if name.startswith(inner)}
            known.update(inner + name for name in nested)
            arguments[field.name] = from_mapping(_group_type(field), nested, prefix + inner)
    for name in values:
        if name not in known:
            names = ', '.join(prefix + declaration.name for declaration in declarations(parameters))
            raise UnknownParameterError(prefix + name, values[name], f'known: {names}')
    try:
        return parameters(**arguments)
    except ParameterError as error:
        raise error.renamed(prefix + error.name) from None


def with_tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return parameters with lists converted to tuples, as the dataclasses hold them.

    Parameters
    ----------
    values
        Parameters by name, from messages or ``run.yaml``.

    Examples
    --------
    >>> from hdd_servo_ros.parameters import with_tuples
    >>> with_tuples({'gains': [1.0, 2.0], 'name': 'a'})
    {'gains': (1.0, 2.0), 'name': 'a'}
    """
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def to_mapping(values: object, prefix: str = '') -> dict[str, Value]:
    """
    Return the values of a parameter dataclass by dotted name, in the order of declaration.

    Parameters
    ----------
    values
        An instance of a parameter dataclass.
    prefix
        Prefix of each name.

    Examples
    --------
    >>> import dataclasses
    >>> from hdd_servo_ros.parameters import ParameterSet, parameter, to_mapping
    >>> @dataclasses.dataclass(frozen=True)
    ... class Spring(ParameterSet):
    ...     stiffness: float = parameter(0.02, 'stiffness', unit='V/um', minimum=0.0)

    >>> to_mapping(Spring())
    {'stiffness': 0.02}
    """
    mapping: dict[str, Value] = {}
    for field in dataclasses.fields(values):  # type: ignore[arg-type]
        value = getattr(values, field.name)
        if 'declaration' in field.metadata:
            mapping[prefix + field.name] = value
        else:
            mapping.update(to_mapping(value, f'{prefix}{field.name}.'))
    return mapping


def _group_type(field: 'dataclasses.Field[Any]') -> type[Any]:
    return cast(type[Any], field.default_factory)
