"""Table: seeks with one sample of computation delay, at 26.4 kHz, and with the adaptive NN controller."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.seek_bounds import fastest_seek
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.access_times import median_and_worst
from hdd_servo_ros.studies.seek.cases import AROUND_NN, BASE, DELAYED, FAST, LENGTHS
from hdd_servo_ros.studies.seek.trials import from_rest_and_after_others, measured, of_length, seek_trial

SEEDS = 5
RUNS = {
    '10 kHz': BASE['final_state'],
    '10 kHz, one sample of delay': DELAYED,
    '26.4 kHz': FAST,
    '10 kHz, adaptive NN': AROUND_NN,
}
CASES = tuple(RUNS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per length."""
    seeds = range(1, SEEDS + 1)
    due = [
        seek_trial(runs, case, from_rest_and_after_others(length), seed)
        for case in CASES
        for length in LENGTHS
        for seed in seeds
    ]
    found = measured(due, 'other runs').reshape(len(CASES), len(LENGTHS), -1)
    plant, rows = PlantParameters(), []
    for column, length in enumerate(LENGTHS):
        cells = [f'{length:g}']
        for row, case in enumerate(CASES):
            seeks = of_length(found[row, column], length)
            bound = 1e3 * fastest_seek(plant, runs[case].sample_time, length).time
            cells += [
                median_and_worst(seeks['time']),
                median_and_worst(seeks['narrow_time']),
                f'{1e3 * np.max(seeks["overshoot"]):.0f}',
                f'{bound:.2f}',
            ]
        rows.append(cells)
    title = (
        f'Final-state control, nominal drive, {SEEDS} seeds: median / worst time into +-100 nm and into +-25 nm [ms], '
        'overshoot [nm], and LP without delay [ms]. With delay, the PID gains are tuned for it.'
    )
    header = ['length [um]']
    for name in RUNS:
        header += [f'{name}: +-100 nm', '+-25 nm', 'overshoot', 'LP']
    return write_table(path, title, header, rows)
