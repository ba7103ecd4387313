"""
Announcements of the processes of a run on the topic ``lockstep`` (``std_msgs/String`` holding JSON).

Several times per second, each process announces its identity, its state and the progress of its nodes. States::

    waiting -> ready -> running -> done -> finished
        any of these -> failed, interrupted
"""

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED
from hdd_servo_ros.ros.typed_json import (
    checked,
    count,
    fields_of,
    finite,
    instance,
    mapping,
    one_of,
    parameter_value,
    parse,
    positive,
    sequence,
    string,
)

WAITING = 'waiting'
READY = 'ready'
RUNNING = 'running'
DONE = 'done'
_STATES = (WAITING, READY, RUNNING, DONE, FINISHED, FAILED, INTERRUPTED)

_NODE = fields_of(
    {
        'inputs': sequence(string),
        'outputs': sequence(string),
        'offers': mapping(string),
        'parameters': mapping(parameter_value),
        'last_tick_needed': count,
        'rejects': string,
    },
    required=('inputs', 'outputs', 'offers', 'parameters'),
)
_RUN = fields_of(
    {
        'sample_time': positive,
        'last_tick': count,
        'rate': finite,
        'frame_id': string,
        'timer': string,
        'nodes': mapping(_NODE),
        'processes': sequence(string),
        'schedule': sequence(string),
    },
    required=('sample_time', 'last_tick', 'rate', 'frame_id', 'timer', 'nodes', 'processes', 'schedule'),
)


class AnnouncementError(ValueError):
    """A message on ``lockstep`` is not an announcement."""


@dataclasses.dataclass(frozen=True)
class TimerAnnouncement:
    """
    Announcement of the coming run by the process of the timer.

    Attributes
    ----------
    sample_time
        T [s].
    last_tick
        N according to the parameters of the timer.
    rate
        Pace as a multiple of real time; 0 for as fast as possible.
    schedule
        The timer's parameter of that name; None once the run has started.
    """

    sample_time: float = checked(positive)
    last_tick: int = checked(count)
    rate: float = checked(finite)
    schedule: Sequence[str] | None = checked(sequence(string), default=None)


@dataclasses.dataclass(frozen=True)
class Announcement:
    """
    Announcement of a process. The keys of the JSON object are the attributes; null values are omitted.

    Attributes
    ----------
    process
        Identifier of the process.
    state
        Its state: a state of this module, or the status of an outcome.
    reason
        Reason of its end.
    ticks
        The next tick of each of its nodes, by full name.
    changes
        Number of parameter changes of each of its nodes after tick 0, by full name.
    nodes
        Metadata of its nodes, by full name, until the run has started. A process must announce nodes to participate.
    receives
        Identifiers of the processes whose announcements it has received, until the run has started.
    directory
        Directory of the run; only from the process that records it.
    timer
        Only from the process of the timer.
    run
        The fields of the :class:`RunPlan`; only from the process of the timer, while it is running.
    """

    process: str = checked(string)
    state: str = checked(one_of(*_STATES))
    reason: str = checked(string, default='')
    ticks: dict[str, int] = checked(mapping(count), default_factory=dict)
    changes: dict[str, int] = checked(mapping(count), default_factory=dict)
    nodes: dict[str, dict[str, Any]] | None = checked(mapping(_NODE), default=None)
    receives: list[str] | None = checked(sequence(string), default=None)
    directory: str | None = checked(string, default=None)
    timer: TimerAnnouncement | None = checked(instance(TimerAnnouncement), default=None)
    run: dict[str, Any] | None = checked(_RUN, default=None)

    def encode(self) -> str:
        """Return the announcement as JSON."""
        content = _without_none(vars(self))
        if self.timer is not None:
            content['timer'] = _without_none(vars(self.timer))
        return json.dumps(content)


def decode(text: str) -> Announcement:
    """
    Return the announcement in a JSON string; unknown keys are ignored.

    Raises
    ------
    AnnouncementError
        If the string is not an announcement.
    """
    try:
        return parse(Announcement, text)
    except ValueError as error:
        raise AnnouncementError(str(error)) from None


def _without_none(content: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if value is not None}
