"""The declarations of all parameters of the catalog, and the rejection of names that are not among them."""

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
"""What every ROS node has, and `ros2 param dump` writes; both are true or false."""


def take_standard(given: dict[str, object]) -> None:
    """Take the parameters that every ROS node has out of what was given; raises ParameterError for other types."""
    for name in STANDARD_NAMES:
        value = given.pop(name, False)
        if not isinstance(value, bool):
            raise ParameterError(name, value, 'true or false')


def reject_unknown(given: Mapping[str, object], own: Iterable[str] = ()) -> None:
    """
    Reject parameters that no node has: ``-p x:=1`` is for all nodes, so that a node must ignore what others have.

    Parameters
    ----------
    given
        Names and values.
    own
        Names that are known in addition to those of the catalog.

    Raises
    ------
    ParameterError
        If a name is known nowhere.
    """
    if not given:
        return
    for name in given:
        if name.startswith(QOS_OVERRIDES):
            raise InvalidParameterError(name, given[name], QOS_IS_FIXED)
    known, missing = set(own), given.keys() - set(own)
    # Nodes that are not in every run are imported only for names that the others do not have.
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
    """Return the names of all parameters of these sets."""
    return frozenset(found.name for kind in kinds for found in declarations(kind))


def node_declarations(name: str) -> Iterator[Declaration]:
    """Iterate over the declarations of a node's or command's parameters."""
    for kind in parameter_sets(name):
        yield from declarations(kind)
