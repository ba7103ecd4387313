"""Table: gains of section 5.5, as printed and as magnitudes."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.metrics import rms
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.measures import error
from hdd_servo_ros.studies.chapter5.thesis_gains_cases import READINGS
from hdd_servo_ros.studies.output import write_table

_DIVERGED = 1e5
"""A run with a larger error diverged [nm]: 100 µm, outside the 80 µm range of the vibrometer."""
CASES = tuple(case for cases in READINGS.values() for case in cases)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per run."""
    rows = []
    for name, cases in READINGS.items():
        for case in cases:
            run = runs[case]
            e = error(run)
            beyond = np.flatnonzero(np.abs(e) > _DIVERGED)
            last = rms(e[run.time >= run.time[-1] - 1.0])
            outcome = f'diverged after {run.time[beyond[0]]:.2g} s' if len(beyond) else last
            reference = case.overrides['reference_generator:waveform']
            frequency = case.overrides['reference_generator:frequency']
            height = 'sine of 2 um' if reference == 'sine' else 'steps of 1 um'
            rows.append((name, f'{height}, {frequency:g} Hz', outcome, float(np.abs(run.command).max())))
    header = ('reading', 'reference', 'rms error in the last second [nm]', 'peak control [V]')
    return write_table(path, 'Gains of section 5.5 in um, s and V; runs of 10 s.', header, rows)
