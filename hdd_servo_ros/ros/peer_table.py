"""What this process knows of the other processes: the last announcement of each, and when it was received."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hdd_servo_ros.messages.outcome import FINISHED, INTERRUPTED
from hdd_servo_ros.ros.announcement import DONE, Announcement, TimerAnnouncement

_FRESH = 1.0
"""For how long the announcement of a waiting process holds; it announces itself ten times as often [s]."""


class PeerTable:
    """
    The other processes that announce themselves, by their identifiers; all times are those of a monotonic clock [s].

    Parameters
    ----------
    now
        The present time.
    """

    def __init__(self, now: float) -> None:
        self._announcements: dict[str, Announcement] = {}
        self._received_at: dict[str, float] = {}
        self.changed_at = now
        """When a process was last added or removed."""

    @property
    def announcements(self) -> Mapping[str, Announcement]:
        """The last announcement of each process."""
        return self._announcements

    def receive(self, announcement: Announcement, now: float) -> bool:
        """Take an announcement into the table; return False if it is of a process that took part in an earlier run."""
        process = announcement.process
        known = self._announcements.get(process)
        if known is None:
            if process not in self._received_at and announcement.state in (INTERRUPTED, FINISHED):
                return False
            self.changed_at = now
        if announcement.nodes is None:
            # Metadata is announced only until the run starts.
            nodes = None if known is None else known.nodes
            announcement = dataclasses.replace(announcement, nodes=nodes or {})
        self._announcements[process] = announcement
        self._received_at[process] = now
        return True

    def expect(self, processes: Iterable[str], now: float) -> None:
        """
        Count the silence of the processes of a run from now on.

        One of them may still be unknown: only a process whose nodes share a topic with it waits for it before a run.
        """
        self._received_at.update(dict.fromkeys(processes, now))

    def remove(self, process: str, now: float) -> None:
        """Remove a process, if it is in the table."""
        self._announcements.pop(process, None)
        self._received_at.pop(process, None)
        self.changed_at = now

    def remove_silent(self, timeout: float, now: float) -> None:
        """Remove the processes that have announced nothing for longer than a time [s]."""
        for process in [process for process in self._announcements if self.silence(process, now) > timeout]:
            self.remove(process, now)

    def silence(self, process: str, now: float) -> float:
        """Return how long a process has announced nothing [s]; 0 for one that is neither known nor expected."""
        return now - self._received_at.get(process, now)

    def nodes(self, now: float) -> Iterator[tuple[str, dict[str, Any]]]:
        """Iterate over names and metadata of all nodes; a process that has become silent may have been killed."""
        for process, announcement in self._announcements.items():
            if self.silence(process, now) < _FRESH:
                yield from (announcement.nodes or {}).items()

    def ticks(self) -> dict[str, int]:
        """Return the next tick of each node, by full name."""
        return {name: tick for each in self._announcements.values() for name, tick in each.ticks.items()}

    def timer(self) -> TimerAnnouncement | None:
        """Return what the timer's process has announced, None if it is not in the table."""
        return next((each.timer for each in self._announcements.values() if each.timer is not None), None)

    def timer_has_finished(self) -> bool:
        """Return whether the timer's process has announced that the run is finished."""
        return any(each.timer is not None and each.state == FINISHED for each in self._announcements.values())

    def timer_is_gone(self, timeout: float, now: float) -> bool:
        """Return whether the timer became silent after it was done: its final announcement was lost."""
        return any(
            each.timer is not None and each.state in (DONE, FINISHED) and self.silence(process, now) > timeout
            for process, each in self._announcements.items()
        )
