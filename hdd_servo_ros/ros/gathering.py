"""Start of a run: wait until all processes are ready, then start together."""

import time

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.run_parameters import PeerParameters, TimerParameters
from hdd_servo_ros.ros.announcement import READY, RUNNING, WAITING
from hdd_servo_ros.ros.discovery import Discovery
from hdd_servo_ros.ros.member import PERIODS, Member
from hdd_servo_ros.ros.run_plan import RunPlan, make_run_plan

_LOG_PERIOD = 3.0
"""Wall time between two log lines on the same missing nodes [s]."""
_LOG_PERIOD_OF_CHANGES = 1.0
"""The same if the missing nodes have changed [s]."""
_NAMED = 4
"""Largest number of missing nodes and topics named in a log line."""


class Gathering:
    """
    The start of a run.

    Parameters
    ----------
    member
        This process.
    """

    def __init__(self, member: Member) -> None:
        self._member = member
        self._discovery = Discovery(member)
        timeouts = [node.parameters[PeerParameters].start_timeout for node in member.nodes]
        self._timeout = 0.0 if 0.0 in timeouts else max(timeouts)
        self._missing: list[str] = []
        self._logged: list[str] = []
        self._logged_at = time.monotonic()

    def gather(self) -> bool:
        """
        Continue to discover the other processes; return whether the run has started.

        Raises
        ------
        RunError
            If the run cannot start: parameters do not match, a topic has two publishers, a peer failed or is missing.
        """
        member = self._member
        now = time.monotonic()
        if member.outcome_of_peer is not None:
            raise RunError(member.outcome_of_peer.reason)
        if member.run is None:
            member.peers.remove_silent(member.timeout, now)
            self._wait_or_start(now)
            return False
        member.announce_when_due(now, PERIODS[READY])
        # A node that has begun already receives messages; only the timer must wait until all others have begun.
        return member.timer_node is None or self._others_have_begun(member.run, now)

    def _others_have_begun(self, run: RunPlan, now: float) -> bool:
        member = self._member
        for process in run.processes:
            if process != member.identifier and member.peers.silence(process, now) > member.timeout:
                raise RunError(f'lost a peer before tick 0: process {process}; it ran one of {", ".join(run.nodes)}')
        return member.others_are(RUNNING)

    def _wait_or_start(self, now: float) -> None:
        member = self._member
        self._missing = list(self._discovery.missing(now))
        state = WAITING if self._missing else READY
        if state != member.state:
            member.state = state
            member.announce()
        else:
            member.announce_when_due(now, PERIODS[state])
        if member.timer_node is not None and state == READY and member.others_are(READY):
            member.start(self._make_run(now))
        elif self._timeout and now - member.peers.changed_at > self._timeout:
            raise RunError(
                f'timed out after {self._timeout:g} s (start_timeout) waiting for '
                f'{_short(self._missing) or self._unready_names()}; start the missing nodes, or increase start_timeout'
            )
        else:
            self._log_missing(now)

    def _make_run(self, now: float) -> RunPlan:
        member = self._member
        assert member.timer_node is not None
        try:
            return make_run_plan(
                member.timer_node.get_fully_qualified_name(),
                member.timer_node.parameters[TimerParameters],
                dict(member.known_nodes(now)),
                [member.identifier, *member.peers.announcements],
            )
        except ParameterError as error:
            raise RunError(str(error)) from None

    def _unready_names(self) -> str:
        announcements = self._member.peers.announcements.values()
        unready = [name for each in announcements if each.state != READY for name in each.nodes or ()]
        return ', '.join(unready) + ' to get ready' if unready else 'deterministic_timer to start the run'

    def _log_missing(self, now: float) -> None:
        period = _LOG_PERIOD_OF_CHANGES if self._missing != self._logged else _LOG_PERIOD
        if self._missing and now - self._logged_at > period:
            self._member.nodes[0].get_logger().info(f'waiting for {_short(self._missing)}')
            self._logged, self._logged_at = self._missing, now


def _short(missing: list[str]) -> str:
    """Return the missing items as one short line, each once and only the first few."""
    each = list(dict.fromkeys(missing))
    more = f'; and {len(each) - _NAMED} more' if len(each) > _NAMED else ''
    return '; '.join(each[:_NAMED]) + more
