"""Table: PTOS and CNF compared with final-state control and the time-optimal seek."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.seek_bounds import time_optimal_seek
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.access_times import access_measures, median_and_worst
from hdd_servo_ros.studies.seek.cases import BASE, METHODS, PID

LENGTHS = (1.0, 5.0, 10.0, 20.0, 50.0, 100.0, 150.0, 1000.0)
"""Seek lengths [um]."""
SEEDS = 20
CASES = (*BASE.values(), PID)
PTOS_LIMITS = {100.0: 2.5, 150.0: 2.5, 1000.0: 1.7}
"""Limits of the worst PTOS time relative to T*, by length."""
CNF_LIMIT = 0.8
"""Limit of the CNF time relative to that of PTOS, median and worst."""


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per length."""
    found = access_measures(runs, tuple(METHODS), LENGTHS, SEEDS)
    plant, rows = PlantParameters(), []
    for length in LENGTHS:
        by_method = {method: found[method, length] for method in METHODS}
        ptos, cnf = by_method['ptos'], by_method['cnf']
        over_optimal = float(ptos['time'].max()) / (1e3 * time_optimal_seek(plant, length).time)
        limit = PTOS_LIMITS.get(length)
        verdict = '' if limit is None else f'{limit:g}: ' + ('met' if over_optimal <= limit else '**not met**')
        ratios = [float(np.median(cnf[name]) / np.median(ptos[name])) for name in ('time', 'settling')]
        worst = float(cnf['time'].max() / ptos['time'].max())
        rows.append(
            (
                f'{length:g}',
                *(median_and_worst(by_method[method]['time']) for method in METHODS),
                f'{over_optimal:.2f}',
                verdict,
                *(median_and_worst(each['settling']) for each in (ptos, cnf)),
                f'{ratios[0]:.2f}, {worst:.2f}',
                f'{ratios[1]:.2f}',
                'met' if max(ratios[0], worst) <= CNF_LIMIT else '**not met**',
                *(f'{1e3 * each["overshoot"].max():.0f}' for each in (ptos, cnf)),
            )
        )
    title = (
        f'Seeks back and forth on the nominal drive, {SEEDS} seeds of six: median / worst time into +-100 nm [ms]. '
        'Settling: from the first sample within +-2 um to the arrival; the entire seek time for seeks up to 2 um. '
        'Limit for CNF: 0.8 of the time of PTOS, for the median and the worst time.'
    )
    header = (
        'length [um]',
        *METHODS.values(),
        'worst PTOS / T*',
        'limit',
        'settling, PTOS',
        'settling, CNF',
        'CNF / PTOS: median, worst',
        'CNF / PTOS: settling',
        'limit',
        'overshoot, PTOS [nm]',
        'overshoot, CNF [nm]',
    )
    return write_table(path, title, header, rows)
