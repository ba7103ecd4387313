"""Table: adaptive NN controller with single terms disabled."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN, adaptive_nn
from hdd_servo_ros.studies.output import write_table

ABLATION = {
    'full': NN,
    'without network': adaptive_nn('without_network', network__enabled=False),
    'without phi_hat': adaptive_nn('without_phi', phi__enabled=False),
    'without both': adaptive_nn('without_network_and_phi', network__enabled=False, phi__enabled=False),
    'without sigma_hat': adaptive_nn('without_sigma', sigma__enabled=False),
    'without m_hat': adaptive_nn('without_mass', mass__enabled=False),
    'only -k r': adaptive_nn(
        'feedback_only', network__enabled=False, phi__enabled=False, sigma__enabled=False, mass__enabled=False
    ),
    'adaptive widths': adaptive_nn('adaptive_widths', width__enabled=True),
}
CASES = tuple(ABLATION.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per variant."""
    full = runs.metrics(NN, LAST_HALF).rms_error
    rows = []
    for label, case in ABLATION.items():
        found = runs.metrics(case, LAST_HALF)
        rows.append((label, 1e3 * found.rms_error, 1e3 * found.max_error, found.rms_error / full, found.peak_control))
    header = ('variant', 'rms error [mm]', 'max error [mm]', 'rms error / full', 'peak control [N]')
    return write_table(path, 'Last half of 20 s, lambda = 1 1/s.', header, rows)
