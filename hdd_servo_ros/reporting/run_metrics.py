"""The metrics of a recorded run."""

from collections.abc import Collection

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.reference_period import follows_sine, reference_period, whole_periods
from hdd_servo_ros.reporting.run_impacts import run_impacts, why_no_impacts
from hdd_servo_ros.reporting.run_numbers import (
    control_numbers,
    error_numbers,
    has_stepwise_reference,
    responses_to_edges,
)
from hdd_servo_ros.reporting.run_sensitivity import CONTROLLERS, run_sensitivity, why_no_sensitivity
from hdd_servo_ros.reporting.seek_report import seek_metrics, why_no_seek_metrics
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks
from hdd_servo_ros.reporting.track_metrics import track_left_out, track_metrics


def left_out(run: RecordedRun, after: float | None = None) -> list[str]:
    """Return the parts that the report of this run omits, one line each with the reason."""
    lines = []
    if not run.description:
        lines.append(
            'run.yaml is missing: the outcome of the run, its controller, its parameters and saturation are unknown'
        )
    missing = [f'/{name}' for name in ('head', 'reference') if name not in run]
    if missing and catalog.follows_reference(run.controller):
        lines.append(f'no tracking error and no metrics based on it: the bag has no {" and no ".join(missing)}')
    if run.is_track_following and DISTURBANCE.name in run.description.get('topics_left_out', {}):
        lines.append(f'no track error: the bag has no /{DISTURBANCE.name}, so that the errors are x - x_d')
    if 'control' not in run:
        lines.append('no metrics of the command: the bag has no /control')
    unknown = why_no_sensitivity(run)
    if not unknown and run.controller in CONTROLLERS and run_sensitivity(run) is None:
        unknown = 'not computable for this loop'
    if unknown:
        lines.append(f'no peak sensitivity: {unknown}')
    unknown = why_no_impacts(run)
    if unknown:
        lines.append(f'no impacts on the crash stops: {unknown}')
    if follows_reference(run):
        lines += track_left_out(run, after)
        why = why_no_seek_metrics(part_with_seeks(run))
        if why:
            lines.append(f'no metrics of seeks: {why}')
    if follows_reference(run) and not has_stepwise_reference(run, after):
        period = reference_period(run)
        if period is None:
            lines.append('no repeatable parts, areas and hysteresis: the period of the reference is unknown')
            return lines
        samples, whole = run.row_count - steady_start(run, after), whole_periods(period).numerator
        if samples < 2 * whole:
            what = 'repeatable parts and areas' if samples < whole and follows_sine(run) else 'repeatable parts'
            lines.append(
                f'no {what}: the window has {samples * run.sample_time:g} s, and periods of the reference that take an '
                f'integer number of samples last {whole * run.sample_time:g} s'
            )
    return lines


_SPECTRUM = 'tmr_of_spectrum'
_SENSITIVITY = ('peak_sensitivity', 'largest_peak_sensitivity')
"""Metrics that take long to compute."""


def run_metrics(run: RecordedRun, after: float | None = None, only: Collection[str] | None = None) -> list[Metric]:
    """
    Return the metrics of a run, without those that its reference or its topics do not allow.

    Parameters
    ----------
    run
        The run.
    after
        Start of the window [s]; see :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
    only
        Names of the metrics to compute; None for all.

    Raises
    ------
    ValueError
        If the run ends before that time.
    """
    start = steady_start(run, after)
    if start >= run.row_count:
        raise ValueError(f'{run.path}: no samples after {after} s: the run ends at {run.duration:g} s')
    found: list[Metric] = []
    if follows_reference(run):
        found += _tracking(run, after, spectrum=only is None or _SPECTRUM in only)
        if has_stepwise_reference(run, after):
            found += _steps(run, after)
        found += track_metrics(run, after)
        found += seek_metrics(part_with_seeks(run))
    if 'control' in run:
        found += _control(run, after)
    found += _impacts(run)
    if only is None:
        return found + _sensitivity(run)
    if any(name in only for name in _SENSITIVITY):
        found += _sensitivity(run)
    return [metric for metric in found if metric.name in only]


def _impacts(run: RecordedRun) -> list[Metric]:
    found = run_impacts(run)
    if found is None:
        return []
    count = sum(stop.count for stop in found.values())
    metrics = [Metric('stop_impacts', 'impacts on the crash stops, whole run', float(count), '')]
    if found:
        speed = max(stop.largest_speed for stop in found.values())
        unit = f'{run.length_unit}/s'
        metrics.append(Metric('largest_impact_speed', 'largest speed of impact on a crash stop', speed, unit))
    return metrics


def _sensitivity(run: RecordedRun) -> list[Metric]:
    found = run_sensitivity(run)
    if found is None:
        return []
    if not found.estimates:
        return [Metric('peak_sensitivity', 'peak sensitivity Ms', found.at_end, '')]
    return [
        Metric('peak_sensitivity', 'peak sensitivity Ms, estimates at the end', found.at_end, ''),
        Metric('largest_peak_sensitivity', 'the same, largest along the run', found.largest, ''),
    ]


def _tracking(run: RecordedRun, after: float | None, *, spectrum: bool) -> list[Metric]:
    unit, error = run.error_unit, error_numbers(run, after, spectrum=spectrum)
    found = [
        Metric('rms_error', 'rms error', error.rms, unit),
        Metric('max_error', 'max error', error.largest, unit),
        Metric('mean_error', 'mean error', error.mean, unit),
        Metric('tmr', 'TMR, 3 sigma', error.misregistration, unit),
    ]
    if error.misregistration_from_spectrum is not None:
        found.append(Metric('tmr_of_spectrum', 'TMR from the spectrum', error.misregistration_from_spectrum, unit))
    if error.parts is not None:
        repeatable, rest = error.parts
        found.append(Metric('repeatable_error', 'repeatable error, rms', repeatable, unit))
        found.append(Metric('non_repeatable_error', 'non-repeatable error, rms', rest, unit))
    return found


def _steps(run: RecordedRun, after: float | None) -> list[Metric]:
    response = responses_to_edges(run, after)
    if response is None:
        return []
    worst, median = response.worst(), response.median()
    found = [Metric('edges', 'edges of the reference', float(len(response)), '')]
    for name, label, unit, factor in (
        ('overshoot', 'overshoot', '%', 1.0),
        ('settling_time', '2 % settling time', 'ms', 1e3),
        ('steady_error', 'steady error', run.error_unit, run.error_factor),
    ):
        found.append(Metric(f'worst_{name}', f'{label}, worst', factor * worst[name], unit))
        if len(response) > 1:
            found.append(Metric(f'median_{name}', f'{label}, median', factor * median[name], unit))
    return found


def _control(run: RecordedRun, after: float | None) -> list[Metric]:
    unit, control = run.control_unit, control_numbers(run, after)
    seconds = max(run.row_count - 1 - steady_start(run, after), 1) * run.sample_time
    found = [
        Metric('peak_control', 'peak control, whole run', control.peak, unit),
        Metric('rms_control', 'rms control', control.rms, unit),
        Metric('control_variation', 'variation of the control', control.variation / seconds, f'{unit}/s'),
    ]
    if control.areas is not None:
        area_unit, (whole, feedback) = f'{run.length_unit} {unit}', control.areas
        found.append(Metric('control_loop_area', 'area of the control over the position', whole, area_unit))
        found.append(Metric('feedback_loop_area', "area of the control's feedback part", feedback, area_unit))
    return found
