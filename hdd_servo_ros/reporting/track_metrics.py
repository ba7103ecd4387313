"""Metrics of the track error of a run with a disturbance, and its lower bound under feedback."""

from hdd_servo_ros.analysis.off_track import WRITE_LIMIT, shock_responses
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_runs import stretch_of
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.run_bound import run_bound, why_no_bound
from hdd_servo_ros.reporting.run_sensitivity import (
    CONTROLLERS,
    linear_controller_at_end,
    loop_surroundings,
    why_no_sensitivity,
)
from hdd_servo_ros.reporting.track_numbers import track_numbers
from hdd_servo_ros.reporting.track_of_run import sectors_of, shocks_of, track_pitch, why_no_sectors


def has_track(run: RecordedRun) -> bool:
    """Return whether a run has a track error: it follows a reference and has a disturbance."""
    return DISTURBANCE.name in run and follows_reference(run)


def track_left_out(run: RecordedRun, after: float | None = None) -> list[str]:
    """
    Return the track metrics that a report omits, one line each with the reason.

    For ``after`` see :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
    """
    if not has_track(run):
        return []
    late = run.row_count - steady_start(run, after)
    lines = []
    why = why_no_sectors(run)
    sectors = sectors_of(run)
    if not why and late < 2 * sectors:
        why = f'the window has {late} samples, and two revolutions have {2 * sectors}'
    if why:
        lines.append(f'no RPE and NRPE: {why}')
    part = stretch_of(run)
    start = steady_start(part, after)
    why = why_no_bound(part, start)
    if not why:
        try:
            run_bound(part, start)
        except (ValueError, ArithmeticError) as error:
            why = str(error)
    if why:
        lines.append(f'no lower bound of the error: {why}')
    return lines


def track_metrics(run: RecordedRun, after: float | None = None) -> list[Metric]:
    """
    Return the metrics of the track error; empty without a disturbance.

    For a long run, shocks and the lower bound use only its last stretch, see
    :func:`~hdd_servo_ros.reporting.long_runs.stretch_of`.
    """
    if not has_track(run):
        return []
    part = stretch_of(run)
    return [
        *_errors(run, after),
        *_off_track(run, after),
        *_shocks(part),
        *_bode(part),
        *_bound(part, steady_start(part, after)),
    ]


class _Lengths:
    """Creates metrics of lengths in the unit of errors, each also as a fraction of the track pitch."""

    def __init__(self, run: RecordedRun) -> None:
        self._unit, self._factor, self._pitch = run.error_unit, run.error_factor, track_pitch(run)

    def of(self, name: str, label: str, length: float) -> list[Metric]:
        """Return the metrics for a length in the unit of positions."""
        found = [Metric(name, label, self._factor * length, self._unit)]
        if self._pitch is not None:
            found.append(Metric(f'{name}_of_pitch', f'{label}, of track pitch', 100.0 * length / self._pitch, '%'))
        return found


def _errors(run: RecordedRun, after: float | None) -> list[Metric]:
    lengths, track = _Lengths(run), track_numbers(run, after)
    found = []
    if track.misregistration is not None:
        found += lengths.of('track_error', 'track error, 3 sigma', track.misregistration)
    found += lengths.of('peak_track_error', 'track error, peak', track.largest)
    if track.parts is not None:
        parts = track.parts
        found += lengths.of('rpe', 'RPE, peak to peak', parts.repeatable_peak_to_peak)
        found += lengths.of('rpe_three_sigma', 'RPE, 3 sigma', parts.repeatable_three_sigma)
        found += lengths.of('nrpe', 'NRPE, 3 sigma', parts.non_repeatable_three_sigma)
        found += lengths.of('nrpe_peak_to_peak', 'NRPE, peak to peak', parts.non_repeatable_peak_to_peak)
    return found


def _off_track(run: RecordedRun, after: float | None) -> list[Metric]:
    found = []
    for limit, off in track_numbers(run, after).off_track.items():
        percent = f'{100.0 * limit:g}'
        label = f'more than {percent} % of pitch off track'
        found.append(Metric(f'off_track_{percent}', f'time {label}', 100.0 * off.fraction, '%'))
        found.append(Metric(f'longest_off_track_{percent}', f'longest stretch {label}', 1e3 * off.longest, 'ms'))
    return found


def _shocks(run: RecordedRun) -> list[Metric]:
    shocks, pitch = shocks_of(run), track_pitch(run)
    if not len(shocks) or pitch is None:
        return []
    responses = shock_responses(run.time, run.track_error, shocks.tolist(), WRITE_LIMIT * pitch)
    beyond = f'{100.0 * WRITE_LIMIT:g} % of pitch'
    worst_outside, worst_recovery = (
        1e3 * max(getattr(response, name) for response in responses) for name in ('outside', 'recovery')
    )
    return [
        Metric('shocks', 'shocks', float(len(shocks)), ''),
        *_Lengths(run).of('shock_peak', 'peak after a shock, worst', max(response.peak for response in responses)),
        Metric('shock_outside', f'time beyond {beyond} after a shock, worst', worst_outside, 'ms'),
        Metric('shock_recovery', f'time from a shock until within {beyond}, worst', worst_recovery, 'ms'),
    ]


def _bode(run: RecordedRun) -> list[Metric]:
    if run.controller not in CONTROLLERS or why_no_sensitivity(run):
        return []
    # Imported late: only these need the compiled blocks.
    from hdd_servo_ros.analysis.bode_integral import bode_integrals

    margins = loop_surroundings(run, CONTROLLERS[run.controller]).margins
    try:
        integral = bode_integrals(margins, linear_controller_at_end(run))[0]
    except (ValueError, ArithmeticError):
        # An unstable loop, which the report shows by its peak sensitivity.
        return []
    return [
        Metric('bode_amplification', 'mean of ln|S| where |S| > 1', integral.amplification, ''),
        Metric('bode_attenuation', 'mean of ln|S| where |S| < 1', integral.attenuation, ''),
        Metric('bode_integral', "Bode's integral, their sum", integral.value, ''),
        Metric('bode_theory', 'its theoretical value', integral.theory, ''),
    ]


def _bound(run: RecordedRun, start: int) -> list[Metric]:
    try:
        bound = run_bound(run, start)
    except (ValueError, ArithmeticError):
        # Listed by track_left_out.
        return []
    if bound is None:
        return []
    label = f'lower bound of 3 sigma under feedback, Ms at most {bound.max_sensitivity:g}'
    return [
        *_Lengths(run).of('least_error', label, bound.three_sigma),
        Metric(
            'error_over_least',
            '3 sigma without repeatable runout over its lower bound',
            bound.reached / bound.three_sigma,
            '',
        ),
    ]
