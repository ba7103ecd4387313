"""What all processes of a run agree on."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.parameters.run_parameters import TimerParameters, last_tick_of_run
from hdd_servo_ros.parameters.schedule import Change, parse_schedule, reject_unknown_nodes


@dataclasses.dataclass(frozen=True)
class RunPlan:
    """
    A run that is about to begin; made by the timer's process and handed to all others.

    Attributes
    ----------
    sample_time
        T [s].
    last_tick
        N; the run has the ticks 0 to N.
    rate
        Pace as a multiple of real time, 0 for as fast as the graph goes.
    frame_id
        Name of the drive.
    timer
        Full name of the timer's node.
    nodes
        The metadata of each participating node by its full name: inputs, outputs, parameters and more.
    processes
        Identifiers of the participating processes, that of the timer first.
    schedule
        The timer's parameter of that name.
    """

    sample_time: float
    last_tick: int
    rate: float
    frame_id: str
    timer: str
    nodes: dict[str, dict[str, Any]]
    processes: list[str]
    schedule: list[str]

    @functools.cached_property
    def ticks(self) -> Ticks:
        """The time line, one for all nodes of a process."""
        return Ticks(self.sample_time)

    @property
    def identifier(self) -> str:
        """Identifier of the run: that of the process of its timer, the first of the processes; empty without one."""
        return self.processes[0] if self.processes else ''

    @functools.cached_property
    def changes(self) -> tuple[Change, ...]:
        """The parameter changes of the schedule, in the order of their ticks."""
        return parse_schedule(self.schedule, self.sample_time, self.last_tick)

    def publisher_of(self, topic: str) -> str | None:
        """Return the full name of the participating node that publishes a topic, None if none does."""
        return next((name for name, node in self.nodes.items() if topic in node['outputs']), None)

    def description(self) -> dict[str, Any]:
        """Return what ``run.yaml`` says of the run before it has ended."""
        offers = {key: text for node in self.nodes.values() for key, text in node['offers'].items()}
        return {
            'sample_time': self.sample_time,
            'last_tick_planned': self.last_tick,
            'duration': self.last_tick * self.sample_time,
            'rate': self.rate,
            **offers,
            'nodes': self.nodes,
        }


def make_run_plan(
    timer_name: str, timer: TimerParameters, nodes: dict[str, dict[str, Any]], processes: Sequence[str]
) -> RunPlan:
    """
    Return the plan of a run that all nodes are ready for.

    Parameters
    ----------
    timer_name
        Full name of the timer's node.
    timer
        Its parameters.
    nodes
        The metadata of each participating node by its full name.
    processes
        Identifiers of the participating processes.

    Raises
    ------
    RunError
        If a node rejects the schedule.
    ParameterError
        If the schedule names an unknown node, or the duration does not go with the nodes' plans.
    """
    frame_id = next((node['offers']['frame_id'] for node in nodes.values() if 'frame_id' in node['offers']), '')
    for node in nodes.values():
        if 'rejects' in node:
            raise RunError(node['rejects'])
    needed = {name: node['last_tick_needed'] for name, node in nodes.items() if 'last_tick_needed' in node}
    reject_unknown_nodes(timer.changes, list(nodes))
    last_tick = last_tick_of_run(timer, needed)
    return RunPlan(
        timer.sample_time, last_tick, timer.rate, frame_id, timer_name, nodes, list(processes), list(timer.schedule)
    )
