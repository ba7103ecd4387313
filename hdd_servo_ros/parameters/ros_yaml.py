"""
YAML as rcl reads it: scalars by the rules of C, lists of a single type, no aliases, node names with wildcards.

rcl gives the events of libyaml a meaning that differs from YAML 1.1 and 1.2: ``010`` is 8, ``1_000.0`` and
``2001-01-01`` are strings, ``.12e3`` is a number. This module therefore reads the events too. Constructs that rcl
accepts by accident (a list in a list, a mapping in a list, a tag) are rejected.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any

import yaml

from hdd_servo_ros.messages.plain_yaml import LOADER
from hdd_servo_ros.messages.shown import shown

PARAMETERS = 'ros__parameters'
_TRUE = frozenset(('Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'))
_FALSE = frozenset(('N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'))
_INTEGER = re.compile(r'([-+]?)(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_DECIMAL = re.compile(r'[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?')
_HEXADECIMAL = re.compile(r'[-+]?0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)([pP][-+]?[0-9]+)?')
_INFINITE = re.compile(r'[-+]?([iI][nN][fF]|[iI][nN][fF][iI][nN][iI][tT][yY]|\.inf|\.Inf|\.INF)')
_NOT_A_NUMBER = re.compile(r'[-+]?([nN][aA][nN]|\.nan|\.NaN|\.NAN)')
LARGEST_INTEGER = 2**63 - 1
"""Range of the 64-bit integers of ROS."""
_SMALLEST_NORMAL = 2.0**-1022
_TEXT_TAG = 'tag:yaml.org,2002:str'
_KINDS = {bool: 'true or false', int: 'an integer', float: 'a double', str: 'a string'}
_DEEPEST = 32
"""Maximum nesting depth of names."""
_LONGEST_EXPONENT = 6
_PART = r'(?:\*\*?|[A-Za-z_][A-Za-z0-9_]*)'
_NODE_NAME = re.compile(rf'/?{_PART}(?:/{_PART})*')

Section = tuple[str, dict[str, object]]
"""
Name of a node as given, with or without a leading slash, possibly with wildcards, and its parameters by dotted name,
lists as tuples.
"""


class Parameters(dict[str, object]):
    """Parameters of a section; ``lines`` has the line number of each, from 1."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: dict[str, int] = {}


class RosYamlError(ValueError):
    """
    Text that is not valid YAML, or YAML that ROS rejects; reports the line.

    Parameters
    ----------
    reason
        Description of the error.
    line
        Line number, from 1; None if it is unknown.
    """

    def __init__(self, reason: str, line: int | None = None) -> None:
        super().__init__(reason if line is None else f'line {line}: {reason}')
        self.reason = reason
        self.line = line


def read_value(text: str) -> object:
    """
    Return the value of ``-p NAME:=TEXT``; lists become tuples.

    Raises
    ------
    RosYamlError
        If ROS would reject it.
    """
    events = _Events(text)
    event = events.next()
    if isinstance(event, yaml.StreamEndEvent):
        raise RosYamlError('the value is missing')
    value = _value(events, event)
    events.end()
    return value


def read_sections(data: bytes) -> Iterator[Section]:
    """
    Iterate over the sections of a parameter file, in order.

    Raises
    ------
    RosYamlError
        If ROS would reject it.
    """
    events = _Events(data)
    while not isinstance(event := events.next(), yaml.StreamEndEvent):
        if not isinstance(event, yaml.MappingStartEvent):
            raise RosYamlError('expected node names at the top level', _line(event))
        yield from _nodes(events, '')


def read_entries(data: bytes) -> dict[str, Any]:
    """
    Return the entries of a file with parameters and other entries, such as the specification of a campaign.

    Scalars are read as in a parameter file, but mappings and lists may be nested in each other.

    Raises
    ------
    RosYamlError
        If the content is not a mapping, ROS would reject a scalar, or a mapping has a duplicate key.
    """
    events = _Events(data)
    event = events.next()
    if not isinstance(event, yaml.MappingStartEvent):
        raise RosYamlError('expected a mapping at the top level', None if _is_end(event) else _line(event))
    found: dict[str, Any] = _entry(events, event, 0)
    events.end()
    return found


def written(value: object) -> str:
    """
    Return a value as text that :func:`read_value` and ROS read back bit by bit.

    Raises
    ------
    TypeError
        If no parameter has this type.
    """
    if isinstance(value, tuple | list):
        return f'[{", ".join(map(written, value))}]'
    if isinstance(value, float) and 0.0 < abs(value) < _SMALLEST_NORMAL:
        # For decimal digits C's strtod reports an inexact result, and ROS then reads them as a string.
        return value.hex()
    # JSON is YAML with unambiguous strings and numbers.
    return json.dumps(value, ensure_ascii=False)


