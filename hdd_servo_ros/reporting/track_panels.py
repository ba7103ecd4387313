"""Plots of a run with a disturbance: track error with its limits, cumulative spectrum, runout by sector."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.error_spectrum import cumulative_spectrum
from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT
from hdd_servo_ros.analysis.runout import RunoutParts, runout_parts
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.evaluation import steady_start
from hdd_servo_ros.reporting.long_figures import long_figures
from hdd_servo_ros.reporting.long_runs import stretch_of
from hdd_servo_ros.reporting.loop_panels import TIME_LABEL, Lines, error_label
from hdd_servo_ros.reporting.over_time import signals_over_time
from hdd_servo_ros.reporting.panel import COLORS, GRAY, Panel, Trace
from hdd_servo_ros.reporting.track_metrics import has_track
from hdd_servo_ros.reporting.track_numbers import track_numbers
from hdd_servo_ros.reporting.track_of_run import non_repeatable, sectors_of, shocks_of, track_pitch

Spectrum = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Frequencies [Hz] and values."""

_SHOCKS = 8
_BEFORE_SHOCK, _AFTER_SHOCK = 1e-3, 1.5e-2
"""Time before and after a shock in the plot [s]."""


def track_error_panel(run: RecordedRun, after: float | None = None) -> Panel | None:
    """
    Return the time plot of the track error with the limits of reading and writing; None without a track error.

    ``after`` is the start of the window of a long run [s].
    """
    return _over_time(run, after) if has_track(run) else None


def track_panels(run: RecordedRun, after: float | None = None) -> list[Panel]:
    """
    Return the responses to shocks, the cumulative spectrum and the runout after the transient, if the run has them.

    Shocks are those of :func:`~hdd_servo_ros.reporting.long_runs.stretch_of` the run. For ``after`` see
    :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
    """
    if not has_track(run):
        return []
    part = stretch_of(run)
    shocks = shocks_of(part)
    panels = [_shock_responses(part, shocks)] if len(shocks) else []
    start = steady_start(run, after)
    if run.row_count - start >= 4:
        panels.append(_cumulative(run, after))
    parts = _runout_in_unit_of_errors(run, after)
    if parts is not None:
        panels.append(_runout(run, parts, start))
    return panels


def _runout_in_unit_of_errors(run: RecordedRun, after: float | None) -> RunoutParts | None:
    if run.is_long:
        parts, factor = track_numbers(run, after).parts, run.error_factor
        return None if parts is None else parts.scaled(factor)
    error, sectors = run.error_factor * run.track_error[steady_start(run, after) :], sectors_of(run)
    return runout_parts(error, sectors) if sectors and len(error) >= 2 * sectors else None


def _over_time(run: RecordedRun, after: float | None) -> Panel:
    close_up = close_up_of(run)
    signals = signals_over_time(run, after, close_up)
    lines = Lines(signals, follows=True, close_up=close_up)
    error = lines.over_time('head - reference - track center', run.error_factor * signals.track_error, COLORS[1])
    pitch, traces = track_pitch(run), [error]
    if pitch is not None:
        # Both limits as one line with a gap, also within the close-up.
        ends = [float(signals.time[0]), float(signals.time[-1])]
        ends = sorted({*ends, *([] if close_up is None else [close_up.start, close_up.end])})
        x = np.array([*ends, ends[-1], *ends])
        for limit, color in ((WRITE_LIMIT, COLORS[3]), (READ_LIMIT, COLORS[4])):
            y = np.full(len(ends), run.error_factor * limit * pitch)
            is_far = 2.0 * np.abs(error.y).max() < y[0]
            name = f'{100.0 * limit:g} % of pitch'
            traces.append(Trace(name, x, np.concatenate([y, [np.nan], -y]), color, clipped=is_far))
    return Panel(
        'track_error',
        'Track error',
        TIME_LABEL,
        error_label(run.units),
        tuple(traces),
        over_time=True,
        close_up=close_up,
    )


def _shock_responses(run: RecordedRun, shocks: NDArray[np.float64]) -> Panel:
    drawn = shocks[np.unique(np.linspace(0, len(shocks) - 1, _SHOCKS).round().astype(int))]
    traces = []
    for index, shock in enumerate(drawn):
        rows = slice(run.since(shock - _BEFORE_SHOCK).start, run.since(shock + _AFTER_SHOCK).start)
        since, error = 1e3 * (run.time[rows] - shock), run.error_factor * run.track_error[rows]
        traces.append(Trace(f'shock at {shock:g} s', since, error, COLORS[index % len(COLORS)]))
    return Panel('shocks', 'Responses to shocks', 'time from the shock [ms]', error_label(run.units), tuple(traces))


def _cumulative_spectra(run: RecordedRun, after: float | None) -> list[tuple[str, Spectrum, str]]:
    """Return names, cumulative spectra of the track error, and colors."""
    if run.is_long:
        figures = long_figures(run, after)
        whole, rest = figures.cumulative_spectrum, figures.cumulative_without_runout
    else:
        error, sectors = run.error_factor * run.track_error[steady_start(run, after) :], sectors_of(run)
        whole, rest = cumulative_spectrum(error, run.sample_time), None
        if sectors and len(error) >= 2 * sectors:
            rest = cumulative_spectrum(non_repeatable(error, sectors), run.sample_time)
    lines = [('track error', whole, COLORS[1])]
    return lines if rest is None else [*lines, ('without repeatable runout', rest, COLORS[0])]


def _cumulative(run: RecordedRun, after: float | None) -> Panel:
    return Panel(
        'cumulative_spectrum',
        'Cumulative spectrum of the track error',
        'frequency [Hz]',
        f'sigma below the frequency [{shown(run.error_unit)}]',
        tuple(Trace(name, *spectrum, color) for name, spectrum, color in _cumulative_spectra(run, after)),
        logarithmic_x=True,
    )


def _runout(run: RecordedRun, parts: RunoutParts, start: int) -> Panel:
    sectors = parts.sectors
    # From sector 0, which is that of tick 0.
    first_tick = start if run.is_long else int(run.ticks[start])
    mean = np.roll(parts.repeatable, first_tick % sectors)
    sector = np.arange(sectors, dtype=np.float64)
    spread = np.full(sectors, parts.non_repeatable_three_sigma)
    return Panel(
        'runout',
        f'Repeatable position error, mean of {parts.revolutions} revolutions',
        'servo sector',
        error_label(run.units),
        (
            Trace('RPE', sector, mean, COLORS[0]),
            Trace('RPE + 3 sigma of NRPE', sector, mean + spread, GRAY),
            Trace('RPE - 3 sigma of NRPE', sector, mean - spread, GRAY),
        ),
    )
