"""
JSON from other processes as typed, bounded values.

A *check* returns a value from the JSON parser or raises :class:`ValueError`. The fields of a dataclass carry their
checks (:func:`checked`), and :func:`parse` makes an instance from any string.
"""

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

T = TypeVar('T')
Check = Callable[[Any], Any]

LONGEST_TEXT = 8 * 1024 * 1024
"""Characters of a message; the longest ones contain a parameter schedule, with about 100 characters per change."""
LONGEST_STRING = 64 * 1024
MOST_ELEMENTS = 200_000
_LARGEST = 2**63 - 1
_CHECK = 'check'
_SHOWN = 60


def checked(check: Check, **options: Any) -> Any:
    """Return a dataclass field whose value in a JSON object must pass a check; ``options`` are those of ``field``."""
    return dataclasses.field(metadata={_CHECK: check}, **options)


def parse(kind: type[T], text: str) -> T:
    """
    Return an instance of a dataclass from a JSON object; unknown keys are ignored.

    Raises
    ------
    ValueError
        If the string is invalid; the message is one line whose length does not depend on the string.
    """
    if len(text) > LONGEST_TEXT:
        raise ValueError(f'{len(text)} characters, at most {LONGEST_TEXT} are allowed')
    try:
        return instance(kind)(_content(text))
    except RecursionError:
        raise ValueError('nested too deeply') from None


def _content(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f'invalid JSON: {shown(str(error))}') from None


def instance(kind: type[Any]) -> Check:
    """Return the check that converts an object to an instance of a dataclass."""
    fields = {field.name: field for field in dataclasses.fields(kind)}
    required = [
        name
        for name, field in fields.items()
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]

    def check(value: Any) -> Any:
        content = fields_of({name: field.metadata[_CHECK] for name, field in fields.items()}, required)(value)
        return kind(**content)

    return check


def fields_of(checks: Mapping[str, Check], required: Iterable[str]) -> Check:
    """Return the check of an object with the given fields; it drops all others."""

    def check(value: Any) -> dict[str, Any]:
        content = _object(value)
        missing = [name for name in required if name not in content]
        if missing:
            raise ValueError(f'{missing[0]} is missing')
        return {name: _named(name, each, content[name]) for name, each in checks.items() if name in content}

    return check


def mapping(element: Check) -> Check:
    """Return the check of an object with arbitrary names and values of one kind."""

    def check(value: Any) -> dict[str, Any]:
        content = _bounded(_object(value))
        return {string(name): _named(name, element, found) for name, found in content.items()}

    return check


def sequence(element: Check) -> Check:
    """Return the check of an array with elements of one kind."""

    def check(value: Any) -> list[Any]:
        if not isinstance(value, list):
            raise ValueError(f'{shown(value)} is not an array')
        return [element(each) for each in _bounded(value)]

    return check


def one_of(*allowed: str) -> Check:
    """Return the check of a string that must be one of ``allowed``."""

    def check(value: Any) -> str:
        if value not in allowed:
            raise ValueError(f'{shown(value)}; expected one of {", ".join(allowed)}')
        return value

    return check


def string(value: Any) -> str:
    """Check a string."""
    if not isinstance(value, str):
        raise ValueError(f'{shown(value)} is not a string')
    if len(value) > LONGEST_STRING:
        raise ValueError(f'a string of {len(value)} characters, at most {LONGEST_STRING} are allowed')
    return value


def count(value: Any) -> int:
    """Check an integer from 0 to 2^63 - 1."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST:
        raise ValueError(f'{shown(value)}; expected an integer from 0 to 2^63 - 1')
    return value


def finite(value: Any) -> float:
    """Check a finite, nonnegative number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f'{shown(value)} is not a number')
    if (isinstance(value, int) and abs(value) > _LARGEST) or not math.isfinite(value) or value < 0:
        raise ValueError(f'{shown(value)}; expected a finite number >= 0')
    return value


def positive(value: Any) -> float:
    """Check a finite number above 0."""
    if finite(value) == 0:
        raise ValueError(f'{shown(value)}; expected a number > 0')
    return value


def parameter_value(value: Any) -> Any:
    """Check a parameter value: a boolean, a 64-bit number, a string, or an array of these."""
    if isinstance(value, list):
        return [_scalar(each) for each in _bounded(value)]
    return _scalar(value)


def shown(value: Any) -> str:
    """Return a value as printable text of limited length for a message."""
    text = value if isinstance(value, str) else repr(value)[: 4 * _SHOWN]
    text = ''.join(character if character.isprintable() else '?' for character in text[: 4 * _SHOWN])
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}...'


def _scalar(value: Any) -> Any:
    if isinstance(value, str):
        return string(value)
    if (isinstance(value, int) and -_LARGEST - 1 <= value <= _LARGEST) or isinstance(value, float):
        return value
    raise ValueError(f'{shown(value)} is not a parameter value')


def _object(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f'{shown(value)} is not an object')
    return value


def _bounded(value: Any) -> Any:
    if len(value) > MOST_ELEMENTS:
        raise ValueError(f'{len(value)} elements, at most {MOST_ELEMENTS} are allowed')
    return value


def _named(name: str, check: Check, value: Any) -> Any:
    try:
        return check(value)
    except ValueError as error:
        raise ValueError(f'{shown(name)}: {error}') from None
