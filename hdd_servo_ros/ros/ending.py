"""End of a run, after the last tick or a failure: end together with the other processes."""

import time

from rclpy.duration import Duration

from hdd_servo_ros.messages.outcome import FINISHED, FINISHED_OUTCOME, Outcome
from hdd_servo_ros.ros.announcement import DONE, RUNNING, WAITING
from hdd_servo_ros.ros.member import PERIODS, Member

_FINAL_ANNOUNCEMENTS = 5
_ACKNOWLEDGED_WITHIN = Duration(nanoseconds=300_000_000)
"""Longest wait for the final announcement to arrive; a dead peer never acknowledges it."""


class Ending:
    """
    The end of a run.

    Parameters
    ----------
    member
        This process.
    """

    def __init__(self, member: Member) -> None:
        self._member = member

    def final_changes(self) -> dict[str, int] | None:
        """Return the number of parameter changes of each node; None while another process is still running."""
        member = self._member
        assert member.run is not None
        if not member.others_are(DONE, FINISHED):
            return None
        changes = {node.get_fully_qualified_name(): node.changes for node in member.nodes}
        for process in member.run.processes:
            announcement = member.peers.announcements.get(process)
            if announcement is not None:
                changes.update(announcement.changes)
        return changes

    def announce_done(self) -> bool:
        """Announce that this process is done; return whether the whole run is finished."""
        member = self._member
        if member.state == RUNNING:
            member.state = DONE
            member.announce()
        assert member.run is not None
        if member.timer_node is None:
            peers = member.peers
            return peers.timer_has_finished() or peers.timer_is_gone(member.timeout, time.monotonic())
        return member.others_are(DONE, FINISHED)

    def announce_outcome(self, outcome: Outcome) -> None:
        """Announce the outcome of this process and wait until the others have received it."""
        member = self._member
        if outcome == FINISHED_OUTCOME:
            member.state = FINISHED
        elif member.outcome_of_peer is not None and member.run is not None:
            return  # all processes of the run have received that end
        else:
            member.state = outcome.status
        member.announce(outcome.reason)
        if member.run is None:
            # Some waiting processes may not have discovered this process yet, or the one that failed first.
            for _ in range(_FINAL_ANNOUNCEMENTS):
                time.sleep(PERIODS[WAITING])
                member.announce(outcome.reason)
        member.wait_for_acknowledgments(_ACKNOWLEDGED_WITHIN)
