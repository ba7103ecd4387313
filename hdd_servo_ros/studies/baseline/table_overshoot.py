"""Table: the best PID controller for each limit of the overshoot."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES, step_response
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import (
    AMPLITUDE,
    BEST_PID_SINES,
    BEST_PID_STEPS,
    BEST_PIDS,
    DURATION,
    HEIGHTS,
    LIMIT_FREQUENCIES,
    TRANSIENT,
    limit_in_words,
)
from hdd_servo_ros.studies.output import write_table

CASES = tuple(case for cases in (BEST_PID_SINES, BEST_PID_STEPS) for own in cases.values() for case in own.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per limit."""
    rows = []
    for limit, gains in BEST_PIDS.items():
        steps = [_step(runs, limit, height) for height in HEIGHTS]
        errors = (runs.metrics(BEST_PID_SINES[limit][f], TRANSIENT, NANOMETRES).rms_error for f in LIMIT_FREQUENCIES)
        overshoot = max(step['overshoot'] for step in steps)
        settling = 1e3 * steps[-1]['settling_time']
        rows.append((limit_in_words(limit), *(f'{gain:g}' for gain in gains), *errors, overshoot, settling))
    header = (
        'limit of the overshoot',
        'k_p [V/um]',
        'k_i [V/(um s)]',
        'k_d [V s/um]',
        'filter [Hz]',
        *(f'rms error at {f:g} Hz [nm]' for f in LIMIT_FREQUENCIES),
        'overshoot [%]',
        f'2 % settling, {HEIGHTS[-1]:g} um [ms]',
    )
    title = (
        f'Sine of {AMPLITUDE:g} um, {TRANSIENT:g} to {DURATION:g} s. Overshoot: the larger one of single steps from '
        f'rest of {" and ".join(f"{height:g}" for height in HEIGHTS)} um. Ms <= 2 in all rows.'
    )
    return write_table(path, title, header, rows)


def _step(runs: RecordedRuns, limit: float, height: float) -> dict[str, float]:
    run = runs[BEST_PID_STEPS[limit][height]]
    return step_response(run.time, run.desired_position, run.position).worst()
