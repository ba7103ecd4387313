"""Metadata of nodes, which a process announces before the run and ``run.yaml`` records."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.schedule import parse_schedule
from hdd_servo_ros.ros.announcement import TimerAnnouncement
from hdd_servo_ros.ros.loop_node import LoopNode


def metadata_of(nodes: Sequence[LoopNode], timer: TimerAnnouncement | None) -> dict[str, dict[str, Any]]:
    """
    Return the present metadata of nodes; their parameters may change until the run starts.

    Parameters
    ----------
    nodes
        The nodes of this process.
    timer
        Announcement of the timer; None while it is unknown.

    Returns
    -------
    dict
        By full name: inputs, outputs, offers and parameters; where applicable, the last tick needed and the reason
        why the node rejects the schedule.

    Raises
    ------
    RunError
        If the plan of a node does not match the sample time of the timer.
    """
    metadata = {node.get_fully_qualified_name(): _metadata_of_node(node) for node in nodes}
    if timer is not None:
        try:
            needed = last_ticks_needed(nodes, timer.sample_time)
        except ParameterError as error:
            raise RunError(str(error)) from None
        for name, tick in needed.items():
            metadata[name]['last_tick_needed'] = tick
        for name, reason in _schedule_rejections(nodes, timer):
            metadata[name]['rejects'] = reason
    return metadata


def _metadata_of_node(node: LoopNode) -> dict[str, Any]:
    return {
        'inputs': [port.name for port in (*node.inputs, *node.optional_inputs)],
        'outputs': [publisher.topic_name for publisher in node.loop_publishers],
        'offers': node.offers(),
        'parameters': node.parameters.as_mapping(),
    }


def _schedule_rejections(nodes: Iterable[LoopNode], timer: TimerAnnouncement) -> Iterator[tuple[str, str]]:
    """
    Iterate over the nodes that cannot follow the schedule of the timer, with the reasons.

    They only announce the reason. The timer ends the run when all are ready, so that every process receives it.
    """
    if timer.schedule:
        changes = parse_schedule(timer.schedule, timer.sample_time, timer.last_tick)
        for node in nodes:
            try:
                node.plan(changes)
            except ParameterError as error:
                yield node.get_fully_qualified_name(), str(error)


def last_ticks_needed(nodes: Iterable[LoopNode], sample_time: float) -> dict[str, int]:
    """Return the last tick of each node that has a plan at a sample time [s], by its full name."""
    needed = {node.get_fully_qualified_name(): node.last_tick_needed(sample_time) for node in nodes}
    return {name: tick for name, tick in needed.items() if tick}
