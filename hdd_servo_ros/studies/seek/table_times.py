"""Table: seek times of final-state control on the nominal drive and on varied drives."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.seek_bounds import fastest_seek, time_optimal_seek
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.cases import (
    BASE,
    LENGTHS,
    NARROW_LIMITS,
    NOMINAL_GOALS,
    NOMINAL_LIMITS,
    OVERSHOOT_LIMITS,
    ROBUST_LIMITS,
)
from hdd_servo_ros.studies.seek.trials import (
    VARIED,
    Measures,
    drawn_drive,
    from_rest_and_after_others,
    measured,
    of_length,
    seek_trial,
)

SEEDS = 20
"""Number of seeds with the nominal drive."""
DRIVES = 40
"""Number of random drives between the corners."""
CASES = (BASE['final_state'],)
KINDS = ('nominal', 'corners', 'drawn')


def by_kind(
    runs: RecordedRuns, lengths: tuple[float, ...], seeds: int, drives: int
) -> Mapping[tuple[str, float], Measures]:
    """Return the measures of the seeks, by kind of drive and seek length."""
    case = BASE['final_state']
    changes: list[tuple[str, int, dict[str, object]]] = [('nominal', seed, {}) for seed in range(1, seeds + 1)]
    changes += [('corners', seed, corner) for seed, corner in enumerate(VARIED, 1)]
    changes += [('drawn', seed, drawn_drive(seed)) for seed in range(1, drives + 1)]
    keys = [(kind, length) for length in lengths for kind, _, _ in changes]
    due = [
        seek_trial(runs, case, from_rest_and_after_others(length), seed, change)
        for length in lengths
        for _, seed, change in changes
    ]
    found = measured(due, 'seeks')
    return {
        (kind, length): np.concatenate(
            [of_length(found[row], length) for row, key in enumerate(keys) if key == (kind, length)]
        )
        for kind in KINDS
        for length in lengths
    }


def limit_of(kind: str, length: float) -> float:
    """Return the limit of the seek time [ms]."""
    return NOMINAL_LIMITS[length] if kind == 'nominal' else ROBUST_LIMITS[length]


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per kind of drive and length."""
    plant, rows = PlantParameters(), []
    found = by_kind(runs, LENGTHS, SEEDS, DRIVES)
    for kind in KINDS:
        for length in LENGTHS:
            seeks = found[kind, length]
            worst, limit = float(seeks['time'].max()), limit_of(kind, length)
            optimal = 1e3 * time_optimal_seek(plant, length).time
            fastest = 1e3 * fastest_seek(plant, runs[CASES[0]].sample_time, length).time
            over = float(seeks['overshoot'].max())
            allowed = OVERSHOOT_LIMITS['nominal' if kind == 'nominal' else 'varied']
            narrow = NARROW_LIMITS.get(length, (float('nan'),))[0] if kind == 'nominal' else float('nan')
            rows.append(
                (
                    kind,
                    f'{length:g}',
                    len(seeks),
                    f'{np.median(seeks["time"]):.2f} / {worst:.2f}',
                    f'{limit:g}' + (f' ({NOMINAL_GOALS[length]:g})' if kind == 'nominal' else ''),
                    'met' if worst <= limit + 1e-9 else '**not met**',
                    f'{1e3 * over:.0f}' + ('' if over <= allowed else ' **not met**'),
                    f'{np.median(seeks["narrow_time"]):.2f} / {seeks["narrow_time"].max():.2f}',
                    '' if np.isnan(narrow) else f'{narrow:g}',
                    f'{optimal:.2f}, {fastest:.2f}',
                    f'{worst / optimal:.2f}, {worst / fastest:.2f}',
                )
            )
    title = (
        'Seeks by final-state control, 10 kHz, no computation delay, noise on; median / worst time [ms] of all seeks '
        f'in both directions, from rest and after other seeks. nominal: {SEEDS} seeds; corners: friction +-20 %, gain '
        f'+-5 %, modes +-5 %, all eight; drawn: {DRIVES} random drives between them; learning from the first seek on. '
        'Limit: of the time into +-100 nm for four samples (goal in parentheses).'
    )
    header = (
        'drive',
        'length [um]',
        'seeks',
        'into +-100 nm',
        'limit',
        '',
        'overshoot [nm]',
        'into +-25 nm',
        'limit',
        'T*, LP [ms]',
        'worst / T*, LP',
    )
    return write_table(path, title, header, rows)
