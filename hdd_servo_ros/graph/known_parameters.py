"""Declarations of all parameters of the catalog, and rejection of unknown names."""

import difflib
import functools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hdd_servo_ros.graph.catalog import NODES, names_with_parameters, parameter_sets
from hdd_servo_ros.parameters import (
    Declaration,
    InvalidParameterError,
    ParameterError,
    UnknownParameterError,
    declarations,
)
from hdd_servo_ros.parameters.files import QOS_IS_FIXED, QOS_OVERRIDES

STANDARD_NAMES = ('use_sim_time', 'start_type_description_service')
"""Boolean parameters of every ROS node, which `ros2 param dump` writes."""


def take_standard(given: dict[str, object]) -> None:
    """Remove the parameters of every ROS node from ``given``; raises ParameterError if one is not boolean."""
    for name in STANDARD_NAMES:
        value = given.pop(name, False)
        if not isinstance(value, bool):
            raise ParameterError(name, value, 'true or false')


def reject_unknown(given: Mapping[str, object], own: Iterable[str] = ()) -> None:
    """
    Reject parameters that no node has; ``-p x:=1`` applies to all nodes, so a node must ignore those of others.

    Parameters
    ----------
    given
        Names and values.
    own
        Names that are known in addition to those of the catalog.

    Raises
    ------
    ParameterError
        If no node has a parameter of a name.
    """
    if not given:
        return
    for name in given:
        if name.startswith(QOS_OVERRIDES):
            raise InvalidParameterError(name, given[name], QOS_IS_FIXED)
    known, missing = set(own), given.keys() - set(own)
    # Nodes that are not in every run are imported only for names that the other nodes do not have.
    for node in sorted(names_with_parameters(), key=lambda name: name in NODES and bool(NODES[name].role)):
        if not missing:
            return
        known |= _names_in(parameter_sets(node))
        missing -= known
    if missing:
        name = next(name for name in given if name in missing)
        similar = difflib.get_close_matches(name, known, n=1)
        raise UnknownParameterError(name, given[name], f'did you mean {similar[0]}?' if similar else '')


@functools.lru_cache(maxsize=64)
def _names_in(kinds: tuple[type[Any], ...]) -> frozenset[str]:
    """Return the names of all parameters of some sets."""
    return frozenset(found.name for kind in kinds for found in declarations(kind))


def node_declarations(name: str) -> Iterator[Declaration]:
    """Iterate over the parameter declarations of a node or command."""
    for kind in parameter_sets(name):
        yield from declarations(kind)
