"""Table: 3 sigma in rotational vibration with a nonlinear (hardening) mount."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import BANDWIDTHS, CONTROLLERS, HARD_MOUNT, TRANSIENT
from hdd_servo_ros.studies.mobile.trials import DURATION, count, median_and_tail
from hdd_servo_ros.studies.mobile.vibration_table import three_sigma
from hdd_servo_ros.studies.output import write_table

SEEDS = 10
NETWORK_RATIO = 0.75
"""Limit of the 3 sigma with the network relative to that of fxlms in the same run."""
CASES = tuple(HARD_MOUNT.values())
_WITHOUT = ('none', 0.0)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with other methods, sensors and seeds, and write one row per controller and sensor."""
    adaptive = tuple((method, bandwidth) for method in ('fxlms', 'network') for bandwidth in BANDWIDTHS)
    found = three_sigma(runs, HARD_MOUNT, (_WITHOUT, *adaptive), SEEDS)
    rows = []
    for controller, name in CONTROLLERS.items():
        without = median_and_tail(found[controller, _WITHOUT])
        for bandwidth in BANDWIDTHS:
            fxlms, network = (found[controller, (method, bandwidth)] for method in ('fxlms', 'network'))
            ratio = median_and_tail(network / fxlms)
            within = count(network <= NETWORK_RATIO * fxlms)
            cells = (median_and_tail(fxlms), median_and_tail(network), ratio, f'<= {NETWORK_RATIO:g}', within)
            rows.append((name, f'{1e-3 * bandwidth:g} kHz', without, *cells))
    header = (
        'controller',
        'sensor',
        'no feedforward [nm]',
        'fxlms [nm]',
        'network [nm]',
        'network / fxlms in the same run',
        'limit',
        'runs within the limit',
    )
    title = (
        'The same vibration with a hardening mount: at twice its rms value, the force is 30 % larger '
        f'(coupling.cubic 0.075, cubic_scale 0.0155 V). 3 sigma of the head position from {TRANSIENT:g} to '
        f'{DURATION:g} s, median / 95th percentile over {SEEDS} seeds and accelerometer gain errors of -12.5 % and '
        '+12.5 %.'
    )
    return write_table(path, title, header, rows)