def written_file(sections: Mapping[str, Mapping[str, object]]) -> str:
    """Return a parameter file with the given parameters by node name."""
    lines = []
    for node, parameters in sections.items():
        lines.append(f'{json.dumps(node, ensure_ascii=False)}:\n  {PARAMETERS}:{"" if parameters else " {}"}')
        lines += [f'    {json.dumps(name, ensure_ascii=False)}: {written(value)}' for name, value in parameters.items()]
    return '\n'.join([*lines, ''])


def scalar(text: str) -> bool | int | float | str:
    """Return the value that ROS reads from a plain scalar."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if match := _INTEGER.fullmatch(text):
        sign, digits = match.groups()
        # Longer than any 64-bit integer: not worth converting.
        if len(digits) <= 24:
            base = 16 if digits[:2] in ('0x', '0X') else 8 if digits[0] == '0' else 10
            value = int(sign + digits, base)
            if -LARGEST_INTEGER - 1 <= value <= LARGEST_INTEGER:
                return value
    number = _double(text)
    return text if number is None else number


def _double(text: str) -> float | None:
    """Return the number that ``strtod`` reads, None if it sets ``errno`` or does not read all of the text."""
    if _INFINITE.fullmatch(text):
        return -math.inf if text[0] == '-' else math.inf
    if _NOT_A_NUMBER.fullmatch(text):
        return math.nan
    if _DECIMAL.fullmatch(text):
        value = float(text)
        if abs(value) < _SMALLEST_NORMAL and not _is_exact(text, value):
            return None
    elif _HEXADECIMAL.fullmatch(text):
        try:
            value = float.fromhex(text)
        except OverflowError:
            return None
    else:
        return None
    return value if math.isfinite(value) else None


def _is_exact(text: str, value: float) -> bool:
    """Return whether a subnormal number is exactly the double to which it is rounded."""
    mantissa, _, exponent = text.lower().partition('e')
    if not mantissa.strip('+-.0'):
        return True
    if value == 0.0 or len(exponent) > _LONGEST_EXPONENT:
        return False
    return Decimal(text) == Decimal(value)


class _Events:
    """
    Events of a YAML text, without the start and end of streams and documents.

    Parameters
    ----------
    source
        String, or the bytes of a file, whose Unicode encoding libyaml detects.
    """

    def __init__(self, source: str | bytes) -> None:
        try:
            self._events = yaml.parse(source, Loader=LOADER)
            self._first: Any = next(self._events)
        except (yaml.YAMLError, UnicodeError) as error:
            raise _syntax_error(error) from None

    def next(self) -> Any:
        while True:
            try:
                event = next(self._events)
            except (yaml.YAMLError, UnicodeError) as error:
                raise _syntax_error(error) from None
            if isinstance(event, yaml.AliasEvent):
                raise RosYamlError(f'ROS does not support the alias *{event.anchor}; write the value', _line(event))
            if not isinstance(event, yaml.DocumentStartEvent | yaml.DocumentEndEvent):
                return event

    def end(self) -> None:
        event = self.next()
        if not isinstance(event, yaml.StreamEndEvent):
            raise RosYamlError('more than one value', _line(event))


def _syntax_error(error: Exception) -> RosYamlError:
    mark = getattr(error, 'problem_mark', None)
    if mark is not None:
        reason = getattr(error, 'problem', None) or 'cannot be read'
        return RosYamlError(f'invalid YAML: {reason}', mark.line + 1)
    if isinstance(error, yaml.reader.ReaderError):
        where = f' at position {error.position}' if error.position is not None else ''
        return RosYamlError(f'invalid YAML: {error.reason}{where}; the file must be UTF-8')
    return RosYamlError('invalid YAML: not UTF-8' if isinstance(error, UnicodeError) else f'invalid YAML: {error}')


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1


def _key(event: Any) -> str:
    if not isinstance(event, yaml.ScalarEvent):
        raise RosYamlError('a list or a mapping cannot be a name', _line(event))
    if not event.value:
        raise RosYamlError('a name is empty', _line(event))
    return _text(event)


def _text(event: Any) -> str:
    if '\0' in event.value:
        raise RosYamlError(f'{shown(event.value)} contains a NUL character', _line(event))
    return str(event.value)


def _value(events: _Events, event: Any) -> object:
    """Return the value that starts with an event."""
    if isinstance(event, yaml.ScalarEvent):
        return _scalar(event)
    if isinstance(event, yaml.SequenceStartEvent):
        return _sequence(events, event)
    raise RosYamlError('a mapping is not a value', _line(event))


def _scalar(event: Any) -> bool | int | float | str:
    text = _text(event)
    if event.tag not in (None, '!', _TEXT_TAG):
        raise RosYamlError(f'the tag {shown(event.tag)} is not allowed; the only one is !!str', _line(event))
    if event.tag is not None or event.style in ("'", '"'):
        return text
    if not text:
        raise RosYamlError("the value is missing; write '' for an empty string", _line(event))
    return scalar(text)


def _sequence(events: _Events, start: Any) -> tuple[object, ...]:
    elements: list[object] = []
    while not isinstance(event := events.next(), yaml.SequenceEndEvent):
        if not isinstance(event, yaml.ScalarEvent):
            raise RosYamlError('a list contains a list or a mapping', _line(event))
        elements.append(_scalar(event))
    kinds = list(dict.fromkeys(type(element) for element in elements))
    if len(kinds) > 1:
        hint = '; write 2.0 for 2' if set(kinds) == {int, float} else ''
        mixed = ' and '.join(_KINDS[kind] for kind in kinds[:2])
        raise RosYamlError(f'{shown(elements)} contains {mixed}; all must have the same type{hint}', _line(start))
    return tuple(elements)


def _is_end(event: Any) -> bool:
    return isinstance(event, yaml.StreamEndEvent)


def _entry(events: _Events, event: Any, depth: int) -> Any:
    """Return the entry that starts with an event: a scalar, a list or a mapping."""
    if isinstance(event, yaml.ScalarEvent):
        return _scalar(event)
    if depth == _DEEPEST:
        raise RosYamlError(f'entries are nested more than {_DEEPEST} deep', _line(event))
    if isinstance(event, yaml.SequenceStartEvent):
        elements = []
        while not isinstance(event := events.next(), yaml.SequenceEndEvent):
            elements.append(_entry(events, event, depth + 1))
        return elements
    entries: dict[str, Any] = {}
    while not isinstance(event := events.next(), yaml.MappingEndEvent):
        key = _key(event)
        if key in entries:
            raise RosYamlError(f'{shown(key)} is given twice', _line(event))
        try:
            entries[key] = _entry(events, events.next(), depth + 1)
        except RosYamlError as error:
            raise RosYamlError(f'{key}: {error.reason}', error.line) from None
    return entries


def _nodes(events: _Events, prefix: str, depth: int = 0) -> Iterator[Section]:
    """Iterate over the sections of a mapping of node names, after its start event."""
    while not isinstance(event := events.next(), yaml.MappingEndEvent):
        key, line = _key(event), _line(event)
        event = events.next()
        if not isinstance(event, yaml.MappingStartEvent):
            kind = 'is empty' if isinstance(event, yaml.ScalarEvent) and not event.value else 'is not a mapping'
            wanted = 'parameters' if key == PARAMETERS else f'{PARAMETERS} or further names'
            raise RosYamlError(f'{shown(key)} {kind}; expected {wanted}', line)
        if key != PARAMETERS:
            if depth == _DEEPEST:
                raise RosYamlError(f'names are nested more than {_DEEPEST} deep', line)
            yield from _nodes(events, _joined(prefix, key), depth + 1)
            continue
        if not prefix:
            raise RosYamlError(f'{PARAMETERS} is not below a node name', line)
        if not _NODE_NAME.fullmatch(prefix):
            allowed = 'letters, digits, _ and /, or as a whole part * or **'
            raise RosYamlError(f'{shown(prefix)} is not a node name; expected {allowed}', line)
        parameters = Parameters()
        _read_parameters(events, '', parameters, 0)
        yield prefix, parameters


def _joined(prefix: str, key: str) -> str:
    return f'{prefix}{key}' if prefix in ('', '/') else f'{prefix}/{key}'


def _read_parameters(events: _Events, prefix: str, parameters: 'Parameters', depth: int) -> None:
    """Read a mapping of parameters, after its start event, into dotted names."""
    is_empty = True
    while not isinstance(event := events.next(), yaml.MappingEndEvent):
        is_empty = False
        name = prefix + _key(event)
        line = _line(event)
        try:
            event = events.next()
            if not isinstance(event, yaml.MappingStartEvent):
                parameters[name] = _value(events, event)
                parameters.lines[name] = line
                continue
        except RosYamlError as error:
            raise RosYamlError(f'{name}: {error.reason}', error.line) from None
        if depth == _DEEPEST:
            raise RosYamlError(f'names are nested more than {_DEEPEST} deep', line)
        _read_parameters(events, f'{name}.', parameters, depth + 1)
    if is_empty and prefix:
        raise RosYamlError(f'{prefix[:-1]} is an empty mapping', _line(event))
