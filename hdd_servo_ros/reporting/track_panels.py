"""The diagrams of a run with a disturbance: track error with its limits, cumulative spectrum, runout by sector."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.error_spectrum import cumulative_spectrum
from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.loop_panels import TIME_LABEL, Lines, error_label
from hdd_servo_ros.reporting.panel import COLOURS, GREY, Panel, Trace
from hdd_servo_ros.reporting.track_metrics import has_track
from hdd_servo_ros.reporting.track_of_run import non_repeatable, sectors_of, shocks_of, track_pitch

_SHOCKS = 8
_BEFORE_SHOCK, _AFTER_SHOCK = 1e-3, 1.5e-2
"""What is drawn about a shock [s]."""


def track_error_panel(run: RecordedRun) -> Panel | None:
    """Return the diagram of the track error over time, with the limits of reading and writing; None without it."""
    return _over_time(run) if has_track(run) else None


def track_panels(run: RecordedRun, start: int) -> list[Panel]:
    """Return responses to shocks, and cumulative spectrum and runout from row ``start`` on, where a run has them."""
    if not has_track(run):
        return []
    shocks = shocks_of(run)
    panels = [_shock_responses(run, shocks)] if len(shocks) else []
    error, sectors = run.error_factor * run.track_error[start:], sectors_of(run)
    if len(error) >= 4:
        panels.append(_cumulative(run, error, sectors))
    if sectors and len(error) >= 2 * sectors:
        panels.append(_runout(run, error, sectors, start))
    return panels


def _over_time(run: RecordedRun) -> Panel:
    close_up = close_up_of(run)
    lines = Lines(run, follows=True, close_up=close_up)
    error = lines.over_time('head - reference - track centre', run.error_factor * run.track_error, COLOURS[1])
    pitch, traces = track_pitch(run), [error]
    if pitch is not None:
        # Both limits as one line with a gap, drawn within the close-up as well.
        ends = [float(run.time[0]), float(run.time[-1])]
        ends = sorted({*ends, *([] if close_up is None else [close_up.start, close_up.end])})
        x = np.array([*ends, ends[-1], *ends])
        for limit, colour in ((WRITE_LIMIT, COLOURS[3]), (READ_LIMIT, COLOURS[4])):
            y = np.full(len(ends), run.error_factor * limit * pitch)
            is_far = 2.0 * np.abs(error.y).max() < y[0]
            name = f'{100.0 * limit:g} % of pitch'
            traces.append(Trace(name, x, np.concatenate([y, [np.nan], -y]), colour, clipped=is_far))
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
        traces.append(Trace(f'shock at {shock:g} s', since, error, COLOURS[index % len(COLOURS)]))
    return Panel('shocks', 'Responses to shocks', 'time from the shock [ms]', error_label(run.units), tuple(traces))


def _cumulative(run: RecordedRun, error: NDArray[np.float64], sectors: int) -> Panel:
    lines = [('track error', error, COLOURS[1])]
    if sectors and len(error) >= 2 * sectors:
        lines.append(('without repeatable runout', non_repeatable(error, sectors), COLOURS[0]))
    return Panel(
        'cumulative_spectrum',
        'Cumulative spectrum of the track error',
        'frequency [Hz]',
        f'sigma below the frequency [{shown(run.error_unit)}]',
        tuple(Trace(name, *cumulative_spectrum(values, run.sample_time), colour) for name, values, colour in lines),
        logarithmic_x=True,
    )


def _runout(run: RecordedRun, error: NDArray[np.float64], sectors: int, start: int) -> Panel:
    parts = runout_parts(error, sectors)
    # From sector 0, that of tick 0, on.
    mean = np.roll(parts.repeatable, int(run.ticks[start]) % sectors)
    sector = np.arange(sectors, dtype=np.float64)
    spread = np.full(sectors, parts.non_repeatable_three_sigma)
    return Panel(
        'runout',
        f'Repeatable position error, mean of {parts.revolutions} revolutions',
        'servo sector',
        error_label(run.units),
        (
            Trace('RPE', sector, mean, COLOURS[0]),
            Trace('RPE + 3 sigma of NRPE', sector, mean + spread, GREY),
            Trace('RPE - 3 sigma of NRPE', sector, mean - spread, GREY),
        ),
    )
