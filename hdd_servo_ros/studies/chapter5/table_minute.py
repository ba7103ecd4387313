"""Table: the adaptive NN controller as shipped over a minute, and both PID controllers over 10 s."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import rms
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import FREQUENCIES, PID, PID_FOR_SINES, SHIPPED_MINUTE
from hdd_servo_ros.studies.chapter5.measures import error
from hdd_servo_ros.studies.output import write_table

_RUNS = {
    'adaptive NN as shipped': SHIPPED_MINUTE,
    'PID, at most 20 % overshoot': PID,
    'PID for sines': PID_FOR_SINES,
}
"""PID does not adapt, so that its errors do not change after 10 s."""
CASES = tuple(case for cases in _RUNS.values() for case in cases.values())
_SECONDS = (1, 2, 5, 10, 20, 40, 60)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write the errors in single seconds, one row per frequency and controller."""
    rows = []
    for frequency in FREQUENCIES:
        for name, cases in _RUNS.items():
            run = runs[cases[frequency]]
            e = error(run)
            rows.append((f'{frequency:g}', name, *(_of_second(end, run.time, e) for end in _SECONDS)))
    header = ('frequency [Hz]', 'controller', *(f'second {second}' for second in _SECONDS))
    title = 'Sine of 2 um: rms error in single seconds [nm]; PID for 10 s.'
    return write_table(path, title, header, rows)


def _of_second(end: int, time: NDArray[np.float64], e: NDArray[np.float64]) -> float | str:
    """Return the rms error of the second that ends at ``end``; a dash if the run ends before."""
    chosen = e[(time >= end - 1.0) & (time < end)]
    return rms(chosen) if time[-1] > end - 1e-6 else '-'
