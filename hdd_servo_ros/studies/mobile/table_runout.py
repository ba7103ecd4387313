"""Table: repeatable and non-repeatable error with and without cancellation of runout."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS
from hdd_servo_ros.studies.mobile.runout_cases import (
    CANCELED,
    FIRST,
    NRPE,
    RATES,
    RPE,
    SENSITIVITY,
    method_of,
)
from hdd_servo_ros.studies.mobile.runout_trials import REVOLUTIONS, effect, effect_alone, peak_sensitivities
from hdd_servo_ros.studies.mobile.trials import count, median_and_tail, on_trials, trial
from hdd_servo_ros.studies.output import write_table

SEEDS = 20
DELAYED_SEEDS = 5
"""Number of seeds for the rows with one sample of delay, which have no limits."""
CASES = tuple(CANCELED.values())
_NO_SEQUENCE = 'disturbance_generator:runout.repeatable.sequence'


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with other seeds and methods, and write one row per kind of run."""
    rows = []
    for delay in (0, 1):
        for (sectors, controller), case in CANCELED.items():
            for method in ('repetitive', 'harmonics'):
                changes: dict[str, object] = {
                    method_of(controller): method,
                    f'{controller}_controller:dsp.computation_delay': delay,
                }
                if method == 'harmonics':
                    changes[_NO_SEQUENCE] = 'none'
                seeds = DELAYED_SEEDS if delay else SEEDS
                due = [trial(runs, case, seed, changes) for seed in range(1, seeds + 1)]
                found = on_trials(effect, due, 'runout')
                alone = on_trials(effect_alone, due, 'runout alone')
                without, peak = peak_sensitivities(due[0])
                within = (np.maximum(found[:, 1], alone) <= RPE.high) & (found[:, 2] <= NRPE.high)
                within &= peak <= SENSITIVITY.high
                rows.append(
                    (
                        RATES[sectors],
                        delay,
                        CONTROLLERS[controller],
                        method,
                        *(median_and_tail(column) for column in found.T[:2]),
                        median_and_tail(100.0 * (found[:, 2] - 1.0)),
                        f'{without:.3g}, {peak:.3g}',
                        median_and_tail(alone),
                        '' if delay else count(within),
                        *(median_and_tail(column) for column in found.T[3:]),
                    )
                )
    header = (
        'sampling',
        'delay',
        'controller',
        'method',
        'RPE without [nm]',
        'RPE ratio',
        'NRPE change [%]',
        'peak sensitivity without, with',
        f'runout only: ratio in revolution {FIRST + 1}',
        f'runs within {RPE.high:g} for both ratios, NRPE {100.0 * (NRPE.high - 1.0):.0f} %, '
        f'sensitivity {SENSITIVITY.high:g}',
        f'RPE ratio, learning stopped after {FIRST} revolutions',
        'RPE ratio, ideal mean',
    )
    title = (
        'Runout, flutter, force noise and sensor noise of nss_100ktpi.yaml with runout_cancellation.yaml; RPE peak to '
        f'peak and NRPE 3 sigma of the true track error in revolutions {FIRST + 1} to {REVOLUTIONS}, relative to the '
        f'same run without cancellation; median / 95th percentile over {SEEDS} seeds of all disturbances and of the '
        f'sensor ({DELAYED_SEEDS} with a delay). repetitive: the runout has orders 1 to 3 and a sequence per sector. '
        'harmonics: the runout has only these orders, and the RPE contains only these orders. The controllers are '
        'tuned for no delay.'
    )
    return write_table(path, title, header, rows)
