"""Run plan: the properties of a run that all its processes share."""

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
    Plan of a run, made by the process of the timer and announced to all others.

    Attributes
    ----------
    sample_time
        T [s].
    last_tick
        N; the run consists of the ticks 0 to N.
    rate
        Pace as a multiple of real time; 0 for as fast as possible.
    frame_id
        Name of the drive.
    timer
        Full name of the timer node.
    nodes
        Metadata of each participating node by its full name: inputs, outputs, parameters and more.
    processes
        Identifiers of the participating processes; that of the timer is the first.
    schedule
        Parameter ``schedule`` of the timer.
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
        """Ticks and their stamps, shared by all nodes of a process."""
        return Ticks(self.sample_time)

    @property
    def identifier(self) -> str:
        """Identifier of the run: that of the first process, which runs the timer; empty without processes."""
        return self.processes[0] if self.processes else ''

    @functools.cached_property
    def changes(self) -> tuple[Change, ...]:
        """The parameter changes of the schedule, in the order of their ticks."""
        return parse_schedule(self.schedule, self.sample_time, self.last_tick)

    def publisher_of(self, topic: str) -> str | None:
        """Return the full name of the participating node that publishes a topic; None if no node does."""
        return next((name for name, node in self.nodes.items() if topic in node['outputs']), None)

    def description(self) -> dict[str, Any]:
        """Return the entries of ``run.yaml`` that are known before the run ends."""
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
    Return the plan of a run for which all nodes are ready.

    Parameters
    ----------
    timer_name
        Full name of the timer node.
    timer
        Its parameters.
    nodes
        Metadata of each participating node by its full name.
    processes
        Identifiers of the participating processes.

    Raises
    ------
    RunError
        If a node rejects the schedule.
    ParameterError
        If the schedule names an unknown node, or the duration does not match the plans of the nodes.
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
