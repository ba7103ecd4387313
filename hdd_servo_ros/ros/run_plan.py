"""What all processes of a run agree on."""

import dataclasses
import functools
from typing import Any

from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.parameters.schedule import Change, parse_schedule


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
        For each taking-part node's full name what it said of itself: inputs, outputs, parameters and more.
    processes
        Identifiers of the taking-part processes.
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

    @functools.cached_property
    def changes(self) -> tuple[Change, ...]:
        """The parameter changes of the schedule, in the order of their ticks."""
        return parse_schedule(self.schedule, self.sample_time, self.last_tick)

    def publisher_of(self, topic: str) -> str | None:
        """Return the full name of the taking-part node that publishes a topic (by its full name), None if none does."""
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
