"""Table: effect of leakage, gain, lattice and position of the network on the error."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN_BY_LAMBDA
from hdd_servo_ros.studies.chapter4.network_cases import (
    GAIN,
    STRONG,
    as_printed,
    compensator,
    network,
    phi_only,
    without,
)
from hdd_servo_ros.studies.output import write_table

ROWS = {
    value: {
        'as in section 4.4': NN_BY_LAMBDA[value],
        'with the compensator': compensator(value, slow=False),
        'sigma_sigma = sigma_m = 0.01 from here on, without network': without(value),
        "... with section 4.4's network": as_printed(value),
        f'... Gamma = {GAIN:g}, sigma_w = {STRONG:g}': network(value, normalized=False),
        '... and inputs normalized': network(value, normalized=True),
        '... and inputs from the reference': network(value, normalized=True, network_input='reference'),
        f'... without network, k_phi = {GAIN:g}, sigma_phi = {STRONG:g}': phi_only(value),
        "... with section 4.4's network and the compensator": compensator(value, slow=True),
    }
    for value in (1.0, 10.0)
}
CASES = tuple(case for rows in ROWS.values() for case in rows.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per lambda and variant."""
    rows = []
    for value, variants in ROWS.items():
        for label, case in variants.items():
            found = runs.metrics(case, LAST_HALF)
            chatter = runs.chatter(case, LAST_HALF)
            errors = (1e3 * found.rms_error, 1e3 * found.max_error)
            rows.append((f'{value:g}', label, *errors, found.peak_control, chatter))
    header = ('lambda [1/s]', 'variant', 'rms error [mm]', 'max error [mm]', 'peak control [N]', 'chatter [N]')
    title = 'Last half of 20 s. Chatter: rms change of the control from sample to sample.'
    return write_table(path, title, header, rows)
