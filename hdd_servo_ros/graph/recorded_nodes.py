"""Catalog name of a node of a recorded run, regardless of remap rules; no ROS import."""

from collections.abc import Mapping
from typing import Any

from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES, parameter_sets
from hdd_servo_ros.graph.connections import outputs_of
from hdd_servo_ros.parameters import declarations, with_tuples


def kind_of_node(full_name: str, node: Mapping[str, Any], description: Mapping[str, Any]) -> str:
    """
    Return the catalog name of a recorded node.

    Parameters
    ----------
    full_name, node
        Its key and entry among ``nodes`` of ``run.yaml``.
    description
        Content of ``run.yaml``; if it has no ``topics``, only the parameters decide.

    Returns
    -------
    str
        The last part of ``full_name`` if it is in the catalog; otherwise the node that publishes the same topics and
        has the same parameters; the last part of ``full_name`` if no single node does.
    """
    own = full_name.rpartition('/')[2]
    if own in NODES:
        return own
    names = {name: topic for topic, name in {**description.get('topics', {}), **_left_out(description)}.items()}
    published = {names[name] for name in node.get('outputs', ()) if name in names}
    given = set(node.get('parameters', ()))
    fitting = {
        kind: declared
        for kind, declared in ((kind, _names_of(kind)) for kind in NODES)
        if given <= declared
        if not names or published == {topic.name for topic in outputs_of(kind)} & set(names.values())
    }
    if len(fitting) > 1:
        fitting = {kind: declared for kind, declared in fitting.items() if declared == given}
    # Two controllers with the same law have the same parameters.
    controller = CONTROLLERS.get(description.get('controller', ''), '')
    if len(fitting) > 1 and controller in fitting:
        return controller
    # The node of a custom controller may have only the parameters that every controller has.
    if len(fitting) != 1 or ('controller_class' in description and 'control' in published):
        return own
    return next(iter(fitting))


def recorded_nodes(description: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the node entries of a ``run.yaml`` by catalog name; ``description`` is its content."""
    return {kind_of_node(name, node, description): node for name, node in description.get('nodes', {}).items()}


def kind_by_name(description: Mapping[str, Any], full_name: str) -> str:
    """Return the catalog name of the node ``full_name`` of a run; ``description`` is its ``run.yaml``."""
    return kind_of_node(full_name, description.get('nodes', {}).get(full_name, {}), description)


def recorded_parameters(description: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes of a run by catalog name, with lists as tuples."""
    return {name: with_tuples(node.get('parameters', {})) for name, node in recorded_nodes(description).items()}


def _names_of(kind: str) -> set[str]:
    return {found.name for declared in parameter_sets(kind) for found in declarations(declared)}


def _left_out(description: Mapping[str, Any]) -> Mapping[str, str]:
    found = description.get('topics_left_out')
    return found if isinstance(found, Mapping) else {}
