"""The metrics of a run with a disturbance: how well the head stays on its track, and how much better feedback could."""

from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT, off_track, shock_responses
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.run_bound import run_bound, why_no_bound
from hdd_servo_ros.reporting.run_sensitivity import (
    CONTROLLERS,
    linear_controller_at_end,
    loop_surroundings,
    why_no_sensitivity,
)
from hdd_servo_ros.reporting.track_of_run import sectors_of, shocks_of, track_pitch, why_no_sectors


def has_track(run: RecordedRun) -> bool:
    """Return whether a run has a track error of its own: a head that is to follow, and a disturbance."""
    return DISTURBANCE.name in run and follows_reference(run)


def track_left_out(run: RecordedRun, start: int) -> list[str]:
    """Return which metrics of the track are left out of a run's report, from row ``start`` on, and why, a line each."""
    if not has_track(run):
        return []
    lines = []
    why = why_no_sectors(run)
    sectors = sectors_of(run)
    if not why and len(run.ticks) - start < 2 * sectors:
        why = f'{len(run.ticks) - start} samples after the transient, and two revolutions have {2 * sectors}'
    if why:
        lines.append(f'no RPE and NRPE: {why}')
    why = why_no_bound(run, start)
    if not why:
        try:
            run_bound(run, start)
        except (ValueError, ArithmeticError) as error:
            why = str(error)
    if why:
        lines.append(f'no least error of feedback: {why}')
    return lines


def track_metrics(run: RecordedRun, start: int) -> list[Metric]:
    """Return the metrics of the track from row ``start`` on; none of a run without a disturbance."""
    if not has_track(run):
        return []
    return [*_errors(run, start), *_off_track(run, start), *_shocks(run), *_bode(run), *_bound(run, start)]


class _Lengths:
    """Makes metrics of lengths in the unit of errors, each with its share of the track pitch."""

    def __init__(self, run: RecordedRun) -> None:
        self._unit, self._factor, self._pitch = run.error_unit, run.error_factor, track_pitch(run)

    def of(self, name: str, label: str, length: float) -> list[Metric]:
        """Return the metrics of a length in the unit of positions."""
        found = [Metric(name, label, self._factor * length, self._unit)]
        if self._pitch is not None:
            found.append(Metric(f'{name}_of_pitch', f'{label}, of track pitch', 100.0 * length / self._pitch, '%'))
        return found


def _errors(run: RecordedRun, start: int) -> list[Metric]:
    error, lengths, sectors = run.track_error[start:], _Lengths(run), sectors_of(run)
    found = lengths.of('track_error', 'track error, 3 sigma', misregistration(error)) if len(error) > 1 else []
    found += lengths.of('peak_track_error', 'track error, peak', float(abs(error).max()))
    if sectors and len(error) >= 2 * sectors:
        parts = runout_parts(error, sectors)
        found += lengths.of('rpe', 'RPE, peak to peak', parts.repeatable_peak_to_peak)
        found += lengths.of('rpe_three_sigma', 'RPE, 3 sigma', parts.repeatable_three_sigma)
        found += lengths.of('nrpe', 'NRPE, 3 sigma', parts.non_repeatable_three_sigma)
        found += lengths.of('nrpe_peak_to_peak', 'NRPE, peak to peak', parts.non_repeatable_peak_to_peak)
    return found


def _off_track(run: RecordedRun, start: int) -> list[Metric]:
    pitch = track_pitch(run)
    if pitch is None:
        return []
    found = []
    for limit in (WRITE_LIMIT, READ_LIMIT):
        percent = f'{100.0 * limit:g}'
        off = off_track(run.track_error[start:], limit * pitch, run.sample_time)
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
    # Late: only these need the compiled blocks.
    from hdd_servo_ros.analysis.bode_integral import bode_integrals

    margins = loop_surroundings(run, CONTROLLERS[run.controller]).margins
    try:
        integral = bode_integrals(margins, linear_controller_at_end(run))[0]
    except (ValueError, ArithmeticError):
        # An unstable loop, which the report states by its peak sensitivity.
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
    label = f'least 3 sigma of feedback alone, Ms at most {bound.max_sensitivity:g}'
    return [
        *_Lengths(run).of('least_error', label, bound.three_sigma),
        Metric(
            'error_over_least',
            '3 sigma without repeatable runout over the least',
            bound.reached / bound.three_sigma,
            '',
        ),
    ]
