"""Table: effect of lambda on the sine and on steps, with fixed k."""

from pathlib import Path

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.analysis.metrics import NANOMETRES, rms
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.studies.chapter5.cases import LAMBDA_INTEGRAL_STEPS, LAMBDA_SINES, LAMBDA_STEPS, TRANSIENT
from hdd_servo_ros.studies.chapter5.measures import START, edges, error, error_after_edges
from hdd_servo_ros.studies.output import write_table

CASES = (*LAMBDA_SINES.values(), *LAMBDA_STEPS.values(), *LAMBDA_INTEGRAL_STEPS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per lambda."""
    rows = []
    for value in LAMBDA_SINES:
        sine, step = runs[LAMBDA_SINES[value]], runs[LAMBDA_STEPS[value]]
        found = runs.metrics(LAMBDA_SINES[value], TRANSIENT, NANOMETRES)
        with_integral = edges(runs[LAMBDA_INTEGRAL_STEPS[value]]).worst()
        rows.append(
            (
                f'{value:g}',
                peak_sensitivity(runs, LAMBDA_SINES[value]),
                rms(error(sine)[sine.time < START]),
                found.rms_error,
                rms(sine.command[sine.time < START]),
                error_after_edges(step),
                NANOMETRES * edges(step).median()['steady_error'],
                runs.metrics(LAMBDA_STEPS[value], 0.0).peak_control,
                with_integral['overshoot'],
                NANOMETRES * with_integral['steady_error'],
            )
        )
    header = (
        'lambda [1/s]',
        'Ms',
        'sine: rms error, first 50 ms [nm]',
        'rms error, 2 to 10 s [nm]',
        'rms control, first 50 ms [V]',
        'steps: rms error, 5 ms after edges [nm]',
        'median steady error [nm]',
        'peak control [V]',
        'with integral: worst overshoot [%]',
        'worst steady error [nm]',
    )
    title = 'Sine of 2 um at 100 Hz and steps of 5 um, k and all adaptation constants as tuned for 595 1/s.'
    return write_table(path, title, header, rows)


def peak_sensitivity(runs: RecordedRuns, case: Case) -> float:
    """Return Ms of the adapted loop -g r of a run, with g = k + 1/sigma_phi + max(S'S)/sigma_w."""
    nodes, sample_time = runs.parameters(case), runs[case].sample_time
    plant, law = (block_parameters(name, nodes[name]) for name in ('vcm_plant', 'adaptive_nn_controller'))
    return fragility.peak_sensitivity(AdaptiveNn(law, sample_time), plant)
