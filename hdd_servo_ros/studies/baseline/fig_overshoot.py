"""Errors of the best PID controller on sines over the limit of the overshoot."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import (
    AMPLITUDE,
    BEST_PID_SINES,
    LIMIT_FREQUENCIES,
    OVER_FREQUENCY,
    TRANSIENT,
    limit_in_words,
)
from hdd_servo_ros.studies.output import legend_above, new_figure, save

_NN = OVER_FREQUENCY['adaptive NN as shipped']
CASES = (
    *(case for cases in BEST_PID_SINES.values() for case in cases.values()),
    *(_NN[frequency] for frequency in LIMIT_FREQUENCIES),
)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the rms errors over the limit, and those of the adaptive NN controller as lines."""
    figure = new_figure(f'Best PID with Ms ≤ 2 over the limit of its overshoot, sine of {AMPLITUDE:g} µm')
    axes = figure.subplots()
    indices = range(len(BEST_PID_SINES))
    for color, frequency in enumerate(LIMIT_FREQUENCIES):
        cases = [by_frequency[frequency] for by_frequency in BEST_PID_SINES.values()]
        errors = [runs.metrics(case, TRANSIENT, NANOMETRES).rms_error for case in cases]
        axes.semilogy(indices, errors, 'o-', color=f'C{color}', label=f'PID, {frequency:g} Hz')
        own = runs.metrics(_NN[frequency], TRANSIENT, NANOMETRES).rms_error
        axes.axhline(own, color=f'C{color}', linestyle='--', label=f'adaptive NN, {frequency:g} Hz')
    axes.set_xticks(indices, [limit_in_words(limit) for limit in BEST_PID_SINES])
    axes.set_xlabel('limit of the overshoot of steps')
    axes.set_ylabel('rms error [nm]')
    legend_above(axes)
    return save(figure, path)
