"""Parameters of a recorded run and their changes during the run."""

import dataclasses
import difflib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.messages.topics import PARAMETER_EVENT_TYPE, PARAMETER_EVENTS
from hdd_servo_ros.parameters.events import NodeChange, change_of_event, deserialized_event, unpack_value
from hdd_servo_ros.recording.bag_columns import Bag, BagError, bag_directory


@dataclasses.dataclass(frozen=True)
class ParameterChange:
    """Change of a parameter during a run; ``tick`` is the first tick with the new value."""

    tick: int
    node: str
    name: str
    value: Any


def recorded_changes(path: Path) -> list[NodeChange]:
    """
    Return the parameter changes in the bag of a run, in the order in which they were recorded.

    Parameters
    ----------
    path
        Run directory or bag.
    """
    bag = Bag(bag_directory(path))
    return [change_of_event(_event(bag, message)) for message in _events(bag)]


def _events(bag: Bag) -> list[bytes]:
    return bag.column(PARAMETER_EVENTS).as_bytes() if PARAMETER_EVENTS in bag.types else []


def _event(bag: Bag, message: bytes) -> Any:
    # The reader of `rosbags` raises errors of any type for invalid bytes.
    try:
        return deserialized_event(message)
    except Exception as error:
        raise BagError(
            f'{bag.path}: a message on {PARAMETER_EVENTS} is not a {PARAMETER_EVENT_TYPE}: {error}'
        ) from None


class ParameterHistory:
    """
    Values of all parameters at every tick of a run.

    Parameters
    ----------
    path
        Path of the run, for error messages.
    nodes
        ``nodes`` of ``run.yaml``: by full name, with the ``parameters`` at tick 0.
    changes
        Changes during the run.
    """

    def __init__(self, path: Path, nodes: Mapping[str, Any], changes: Iterable[ParameterChange]) -> None:
        self._path = path
        self._nodes = nodes
        self.changes: Sequence[ParameterChange] = sorted(changes, key=lambda change: change.tick)
        """All changes, in the order of their ticks."""

    @classmethod
    def recorded(
        cls, bag: Bag, nodes: Mapping[str, Any], sample_time_ns: int, origin_ns: int = 0
    ) -> 'ParameterHistory':
        """
        Return the history recorded in the parameter events of a bag.

        Parameters
        ----------
        bag
            Bag of the run.
        nodes
            ``nodes`` of ``run.yaml``.
        sample_time_ns
            T [ns].
        origin_ns
            Time of tick 0 [ns].

        Raises
        ------
        BagError
            If an event cannot be read.
        """
        changes = []
        for message in _events(bag):
            event = _event(bag, message)
            tick = -(-(event.stamp.sec * NANOSECONDS + event.stamp.nanosec - origin_ns) // sample_time_ns)
            for parameter in event.changed_parameters:
                value = plain_value(unpack_value(parameter.value))
                changes.append(ParameterChange(tick, event.node, parameter.name, value))
        return cls(bag.path, nodes, changes)

    def value(self, node: str, name: str, tick: int | None = None) -> Any:
        """
        Return the value at a tick; the last value if None.

        Raises
        ------
        LookupError
            If the run has no such node or parameter.
        """
        full_name = next(
            (full for full in self._nodes if node.strip('/') in (full.strip('/'), full.rsplit('/', 1)[-1])), None
        )
        if full_name is None:
            raise LookupError(f'{self._path}: no node {node!r} in run.yaml; it has {", ".join(self._nodes) or "none"}')
        parameters: Mapping[str, Any] = self._nodes[full_name]['parameters']
        if name not in parameters:
            similar = difflib.get_close_matches(name, parameters, n=1)
            hint = f'; did you mean {similar[0]}?' if similar else ''
            raise LookupError(f'{self._path}: {full_name} has no parameter {name!r}{hint}')
        value = parameters[name]
        for change in self.changes:
            if (change.node, change.name) == (full_name, name) and (tick is None or change.tick <= tick):
                value = change.value
        return value


def plain_value(value: Any) -> Any:
    """Return a value in the form used in ``run.yaml``."""
    return list(value) if isinstance(value, tuple) else value
