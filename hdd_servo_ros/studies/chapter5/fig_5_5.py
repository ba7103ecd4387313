"""Fig. 5.5: hysteresis of the LuGre model with the parameters of section 5.4."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.friction_curves import (
    PRESLIDING_AMPLITUDES,
    PRESLIDING_DURATION,
    PRESLIDING_FREQUENCY,
    SLIDING_AMPLITUDE,
    SLIDING_DURATION,
    SLIDING_FREQUENCY,
    draw_lugre_hysteresis,
)


def _open_loop(name: str, amplitude: float, frequency: float, duration: float) -> Case:
    overrides = {
        'vcm_plant:disturbance.amplitude': 0.0,
        'reference_generator:amplitude': amplitude,
        'reference_generator:frequency': frequency,
        'deterministic_timer:duration': duration,
    }
    return Case(name, 'open_loop', ('simulation_study.yaml',), overrides)


_SLIDING = _open_loop('lugre_sliding', SLIDING_AMPLITUDE, SLIDING_FREQUENCY, SLIDING_DURATION)
_PRESLIDING = {
    amplitude: _open_loop(f'lugre_presliding_{amplitude:g}_n', amplitude, PRESLIDING_FREQUENCY, PRESLIDING_DURATION)
    for amplitude in PRESLIDING_AMPLITUDES
}
CASES = (_SLIDING, *_PRESLIDING.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the friction in sliding and in presliding."""

    def rows(case: Case) -> NDArray[np.float64]:
        return runs[case].head

    presliding = {amplitude: rows(case) for amplitude, case in _PRESLIDING.items()}
    file = path.with_suffix('.png')
    draw_lugre_hysteresis(rows(_SLIDING), presliding).savefig(file, dpi=100)
    return file
