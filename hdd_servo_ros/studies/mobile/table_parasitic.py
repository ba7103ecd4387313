"""Table: error ratio with / without feedforward for parasitic coupling from the actuator to the accelerometers."""

import dataclasses
from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import BANDWIDTHS, CONTROLLERS, IN_VIBRATION, TRANSIENT, method_of
from hdd_servo_ros.studies.mobile.trials import Trial, on_trials, trial
from hdd_servo_ros.studies.output import write_table

SEED = 1
DURATION = 5.0
"""Duration of a run [s]: the weights may take seconds to destabilize a coupled loop."""
SHARES = (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)
"""Coupled loop gains: parasitic coupling relative to ``UNIT_COUPLING``."""
UNIT_COUPLING = 40.3
"""Parasitic acceleration per volt at which the coupled loop gain is 1: lever times gain over arm radius [m/s^2/V]."""
LARGEST_RATIO = 1.05
"""Limit of the error with feedforward relative to that without it."""
COUPLED = ('fixed', 'fxlms', 'network')
"""Tested methods of feedforward."""
_BASE = {controller: cases['fxlms'] for controller, cases in IN_VIBRATION.items()}
CASES = tuple(_BASE.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with couplings, methods and sensors, and write one row per method."""
    references = [(controller, vibrates) for controller in CONTROLLERS for vibrates in (True, False)]
    rows = [(*reference, method, bw) for reference in references for method in COUPLED for bw in BANDWIDTHS]
    due = [_coupled(runs, *reference, 'none', 1000.0, 0.0) for reference in references]
    due += [_coupled(runs, *row, share) for row in rows for share in SHARES]
    off, on = np.split(on_trials(_measure, due, 'parasitic coupling'), [len(references)])
    without = dict(zip(references, off, strict=True))
    table = []
    for row, part in zip(rows, on.reshape(len(rows), len(SHARES), 2), strict=True):
        controller, vibrates, method, bandwidth = row
        ratios = part[:, 0] / without[controller, vibrates][0]
        table.append(
            (
                CONTROLLERS[controller],
                'vibration' if vibrates else 'none',
                method,
                f'{1e-3 * bandwidth:g} kHz',
                *(f'{ratio:.2f}' if ratio <= LARGEST_RATIO else f'**{ratio:.2f}**' for ratio in ratios),
                f'{without[controller, vibrates][1]:.0f} / {part[:, 1].max():.0f}',
            )
        )
    header = (
        'controller',
        'disturbance',
        'feedforward',
        'sensor',
        *(f'{share:+g}' for share in SHARES),
        'largest error without / with feedforward [nm]',
    )
    title = (
        f'3 sigma of the head position from {TRANSIENT:g} to {DURATION:g} s, ratio with / without feedforward, by '
        'parasitic coupling (as the coupled loop gain). '
        f'**Bold**: above {LARGEST_RATIO:g}. Largest error: from 0 s on, over all couplings.'
    )
    return write_table(path, title, header, table)


def _coupled(runs: RecordedRuns, controller: str, vibrates: bool, method: str, bandwidth: float, share: float) -> Trial:
    changes = {
        method_of(controller): method,
        'disturbance_generator:vibration.rotational.enabled': vibrates,
        'accelerometer:bandwidth': bandwidth,
        'accelerometer:parasitic_gain': share * UNIT_COUPLING,
    }
    return dataclasses.replace(trial(runs, _BASE[controller], SEED, changes), duration=DURATION, transient=0.0)


def _measure(coupled: Trial) -> tuple[float, float]:
    """Return 3 sigma after the transient, and the largest error of the entire run [nm]."""
    error = coupled.error()
    late = round(TRANSIENT / coupled.sample_time)
    return 3.0 * float(error[late:].std()), float(np.abs(error).max())
