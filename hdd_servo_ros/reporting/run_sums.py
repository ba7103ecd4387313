"""What summary and verdict need of a run, summed up from its signals piece by piece."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import CONTROL, ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import NOT_ADAPTED, OPEN_LOOP, transient_end
from hdd_servo_ros.reporting.saturation import Ranges

_HALF_MICROSECOND = 0.5e-6
"""Lets a tick at the very end of the transient count, whatever its last bit [s]."""


class Moments:
    """Count, sums and extremes of a signal."""

    def __init__(self) -> None:
        self.count = 0
        self.lowest, self.highest = math.inf, -math.inf
        self._origin = 0.0
        self._sum = self._squares = 0.0

    def add(self, values: NDArray[np.float64]) -> None:
        """Add samples, shape (n,)."""
        if not len(values):
            return
        if not self.count:
            # The mean of a signal that stands still is then exact.
            self._origin = float(values[0])
        moved = values - self._origin
        self.count += len(values)
        self._sum += float(moved.sum())
        self._squares += float(np.square(moved).sum())
        self.lowest, self.highest = min(self.lowest, float(values.min())), max(self.highest, float(values.max()))

    @property
    def span(self) -> float:
        """Largest less smallest value; 0 if there is none."""
        return self.highest - self.lowest if self.count else 0.0

    def rms_about(self, value: float | None = None) -> float:
        """Return the root mean square about a value, about the mean if None."""
        mean = self._sum / self.count
        variance = max(self._squares / self.count - mean * mean, 0.0)
        return math.sqrt(variance) if value is None else math.hypot(math.sqrt(variance), mean + self._origin - value)


class RunSums:
    """
    Running sums over the signals of a run.

    Feed the pieces of a run in their order to :meth:`add`; none of their rows are kept.

    Parameters
    ----------
    description
        Content of ``run.yaml``, or as much of it as is known: ``controller`` and ``nodes`` with their parameters count.
    transient
        Time before which errors do not count [s].
    """

    def __init__(self, description: Mapping[str, Any], transient: float) -> None:
        self.transient = transient
        self.units = Units()
        self.samples = 0
        self.late_samples = 0
        """Samples after the transient."""
        self.first_tick = self.last_tick = 0
        self.peak_control: float | None = None
        self.peak_error = 0.0
        """Largest error after the transient, in the unit of lengths."""
        self.reference_span = 0.0
        """Largest less smallest desired position of the whole run, the head's first position among them."""
        self.late_reference = Moments()
        """The desired position after the transient."""
        self.first_position = 0.0
        self.saturated: dict[str, tuple[int, int]] = {}
        """For each signal that was clipped: how many of its samples, and the first tick."""
        self.saturated_late: dict[str, int] = {}
        """The same after the transient."""
        self.estimates: dict[str, float] = {}
        """The last values of the estimates that were adapted."""
        self._squared_error = 0.0
        self._error_samples = 0
        self._reference = Moments()
        self._first_estimates: dict[str, float] = {}
        self._follows = description.get('controller') not in OPEN_LOOP
        self._ranges = Ranges.of(description)

    def add(self, signals: Signals) -> None:
        """Add the next rows of the run."""
        if not len(signals.ticks):
            return
        if not self.samples:
            self.units = signals.units
            self.first_tick = int(signals.ticks[0])
        self.samples += len(signals.ticks)
        self.last_tick = int(signals.ticks[-1])
        late = slice(int(np.searchsorted(signals.time, self.transient - _HALF_MICROSECOND)), None)
        self.late_samples += len(signals.time[late])
        if CONTROL.name in signals:
            self.peak_control = max(self.peak_control or 0.0, float(np.abs(signals.command).max()))
        if self._follows and REFERENCE.name in signals and HEAD.name in signals:
            self._add_error(signals, late)
        for name, rows in self._ranges.saturated_rows(signals).items():
            count, first = self.saturated.get(name, (0, int(signals.ticks[rows[0]])))
            self.saturated[name] = count + len(rows), first
            self.saturated_late[name] = self.saturated_late.get(name, 0) + int(np.sum(rows >= late.start))
        if ESTIMATES.name in signals:
            self._add_estimates(signals)

    def _add_error(self, signals: Signals, late: slice) -> None:
        if not self._reference.count:
            self.first_position = float(signals.position[0])
            self._reference.add(signals.position[:1])
        # An error that grows without bound is infinite here, which the verdict knows.
        with np.errstate(over='ignore', invalid='ignore'):
            self._reference.add(signals.desired_position)
            self.late_reference.add(signals.desired_position[late])
            error = signals.error[late]
            self._squared_error += float(np.square(error).sum())
        self._error_samples += len(error)
        self.peak_error = max(self.peak_error, float(np.abs(error).max(initial=0.0)))
        self.reference_span = self._reference.span

    def _add_estimates(self, signals: Signals) -> None:
        for name, values in signals.estimates.items():
            if name in NOT_ADAPTED:
                continue
            first = self._first_estimates.setdefault(name, float(values[0]))
            if name in self.estimates or np.any(values != first):
                self.estimates[name] = float(values[-1])

    @property
    def has_error(self) -> bool:
        """Whether there is a tracking error after the transient."""
        return self._error_samples > 0

    @property
    def rms_error(self) -> float:
        """Root mean square of the error after the transient, in the unit of lengths."""
        return math.sqrt(self._squared_error / self._error_samples)


def sums_of(run: RecordedRun, after: float | None = None) -> RunSums:
    """Return the sums of a recorded run; ``after`` is that of :func:`transient_end`."""
    if run.description.get('last_tick', 0) < 0:
        # It failed at tick 0.
        return RunSums(run.description, 0.0)
    sums = RunSums(run.description, transient_end(run, after))
    sums.add(run)
    return sums
