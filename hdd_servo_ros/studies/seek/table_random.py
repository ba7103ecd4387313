"""Table: random seeks at rest, in vibration, and with the servo sensor and runout; all must arrive."""

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.cases import BASE, BY_SECTORS, IN_VIBRATION
from hdd_servo_ros.studies.seek.trials import Measures, measured, random_seeks

SEEKS = 1000
PIECES = 4
"""Number of runs for the seeks, each with different seeds."""
DWELL = 0.02
"""Time between seeks [s]."""
EDGES = (0.1, 0.5, 1.0, 5.0, 10.0, 50.0, 100.0, 150.1)
"""Edges of the ranges of seek lengths [um]."""
NO_FEEDFORWARD = {'seek_controller:feedforward.method': 'none'}
RUNS: dict[str, tuple[Case, dict[str, object]]] = {
    'at rest': (BASE['final_state'], {}),
    'vibration, fxlms': (IN_VIBRATION, {}),
    'vibration, no feedforward': (IN_VIBRATION, dict(NO_FEEDFORWARD)),
    'servo sensor, NSS disturbances': (BY_SECTORS, {}),
}
"""Recorded run and overrides of each row."""
CASES = (BASE['final_state'], IN_VIBRATION, BY_SECTORS)


def by_run(runs: RecordedRuns, seeks: int) -> dict[str, Measures]:
    """Return the measures of a number of random seeks in each of :data:`RUNS`."""
    due = [
        random_seeks(runs, case, seeks // PIECES, DWELL, seed, changes)
        for case, changes in RUNS.values()
        for seed in range(1, PIECES + 1)
    ]
    found = measured(due, 'random seeks', chunksize=1)
    return dict(zip(RUNS, found.reshape(len(RUNS), -1), strict=True))


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per run and range of lengths."""
    rows = []
    for name, seeks in by_run(runs, SEEKS).items():
        lengths = np.abs(seeks['length'])
        for low, high in [*itertools.pairwise(EDGES), (EDGES[0], EDGES[-1])]:
            part = seeks[(lengths >= low) & (lengths < high)]
            if not len(part):
                continue
            rows.append(
                (
                    name,
                    f'{low:g} to {high:.0f}' if high >= 1.0 else f'{low:g} to {high:g}',
                    len(part),
                    _count(part['time'], len(part)),
                    *(
                        _ms(float(np.quantile(part['time'], share, method='inverted_cdf')))
                        for share in (0.5, 0.95, 1.0)
                    ),
                    _ms(float(part['first_arrival'].max())),
                    f'{1e3 * part["overshoot"].max():.0f}',
                )
            )
    title = (
        f'{SEEKS} random seeks of 0.1 to 150 um, log-uniform, one every {1e3 * DWELL:g} ms, by final-state '
        'control with learning; times into +-100 nm of the track center until the next seek [ms].'
    )
    header = (
        'run',
        'length [um]',
        'seeks',
        'arrived',
        'median',
        '95 %',
        'worst',
        'first arrival, worst',
        'overshoot [nm]',
    )
    return write_table(path, title, header, rows)


def _count(times: NDArray[np.float64], count: int) -> str:
    arrived = int(np.isfinite(times).sum())
    return str(arrived) if arrived == count else f'**{arrived}**'


def _ms(time: float) -> str:
    return 'none' if np.isinf(time) else f'{time:.2f}'
