"""Running sums over a run for its summary and verdict, computed block by block."""

import math
import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND
from hdd_servo_ros.messages.topics import CONTROL, ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.numerics.moments import Moments, mark_changes
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import NOT_ADAPTED, transient_end
from hdd_servo_ros.reporting.saturation import Ranges


class RunSums:
    """
    Running sums over the signals of a run.

    Pass the blocks of a run in order to :meth:`add`; their rows are not stored.

    Parameters
    ----------
    description
        Content of ``run.yaml``, or its known part; ``controller`` and ``nodes`` with their parameters are used.
    transient
        End of the transient [s].
    """

    def __init__(self, description: Mapping[str, Any], transient: float) -> None:
        self.transient = transient
        self.units = Units()
        self.samples = 0
        self.late_samples = 0
        """Number of samples after the transient."""
        self.first_tick = self.last_tick = 0
        self.control = Moments(0.0)
        """The command of the whole run."""
        self.is_track_following = False
        """Whether the error is the track error, since the servo sensor reads positions relative to the track."""
        self.error = Moments(0.0)
        """The position error after the transient, in the unit of lengths."""
        self.late_reference = Moments()
        """The desired position after the transient."""
        self.early_reference = Moments()
        """The desired position before the end of the transient."""
        self.first_position = 0.0
        self.saturated: dict[str, tuple[int, int]] = {}
        """Number of clipped samples and first tick, by signal."""
        self.saturated_late: dict[str, int] = {}
        """The same after the end of the transient."""
        self._estimate_names: tuple[str, ...] = ()
        self._first_estimates = self._last_estimates = np.empty(0)
        self._adapted = np.empty(0, dtype=np.bool_)
        self._follows = catalog.follows_reference(description.get('controller'))
        self._ranges = Ranges.of(description)

    def add(self, signals: Signals) -> None:
        """Add the next rows of the run."""
        if not len(signals.ticks):
            return
        if not self.samples:
            self.units = signals.units
            self.first_tick = int(signals.ticks[0])
            self.is_track_following = signals.is_track_following
        self.samples += len(signals.ticks)
        self.last_tick = int(signals.ticks[-1])
        first_late_tick = math.ceil((self.transient - HALF_MICROSECOND) / signals.sample_time)
        start = int(np.searchsorted(signals.ticks, first_late_tick))
        self.late_samples += len(signals.ticks) - start
        if CONTROL.name in signals:
            self.control.add(signals.command)
        if self._follows and REFERENCE.name in signals and HEAD.name in signals:
            self._add_error(signals, start)
        for name, rows in self._ranges.saturated_rows(signals).items():
            count, first = self.saturated.get(name, (0, int(signals.ticks[rows[0]])))
            self.saturated[name] = count + len(rows), first
            self.saturated_late[name] = self.saturated_late.get(name, 0) + int(np.sum(rows >= start))
        if ESTIMATES.name in signals:
            self._add_estimates(signals)

    def _add_error(self, signals: Signals, start: int) -> None:
        x_d = signals.desired_position
        if not self.early_reference.count and not self.late_reference.count:
            self.first_position = float(signals.position[0])
        self.early_reference.add(x_d[:start])
        self.late_reference.add(x_d[start:])
        self.error.add(signals.position_error[start:])

    def _add_estimates(self, signals: Signals) -> None:
        rows = signals[ESTIMATES.name]
        if self._estimate_names != signals.estimate_names:
            self._estimate_names = signals.estimate_names
            self._first_estimates = rows[0].copy()
            self._adapted = np.array([name in NOT_ADAPTED for name in self._estimate_names], dtype=np.bool_)
        self._last_estimates = rows[-1].copy()
        mark_changes(np.ascontiguousarray(rows), self._first_estimates, self._adapted)

    @property
    def estimates(self) -> dict[str, float]:
        """Final values of the adapted estimates, by name."""
        columns = zip(self._estimate_names, self._last_estimates.tolist(), self._adapted.tolist(), strict=True)
        return {name: value for name, value, adapted in columns if adapted and name not in NOT_ADAPTED}

    @property
    def reference_span(self) -> float:
        """Range of the desired position over the whole run, including the first head position."""
        parts = (self.early_reference, self.late_reference)
        highest = max(self.first_position, *(part.highest for part in parts))
        return highest - min(self.first_position, *(part.lowest for part in parts))

    @property
    def has_error(self) -> bool:
        """Whether the run has a position error after the transient."""
        return self.error.count > 0

    @property
    def rms_error(self) -> float:
        """Rms error after the transient, in the unit of lengths; nan if it is infinite."""
        return self.error.rms_about(0.0)

    @property
    def peak_error(self) -> float:
        """Peak error after the transient, in the unit of lengths."""
        return self.error.largest


_FOUND: weakref.WeakKeyDictionary[RecordedRun, dict[float | None, RunSums]] = weakref.WeakKeyDictionary()


def sums_of(run: RecordedRun, after: float | None = None) -> RunSums:
    """Return the sums of a recorded run, computed once; for ``after`` see :func:`transient_end`."""
    found = _FOUND.setdefault(run, {})
    if after not in found:
        found[after] = _sum_up(run, after)
    return found[after]


def keep_sums(run: RecordedRun, after: float | None, sums: RunSums) -> None:
    """Cache the sums of a run for :func:`sums_of`."""
    _FOUND.setdefault(run, {}).setdefault(after, sums)


def new_sums(run: RecordedRun, after: float | None) -> RunSums:
    """Return empty sums for a recorded run with at least one tick."""
    return RunSums(run.description, transient_end(run, after))


def _sum_up(run: RecordedRun, after: float | None) -> RunSums:
    if run.description.get('last_tick', 0) < 0:
        # The run failed at tick 0.
        return RunSums(run.description, 0.0)
    sums = new_sums(run, after)
    for piece in run.pieces():
        sums.add(piece)
    return sums
