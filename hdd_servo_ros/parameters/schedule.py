"""Parameter schedule: changes of parameters of nodes at exact ticks; no ROS import."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from typing import Any

from hdd_servo_ros.messages.ticks import NANOSECONDS, sample_time_to_nanoseconds
from hdd_servo_ros.parameters import (
    InvalidParameterError,
    ParameterError,
    ParameterSet,
    Value,
    declarations,
    from_mapping,
    to_mapping,
)
from hdd_servo_ros.parameters.files import parse_value
from hdd_servo_ros.parameters.ros_yaml import written

FORM = "TIME NODE PARAMETER VALUE, such as '0.5 pid_controller proportional_gain 0.002'"
THEN = 'then'
"""Prefix of an entry that is a separate change, made after the entries before it."""


@dataclasses.dataclass(frozen=True)
class Change:
    """
    Single entry of a schedule.

    Attributes
    ----------
    entry
        Text of the entry, for messages.
    tick
        First tick with the new value.
    node
        Name of the node; a full name if it starts with a slash.
    name, value
        Parameter and its new value.
    then
        Whether it is a separate change, made after the preceding entries of the same tick and node.
    """

    entry: str
    tick: int
    node: str
    name: str
    value: object
    then: bool = False

    def is_for(self, node: str) -> bool:
        """Return whether this entry is for the node with this full name."""
        return node == self.node or ('/' not in self.node and node.rsplit('/', 1)[-1] == self.node)


@dataclasses.dataclass(frozen=True)
class Step:
    """
    Simultaneous changes of one node.

    Attributes
    ----------
    tick
        First tick with the new values.
    values
        Changed parameters in their declared types.
    sets
        All parameters of the node after the change.
    entry
        Last entry of the step.
    """

    tick: int
    values: dict[str, Value]
    sets: dict[type[Any], ParameterSet]
    entry: str


def parse_schedule(entries: Iterable[str], sample_time: float, last_tick: int) -> tuple[Change, ...]:
    """
    Return the changes of a schedule, in the order of their ticks.

    Parameters
    ----------
    entries
        Strings of the form ``TIME NODE PARAMETER VALUE``, with the time in seconds and the value as in a parameter
        file. Entries of the same tick and node are made together, unless one starts with ``then``.
    sample_time, last_tick
        T [s] and N of the run.

    Raises
    ------
    ParameterError
        If an entry cannot be parsed, or its time does not fall on a tick of the run.
    """
    changes = [_parse(entry, sample_time, last_tick) for entry in entries]
    return tuple(sorted(changes, key=lambda change: change.tick))


def _parse(entry: str, sample_time: float, last_tick: int) -> Change:
    words = entry.split(None, 4 if entry.split(None, 1)[:1] == [THEN] else 3)
    then = words[:1] == [THEN]
    try:
        time, node, name, text = words[then:]
        nanoseconds = Decimal(time) * NANOSECONDS
        value = parse_value(text)
    except (ValueError, InvalidOperation):
        raise ParameterError('schedule', entry, FORM) from None
    if not nanoseconds.is_finite():
        raise ParameterError('schedule', entry, FORM)
    tick, rest = divmod(nanoseconds, sample_time_to_nanoseconds(sample_time))
    if rest or not 0 <= tick <= last_tick:
        allowed = f'a time that falls on a tick, k x {sample_time!r} s with k from 0 to {last_tick}'
        raise ParameterError('schedule', entry, allowed)
    return Change(entry, int(tick), node, name, value, then)


def format_entry(time_ns: int, node: str, name: str, value: Value, *, then: bool = False) -> str:
    """Return an entry of a schedule; :func:`parse_schedule` restores time and value exactly."""
    time = Decimal(time_ns).scaleb(-9).normalize()
    return f'{THEN + " " if then else ""}{time:f} {node} {name} {written(value)}'


def reject_unknown_nodes(changes: Iterable[Change], nodes: Sequence[str]) -> None:
    """
    Reject changes of nodes that are not in the run.

    Raises
    ------
    ParameterError
        If a change is for a node that is not in ``nodes`` (full names).
    """
    for change in changes:
        if not any(change.is_for(node) for node in nodes):
            raise InvalidParameterError('schedule', change.entry, f'unknown node; known: {", ".join(nodes)}')


def plan(
    changes: Iterable[Change], node: str, kinds: Sequence[type[Any]], values: Mapping[str, object]
) -> tuple[Step, ...]:
    """
    Check a schedule for one node, as far as possible before the run.

    Parameters
    ----------
    changes
        Changes of all nodes, in the order of their ticks.
    node
        Full name of the node.
    kinds
        Its parameter dataclasses.
    values
        All its parameters before the first change.

    Returns
    -------
    tuple of Step
        Changes of the node, in order.

    Raises
    ------
    ParameterError
        If a parameter is unknown or read-only, or a value is rejected; names the entry.
    """
    declared = {declaration.name: declaration for kind in kinds for declaration in declarations(kind)}
    present = dict(values)
    steps = []
    for group in _groups(change for change in changes if change.is_for(node)):
        names = set()
        for change in group:
            if change.name not in declared:
                raise InvalidParameterError('schedule', change.entry, f'{node} has no parameter {change.name}')
            if declared[change.name].read_only:
                raise InvalidParameterError('schedule', change.entry, f'{change.name} is read-only')
            if change.name in names:
                raise InvalidParameterError(
                    'schedule', change.entry, f'{change.name} changes twice at one tick; begin the second with {THEN!r}'
                )
            names.add(change.name)
            present[change.name] = change.value
        try:
            sets = {
                kind: from_mapping(
                    kind, {name.name: present[name.name] for name in declarations(kind) if name.name in present}
                )
                for kind in kinds
            }
        except ParameterError as error:
            raise InvalidParameterError('schedule', group[-1].entry, str(error)) from None
        mapping = {name: value for each in sets.values() for name, value in to_mapping(each).items()}
        present = dict(mapping)
        steps.append(Step(group[0].tick, {name: mapping[name] for name in sorted(names)}, sets, group[-1].entry))
    return tuple(steps)


def _groups(changes: Iterable[Change]) -> Iterator[list[Change]]:
    """Iterate over the groups of simultaneous changes."""
    for _, of_tick in itertools.groupby(changes, key=lambda change: change.tick):
        group: list[Change] = []
        for change in of_tick:
            if change.then and group:
                yield group
                group = []
            group.append(change)
        yield group
