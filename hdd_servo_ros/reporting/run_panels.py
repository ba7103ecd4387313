"""The plots of one run."""

from collections.abc import Sequence

import numpy as np

from hdd_servo_ros.analysis.metrics import amplitude_spectrum
from hdd_servo_ros.bench.response import FrequencyResponse, decibels, degrees
from hdd_servo_ros.messages.topics import CONTROL, HEAD, REFERENCE, SIGNAL_TOPICS
from hdd_servo_ros.messages.units import Units, shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import PERIODS, close_up_of
from hdd_servo_ros.reporting.decimation import rows_to_draw
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_figures import long_figures
from hdd_servo_ros.reporting.long_runs import rows_of, stretch_of
from hdd_servo_ros.reporting.loop_panels import BUCKETS, loop_panels
from hdd_servo_ros.reporting.over_time import signals_over_time
from hdd_servo_ros.reporting.panel import COLORS, Panel, Trace
from hdd_servo_ros.reporting.reference_period import reference_period
from hdd_servo_ros.reporting.run_numbers import has_stepwise_reference, responses_to_edges
from hdd_servo_ros.reporting.seek_panels import seek_panels
from hdd_servo_ros.reporting.seek_view import view_of_run
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks, seeks_of
from hdd_servo_ros.reporting.track_panels import track_error_panel, track_panels

_LINES_IN_FULL = 1000
"""Number of the lowest lines of a spectrum that are not decimated."""
_LOOP_SAMPLES = 4000
_EDGE_SAMPLES = 500
_EDGES = 8


def panels_over_time(run: RecordedRun, after: float | None = None) -> list[Panel]:
    """
    Return the time plots of a run with a close-up, without those whose topics are missing.

    The seeks of a long run are drawn like any other reference. ``after`` is the start of the window of a long run [s].
    """
    if run.is_long and not any(topic.name in run for topic in SIGNAL_TOPICS):
        return []
    close_up = close_up_of(run)
    seeks = None if run.is_long else view_of_run(run)
    return loop_panels(
        signals_over_time(run, after, close_up), follows=follows_reference(run), close_up=close_up, seeks=seeks
    )


def run_panels(run: RecordedRun, after: float | None = None, response: FrequencyResponse | None = None) -> list[Panel]:
    """
    Return all plots of a run, without those whose topics are missing.

    Parameters
    ----------
    run
        The run.
    after
        Start of the window of the spectrum [s]; None to skip the first half of the run, at most 2 s.
    response
        Response measured by a signal analyzer in the run.
    """
    panels = _bode_panels(response) if response is not None and len(response.frequency) else []
    part = part_with_seeks(run)
    for panel in panels_over_time(run, after):
        track = track_error_panel(run, after) if panel.name == 'error' else None
        # With the servo sensor both plots show the same error, and the track plot also shows the limits.
        is_same = run.is_track_following and not seeks_of(part)
        panels += [panel] if track is None else [track] if is_same else [panel, track]
    panels += seek_panels(part)
    if follows_reference(run):
        line = spectrum_line('error', run, after, COLORS[0], BUCKETS)
        panels.append(spectrum_panel([] if line is None else [line], run.units))
        panels += track_panels(run, after)
    if REFERENCE.name in run and HEAD.name in run:
        panels += filter(None, (_edges_panel(run, after), _loop_panel(run, after)))
    return panels


def spectrum_line(name: str, run: RecordedRun, after: float | None, color: str, buckets: int) -> Trace | None:
    """Return the amplitude spectrum of the position error as a line; None if the run is too short."""
    start = steady_start(run, after)
    if run.row_count - start <= 2:
        return None
    if run.is_long:
        error = long_figures(run, after).error
        assert error is not None
        frequencies, amplitudes = error.amplitude_spectrum()
    else:
        frequencies, amplitudes = amplitude_spectrum(run.error_factor * run.position_error[start:], run.sample_time)
    # The mean is removed, since a logarithmic axis has no 0 Hz. Its lowest lines are far apart.
    rows = 1 + rows_to_draw(amplitudes[1:], buckets, [slice(0, _LINES_IN_FULL)])
    return Trace(name, frequencies[rows], amplitudes[rows], color)


def spectrum_panel(lines: Sequence[Trace], units: Units) -> Panel:
    """Return the plot of error spectra."""
    return Panel(
        'spectrum',
        'Spectrum of the position error signal',
        'frequency [Hz]',
        f'amplitude of a sine [{shown(units.error)}]',
        tuple(lines),
        logarithmic=True,
    )


def _bode_panels(response: FrequencyResponse) -> list[Panel]:
    """Return the plots of gain, phase and, if measured, coherence."""
    curves = [
        ('gain', f'gain [dB, {shown(response.unit)}]', decibels(response)),
        ('phase', 'phase [°]', degrees(response)),
    ]
    if response.averages.min() > 1:
        curves.append(('coherence', 'coherence', response.coherence))
    return [
        Panel(
            name,
            f'Measured response: {name}',
            'frequency [Hz]',
            label,
            (Trace(name, response.frequency, values, COLORS[0]),),
            logarithmic_x=True,
            y_range=(0.0, 1.05) if name == 'coherence' else None,
        )
        for name, label, values in curves
    ]


def _edges_panel(run: RecordedRun, after: float | None) -> Panel | None:
    """Return the overlaid responses to the edges of a stepwise reference."""
    # Seeks have their own plots.
    if not follows_reference(run) or not has_stepwise_reference(run, after) or seeks_of(part_with_seeks(run)):
        return None
    response = responses_to_edges(run, after)
    if response is None:
        return None
    drawn = np.unique(np.linspace(0, len(response) - 1, _EDGES).round().astype(int))
    ends = np.append(response.row[1:], run.row_count)
    traces: list[Trace] = []
    for index in drawn:
        row, height = response.row[index], response.height[index]
        rows = slice(row, min(ends[index], row + _EDGE_SAMPLES))
        part, row, rows = (run, row, rows) if not run.is_long else (rows_of(run, rows), 0, slice(None))
        x = 1e3 * (part.time[rows] - part.time[row])
        y = 1.0 + (part.relative_position[rows] - part.desired_position[row]) / height
        name = f'edge at {part.time[row]:g} s'
        traces.append(Trace(name, x, y, COLORS[len(traces) % len(COLORS)]))
    return Panel('edges', 'Responses to the edges', 'time after the edge [ms]', 'fraction of the edge', tuple(traces))


def _loop_panel(run: RecordedRun, after: float | None) -> Panel | None:
    """Return friction and feedback over the position for the last periods of the reference."""
    period = reference_period(run)
    if period is None or has_stepwise_reference(run, after):
        return None
    run = stretch_of(run)
    rows = min(len(run.ticks), round(period * max(1, min(PERIODS, int(_LOOP_SAMPLES // period)))))
    part = slice(len(run.ticks) - rows, len(run.ticks), max(1, rows // _LOOP_SAMPLES))
    position = run.position[part]
    traces = [Trace('pivot friction', position, run.head.friction[part], COLORS[4])]
    if CONTROL.name in run:
        traces.append(Trace('control', position, run.command[part], COLORS[2]))
        traces.append(Trace('its feedback part', position, run.feedback[part], COLORS[3]))
    return Panel(
        'loop',
        'Hysteresis, last periods',
        f'head position [{shown(run.length_unit)}]',
        f'[{shown(run.control_unit)}]',
        tuple(traces),
    )
