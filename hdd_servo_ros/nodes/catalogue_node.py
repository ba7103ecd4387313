"""A loop node whose parameters, inputs and outputs are those of its row in the catalogue."""

from hdd_servo_ros.graph.catalogue import NODES
from hdd_servo_ros.graph.connections import TopicInput, inputs_of, optional_inputs_of, outputs_of
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.loop_node import LoopNode


class CatalogueNode(LoopNode):
    """
    Base of this package's loop nodes.

    Parameters
    ----------
    name
        Name of the node and of its row.

    Raises
    ------
    ParameterError
        If a parameter is not allowed.
    """

    def __init__(self, name: str) -> None:
        # What every node has, LoopNode adds itself; how a node knows T differs.
        _, sample_time_kind, *own = NODES[name].parameter_sets
        super().__init__(
            name,
            own,
            [_subscribed(found) for found in inputs_of(name)],
            outputs_of(name),
            sample_time_kind=sample_time_kind,
            optional_inputs=[_subscribed(found) for found in optional_inputs_of(name)],
        )


def _subscribed(found: TopicInput) -> Input:
    return Input(found.topic, found.delay)
