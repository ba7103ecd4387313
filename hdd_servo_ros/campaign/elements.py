"""Varied elements of list parameters: ``NODE:PARAMETER[INDEX]``, where the first element has index 0."""

import re
from collections.abc import Iterable, Mapping

from hdd_servo_ros.parameters.files import ArgumentError

_BRACKETS = re.compile(r'(.*)\[(.*)\]')
_INDEX = re.compile(r'[0-9]{1,9}')


def list_and_index(key: str) -> tuple[str, int | None]:
    """Return the list and the index of an element key; the key and None for another key."""
    match = _BRACKETS.fullmatch(key)
    return (match[1], int(match[2])) if match and _INDEX.fullmatch(match[2]) else (key, None)


def check_notation(key: str, where: str) -> None:
    """Reject brackets without an index; raises :class:`ArgumentError`."""
    match = _BRACKETS.fullmatch(key)
    if match and not _INDEX.fullmatch(match[2]):
        raise ArgumentError(f'{where}: {key}: {match[2]!r} is not the index of an element; the first is 0')


def check_once(keys: Iterable[str], where: str) -> None:
    """Reject a list together with its elements; raises :class:`ArgumentError`."""
    lists = {list_and_index(key)[0]: key for key in keys if list_and_index(key)[1] is not None}
    for key in keys:
        if key in lists:
            raise ArgumentError(
                f'{where}: {key} and {lists[key]} are both given; vary the list or its elements, not both'
            )


def element(base: object, key: str, where: str) -> object:
    """
    Return an element of a list base value.

    Parameters
    ----------
    base
        Base value of the parameter.
    key
        Key of the element.
    where
        Entry to name in an error.

    Raises
    ------
    ArgumentError
        If the base value is not a list, or has no such element.
    """
    name, index = list_and_index(key)
    if not isinstance(base, tuple | list):
        raise ArgumentError(f'{where}: {key}: {name} is not a list, its base value is {base!r}')
    if index is None or index >= len(base):
        valid = f'valid indices are 0 to {len(base) - 1}' if base else 'the list is empty'
        raise ArgumentError(f'{where}: {key}: the base value of {name} has no element {index}; {valid}')
    return base[index]


def with_elements(bases: Mapping[str, object], varied: Mapping[str, object]) -> dict[str, tuple[object, ...]]:
    """
    Return the lists with varied elements as a run uses them.

    Parameters
    ----------
    bases
        Base values of the parameters; a list that is not among them is omitted.
    varied
        All varied keys, elements and others.
    """
    found: dict[str, list[object]] = {}
    for key, value in varied.items():
        name, index = list_and_index(key)
        base = bases.get(name)
        if index is None or not isinstance(base, tuple | list):
            continue
        elements = found.setdefault(name, list(base))
        # ROS requires one type for all elements of a list.
        is_integer_for_float = isinstance(base[index], float) and isinstance(value, int) and not isinstance(value, bool)
        elements[index] = float(str(value)) if is_integer_for_float else value
    return {name: tuple(elements) for name, elements in found.items()}
