"""Table of the other processes: the last announcement of each, and when it was received."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hdd_servo_ros.messages.outcome import FINISHED, INTERRUPTED
from hdd_servo_ros.ros.announcement import DONE, Announcement, TimerAnnouncement

_FRESH = 1.0
"""Time for which the announcement of a waiting process is valid; the process sends one every 0.1 s [s]."""


class PeerTable:
    """
    Announcements of the other processes, by process identifier; all times are of a monotonic clock [s].

    Parameters
    ----------
    now
        The present time.
    """

    def __init__(self, now: float) -> None:
        self._announcements: dict[str, Announcement] = {}
        self._received_at: dict[str, float] = {}
        self.changed_at = now
        """Time at which a process was last added or removed."""

    @property
    def announcements(self) -> Mapping[str, Announcement]:
        """The last announcement of each process."""
        return self._announcements

    def receive(self, announcement: Announcement, now: float) -> bool:
        """Enter an announcement; return False if its process belonged to an earlier run."""
        process = announcement.process
        known = self._announcements.get(process)
        if known is None:
            if process not in self._received_at and announcement.state in (INTERRUPTED, FINISHED):
                return False
            self.changed_at = now
        if announcement.nodes is None:
            # Metadata is announced only before the run starts.
            nodes = None if known is None else known.nodes
            announcement = dataclasses.replace(announcement, nodes=nodes or {})
        self._announcements[process] = announcement
        self._received_at[process] = now
        return True

    def expect(self, processes: Iterable[str], now: float) -> None:
        """
        Measure the silence of the processes of a run from now on.

        A process may still be unknown: before a run, only processes that share a topic with it wait for it.
        """
        self._received_at.update(dict.fromkeys(processes, now))

    def remove(self, process: str, now: float) -> None:
        """Remove a process if it is in the table."""
        self._announcements.pop(process, None)
        self._received_at.pop(process, None)
        self.changed_at = now

    def remove_silent(self, timeout: float, now: float) -> None:
        """Remove the processes without an announcement for longer than a time [s]."""
        for process in [process for process in self._announcements if self.silence(process, now) > timeout]:
            self.remove(process, now)

    def silence(self, process: str, now: float) -> float:
        """Return the time since the last announcement of a process [s]; 0 if it is neither known nor expected."""
        return now - self._received_at.get(process, now)

    def nodes(self, now: float) -> Iterator[tuple[str, dict[str, Any]]]:
        """Iterate over names and metadata of the nodes of all processes that are not silent."""
        for process, announcement in self._announcements.items():
            if self.silence(process, now) < _FRESH:
                yield from (announcement.nodes or {}).items()

    def ticks(self) -> dict[str, int]:
        """Return the next tick of each node, by full name."""
        return {name: tick for each in self._announcements.values() for name, tick in each.ticks.items()}

    def timer(self) -> TimerAnnouncement | None:
        """Return the announcement of the timer; None if its process is not in the table."""
        return next((each.timer for each in self._announcements.values() if each.timer is not None), None)

    def timer_has_finished(self) -> bool:
        """Return whether the process of the timer has announced that the run is finished."""
        return any(each.timer is not None and each.state == FINISHED for each in self._announcements.values())

    def timer_is_gone(self, timeout: float, now: float) -> bool:
        """Return whether the timer has been silent since it was done: its final announcement was lost."""
        return any(
            each.timer is not None and each.state in (DONE, FINISHED) and self.silence(process, now) > timeout
            for process, each in self._announcements.items()
        )
