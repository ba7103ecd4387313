"""
What a process of a run announces on the topic ``lockstep`` (``std_msgs/String`` holding JSON).

Several times a second it announces who it is, what state it is in and how far its nodes are. States of a process::

    waiting -> ready -> running -> done -> finished
        any of these -> failed, interrupted
"""

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

WAITING = 'waiting'
READY = 'ready'
RUNNING = 'running'
DONE = 'done'


class AnnouncementError(ValueError):
    """A message on ``lockstep`` is not an announcement."""


@dataclasses.dataclass(frozen=True)
class TimerAnnouncement:
    """
    What the timer's process announces of the run to come.

    Attributes
    ----------
    sample_time
        T [s].
    last_tick
        N as far as the timer's own parameters say it.
    rate
        Pace as a multiple of real time, 0 for as fast as the graph goes.
    schedule
        The timer's parameter of that name; None once the run has started.
    """

    sample_time: float
    last_tick: int
    rate: float
    schedule: Sequence[str] | None = None


@dataclasses.dataclass(frozen=True)
class Announcement:
    """
    One announcement of a process; what is None is left out of the JSON, whose keys are the attributes.

    Attributes
    ----------
    process
        Identifier of the process.
    state
        Its state: one of this module's, or the status of an outcome.
    reason
        Why it ended.
    ticks
        The next tick of each of its nodes, by full name.
    changes
        How often parameters of each of its nodes were changed after tick 0, by full name.
    nodes
        Metadata of its nodes, by full name; until the run has started.
    hears
        Identifiers of the processes whose announcements it has received; until the run has started.
    directory
        Directory of the run, from the process that records it.
    timer
        From the timer's process.
    run
        The fields of the :class:`RunPlan`; from the timer's process, while it is running.
    """

    process: str
    state: str
    reason: str = ''
    ticks: dict[str, int] = dataclasses.field(default_factory=dict)
    changes: dict[str, int] = dataclasses.field(default_factory=dict)
    nodes: dict[str, dict[str, Any]] | None = None
    hears: list[str] | None = None
    directory: str | None = None
    timer: TimerAnnouncement | None = None
    run: dict[str, Any] | None = None

    def encode(self) -> str:
        """Return it as JSON."""
        content = _without_none(vars(self))
        if self.timer is not None:
            content['timer'] = _without_none(vars(self.timer))
        return json.dumps(content)


def decode(text: str) -> Announcement:
    """
    Return the announcement of a JSON text; keys that it does not know are ignored.

    Raises
    ------
    AnnouncementError
        If the text is not an announcement.
    """
    try:
        content = _known_fields(Announcement, json.loads(text))
        if 'timer' in content:
            content['timer'] = TimerAnnouncement(**_known_fields(TimerAnnouncement, content['timer']))
        return Announcement(**content)
    except (ValueError, TypeError, AttributeError) as error:
        raise AnnouncementError(str(error)) from None


def _without_none(content: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if value is not None}


def _known_fields(kind: type[Any], content: dict[str, Any]) -> dict[str, Any]:
    names = {field.name for field in dataclasses.fields(kind)}
    return {key: value for key, value in content.items() if key in names}
