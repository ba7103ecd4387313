"""Table: seek times into +-25 nm without friction feedforward, with it, and after learning."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.access_times import median_and_worst
from hdd_servo_ros.studies.seek.cases import (
    FRICTIONS,
    LEARNED,
    LEARNED_AFTER,
    LEARNING_LENGTHS,
    NARROW_LIMITS,
    NO_FRICTION,
    UNLEARNED,
    to_and_fro,
)
from hdd_servo_ros.studies.seek.trials import measured, seek_trial

SEEDS = 10
SEEKS = 30
"""Number of seeks in each run."""
CASES = (*NO_FRICTION.values(), *UNLEARNED.values(), *LEARNED.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per length and friction."""
    seeds = range(1, SEEDS + 1)
    columns: list[tuple[float, float | None, Case]] = []
    for length in LEARNING_LENGTHS:
        columns.append((length, None, NO_FRICTION[length]))
        columns += [
            (length, friction, cases[length, friction]) for friction in FRICTIONS for cases in (UNLEARNED, LEARNED)
        ]
    due = [seek_trial(runs, case, to_and_fro(length, SEEKS), seed) for length, _, case in columns for seed in seeds]
    found = measured(due, 'learning').reshape(len(columns), SEEDS, SEEKS)['narrow_time']
    times = {(length, friction, case.name): found[row] for row, (length, friction, case) in enumerate(columns)}
    rows = []
    for length in LEARNING_LENGTHS:
        plain = times[length, None, NO_FRICTION[length].name]
        rows.append((f'{length:g}', 'any', 'no', median_and_worst(plain), '', '', ''))
        for friction in FRICTIONS:
            fixed = times[length, friction, UNLEARNED[length, friction].name]
            learned = times[length, friction, LEARNED[length, friction].name]
            late = learned[:, LEARNED_AFTER:]
            limit = NARROW_LIMITS[length][0 if friction == 1.0 else 1]
            verdict = f'{limit:g}: ' + ('met' if late.max() <= limit + 1e-9 else '**not met**')
            first = f'{np.median(learned[:, 0]):.2f}'
            rows.append(
                (f'{length:g}', f'{friction:g}', 'yes', median_and_worst(fixed), first, median_and_worst(late), verdict)
            )
    title = (
        f'Times into +-25 nm by final-state control, {SEEDS} seeds of {SEEKS} seeks back and forth, median / worst '
        '[ms]. Friction: drive / model. Feedforward with the friction of the model, and with the learned friction.'
    )
    header = (
        'length [um]',
        'friction',
        'feedforward',
        'not learned',
        'learning, first seek',
        f'learning, after {LEARNED_AFTER} seeks',
        'limit',
    )
    return write_table(path, title, header, rows)
