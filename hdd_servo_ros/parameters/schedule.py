"""The parameter schedule: which node changes which parameters before it fires for which tick; no ROS import."""

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
"""What an entry begins with that is a change of its own, made after those that stand before it."""


@dataclasses.dataclass(frozen=True)
class Change:
    """
    One entry of a schedule.

    Attributes
    ----------
    entry
        The text, for messages.
    tick
        The first tick for which it holds.
    node
        Name of the node, full if it begins with a slash.
    name, value
        The parameter and what it is set to.
    then
        Whether it is a change of its own, made after the entries of the same tick and node that stand before it.
    """

    entry: str
    tick: int
    node: str
    name: str
    value: object
    then: bool = False

    def is_for(self, node: str) -> bool:
        """Return whether this is for the node of that full name."""
        return node == self.node or ('/' not in self.node and node.rsplit('/', 1)[-1] == self.node)


@dataclasses.dataclass(frozen=True)
class Step:
    """
    What one node changes at once.

    Attributes
    ----------
    tick
        The first tick for which it holds.
    values
        The changed parameters in their declared types.
    sets
        All parameters of the node from then on.
    entry
        The last entry that it comes from.
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
        Texts of the form ``TIME NODE PARAMETER VALUE``, the time in seconds and the value as in a parameter file;
        those of one tick and node are made together, unless one begins with ``then``.
    sample_time, last_tick
        T [s] and N of the run.

    Raises
    ------
    ParameterError
        If an entry cannot be read, or its time is no tick of the run.
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
    """Return an entry for a schedule; :func:`parse_schedule` finds time and value again to the bit."""
    time = Decimal(time_ns).scaleb(-9).normalize()
    return f'{THEN + " " if then else ""}{time:f} {node} {name} {written(value)}'


def reject_unknown_nodes(changes: Iterable[Change], nodes: Sequence[str]) -> None:
    """
    Reject changes of nodes that do not take part.

    Raises
    ------
    ParameterError
        If a change is for none of ``nodes`` (full names).
    """
    for change in changes:
        if not any(change.is_for(node) for node in nodes):
            raise InvalidParameterError('schedule', change.entry, f'unknown node; known: {", ".join(nodes)}')


def plan(
    changes: Iterable[Change], node: str, kinds: Sequence[type[Any]], values: Mapping[str, object]
) -> tuple[Step, ...]:
    """
    Check a schedule for one node as far as that can be done before the run.

    Parameters
    ----------
    changes
        Changes of all nodes, in the order of their ticks.
    node
        The node's full name.
    kinds
        Its parameter dataclasses.
    values
        All its parameters before the first change.

    Returns
    -------
    tuple of Step
        What the node changes, in order.

    Raises
    ------
    ParameterError
        If it has no such parameter, the parameter is read-only, or the value is rejected; names the entry.
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
    """Iterate over what is changed at once."""
    for _, of_tick in itertools.groupby(changes, key=lambda change: change.tick):
        group: list[Change] = []
        for change in of_tick:
            if change.then and group:
                yield group
                group = []
            group.append(change)
        yield group
