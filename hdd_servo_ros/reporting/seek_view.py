"""Seeks in time plots: target, mode of the controller, and position error on two scales."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.seek_metrics import SEEK, SETTLE, targets_over_time
from hdd_servo_ros.messages.signals import TimedSignals
from hdd_servo_ros.messages.topics import ESTIMATES
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import SEEK_MODE, SEEK_TARGET
from hdd_servo_ros.reporting.panel import Shade
from hdd_servo_ros.reporting.seeks_of_run import modes_of, seeks_of

Array = NDArray[np.float64]

COARSE, FINE = 1.0, 0.1
"""Half widths of the two scales of the position error [um]."""
_SHADES = ((SEEK, 'mode: seek', '#ffc77d'), (SETTLE, 'mode: settle', '#a9dba9'))
"""Shaded modes; follow is not shaded."""


@dataclasses.dataclass(frozen=True)
class SeekView:
    """
    Target [um], shape (n,), and mode of the controller at each row, None if it is unknown.

    The modes are 0 follow, 1 seek, 2 settle.
    """

    target: Array
    mode: Array | None = None

    def shades(self, time: Array) -> tuple[Shade, ...]:
        """Return the intervals in which the controller was seeking and settling, for rows at given times [s]."""
        if self.mode is None or not len(time):
            return ()
        found = []
        for mode, name, color in _SHADES:
            edges = np.diff(np.concatenate([[0], self.mode == mode, [0]]).astype(np.int8))
            starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
            if len(starts):
                # The mode of a row lasts until the next row.
                intervals = np.column_stack([time[starts], time[np.minimum(ends, len(time) - 1)]])
                found.append(Shade(name, intervals, color))
        return tuple(found)


def view_of_run(run: RecordedRun) -> SeekView | None:
    """Return the view of the seeks of a run; None without seeks, or for a drive that is not in um."""
    seeks = seeks_of(run)
    if not seeks or run.length_unit != 'um':
        return None
    return SeekView(targets_over_time(seeks, seeks[0].origin, len(run.ticks)), modes_of(run))


def view_of_estimates(signals: TimedSignals) -> SeekView | None:
    """Return the view from the estimates of a controller; None if it does not seek in these rows."""
    if ESTIMATES.name not in signals or signals.units.length != 'um':
        return None
    names = signals.estimate_names
    if SEEK_MODE not in names or SEEK_TARGET not in names or not signals.estimates[SEEK_MODE].any():
        return None
    return SeekView(signals.estimates[SEEK_TARGET], signals.estimates[SEEK_MODE])
