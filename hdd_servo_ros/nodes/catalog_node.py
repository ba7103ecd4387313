"""Loop node with the parameters, inputs and outputs of its catalog row."""

from collections.abc import Callable, Mapping
from typing import Any

from hdd_servo_ros.analysis.parameter_trial import Attempt, Sets, attempt_for
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.graph.connections import TopicInput, inputs_of, optional_inputs_of, outputs_of
from hdd_servo_ros.graph.recorded_nodes import recorded_parameters
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.loop_node import LoopNode


class CatalogNode(LoopNode):
    """
    Base class of the loop nodes of this package.

    Parameters
    ----------
    name
        Name of the node and of its catalog row.

    Raises
    ------
    ParameterError
        If a parameter is invalid.
    """

    make: Callable[[Any, float], Any] | None = None
    """Function that constructs the control law of a custom controller."""

    def __init__(self, name: str) -> None:
        self.row_name = name
        # LoopNode adds the common parameters; the sample time parameter depends on the node.
        _, sample_time_kind, *own = NODES[name].parameter_sets
        super().__init__(
            name,
            own,
            [_subscribed(found) for found in inputs_of(name)],
            outputs_of(name),
            sample_time_kind=sample_time_kind,
            optional_inputs=[_subscribed(found) for found in optional_inputs_of(name)],
        )

    def attempt(
        self, sets: Sets, sample_time: float, nodes: Mapping[str, Mapping[str, Any]], *, is_change: bool
    ) -> Attempt | None:
        def block_of(name: str) -> Any:
            return block_parameters_in(nodes, name)

        return attempt_for(self.row_name, sample_time, sets, block_of, make=self.make, is_change=is_change)


def block_parameters_in(nodes: Mapping[str, Mapping[str, Any]], name: str) -> Any:
    """Return the block parameters of a node before tick 0; None if the node is not among the given ones."""
    found = recorded_parameters({'nodes': nodes}).get(name)
    return None if found is None else block_parameters(name, found)


def _subscribed(found: TopicInput) -> Input:
    return Input(found.topic, found.delay)
