"""The diagrams of one run."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import amplitude_spectrum, is_stepwise
from hdd_servo_ros.bench.response import FrequencyResponse, decibels, degrees
from hdd_servo_ros.messages.topics import CONTROL, HEAD, REFERENCE
from hdd_servo_ros.messages.units import Units, shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import PERIODS, close_up_of
from hdd_servo_ros.reporting.decimation import rows_to_draw
from hdd_servo_ros.reporting.evaluation import edge_responses, follows_reference, steady_start
from hdd_servo_ros.reporting.loop_panels import BUCKETS, loop_panels
from hdd_servo_ros.reporting.panel import COLOURS, Panel, Trace
from hdd_servo_ros.reporting.reference_period import reference_period
from hdd_servo_ros.reporting.seek_panels import seek_panels
from hdd_servo_ros.reporting.seek_view import view_of_run
from hdd_servo_ros.reporting.seeks_of_run import seeks_of
from hdd_servo_ros.reporting.track_panels import track_error_panel, track_panels

_LINES_IN_FULL = 1000
"""Lines of a spectrum, from the lowest on, that are drawn one by one."""
_LOOP_SAMPLES = 4000
_EDGE_SAMPLES = 500
_EDGES = 8


def panels_over_time(run: RecordedRun) -> list[Panel]:
    """Return the diagrams of a run over its time, with a close-up; those whose topics are missing are left out."""
    return loop_panels(run, follows=follows_reference(run), close_up=close_up_of(run), seeks=view_of_run(run))


def run_panels(run: RecordedRun, after: float | None = None, response: FrequencyResponse | None = None) -> list[Panel]:
    """
    Return all diagrams of one run; those whose topics the bag does not hold are left out.

    Parameters
    ----------
    run
        The run.
    after
        Time from which the spectrum counts [s]; None for the first half of the run, 2 s at most.
    response
        What a signal analyzer has measured in the run.
    """
    panels = _bode_panels(response) if response is not None and len(response.frequency) else []
    for panel in panels_over_time(run):
        track = track_error_panel(run) if panel.name == 'error' else None
        # With the servo sensor both are the same error, and the diagram of the track has the limits of the pitch.
        is_same = run.is_track_following and not seeks_of(run)
        panels += [panel] if track is None else [track] if is_same else [panel, track]
    panels += seek_panels(run)
    if follows_reference(run):
        error = run.error_factor * run.position_error[steady_start(run, after) :]
        line = spectrum_line('error', error, run.sample_time, COLOURS[0], BUCKETS)
        panels.append(spectrum_panel([] if line is None else [line], run.units))
        panels += track_panels(run, steady_start(run, after))
    if REFERENCE.name in run and HEAD.name in run:
        panels += filter(None, (_edges_panel(run), _loop_panel(run)))
    return panels


def spectrum_line(name: str, error: NDArray[np.float64], sample_time: float, colour: str, buckets: int) -> Trace | None:
    """Return the amplitude spectrum of an error signal, shape (n,), as a line; None if it is too short for one."""
    if len(error) <= 2:
        return None
    frequencies, amplitudes = amplitude_spectrum(error, sample_time)
    # The mean is taken out, and a logarithmic axis has no 0 Hz. Its low lines are far apart.
    rows = 1 + rows_to_draw(amplitudes[1:], buckets, [slice(0, _LINES_IN_FULL)])
    return Trace(name, frequencies[rows], amplitudes[rows], colour)


def spectrum_panel(lines: Sequence[Trace], units: Units) -> Panel:
    """Return the diagram of error spectra."""
    return Panel(
        'spectrum',
        'Spectrum of the position error signal',
        'frequency [Hz]',
        f'amplitude of a sine [{shown(units.error)}]',
        tuple(lines),
        logarithmic=True,
    )


def _bode_panels(response: FrequencyResponse) -> list[Panel]:
    """Return gain, phase and, where it was measured, coherence of a response."""
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
            (Trace(name, response.frequency, values, COLOURS[0]),),
            logarithmic_x=True,
            y_range=(0.0, 1.05) if name == 'coherence' else None,
        )
        for name, label, values in curves
    ]


def _edges_panel(run: RecordedRun) -> Panel | None:
    """Return the responses to the edges of a stepwise reference over each other."""
    # The diagrams of seeks show them on scales of their own.
    if not follows_reference(run) or not is_stepwise(run.desired_position) or seeks_of(run):
        return None
    try:
        response = edge_responses(run)
    except ValueError:
        return None
    drawn = np.unique(np.linspace(0, len(response) - 1, _EDGES).round().astype(int))
    ends = np.append(response.row[1:], len(run.ticks))
    traces: list[Trace] = []
    for index in drawn:
        row, height = response.row[index], response.height[index]
        rows = slice(row, min(ends[index], row + _EDGE_SAMPLES))
        x = 1e3 * (run.time[rows] - run.time[row])
        y = 1.0 + (run.relative_position[rows] - run.desired_position[row]) / height
        name = f'edge at {run.time[row]:g} s'
        traces.append(Trace(name, x, y, COLOURS[len(traces) % len(COLOURS)]))
    return Panel('edges', 'Responses to the edges', 'time after the edge [ms]', 'of the height', tuple(traces))


def _loop_panel(run: RecordedRun) -> Panel | None:
    """Return friction and feedback over the position: the last periods of a periodic reference."""
    period = reference_period(run)
    if period is None or is_stepwise(run.desired_position):
        return None
    rows = min(len(run.ticks), round(period * max(1, min(PERIODS, int(_LOOP_SAMPLES // period)))))
    part = slice(len(run.ticks) - rows, len(run.ticks), max(1, rows // _LOOP_SAMPLES))
    position = run.position[part]
    traces = [Trace('pivot friction', position, run.head.friction[part], COLOURS[4])]
    if CONTROL.name in run:
        traces.append(Trace('control', position, run.command[part], COLOURS[2]))
        traces.append(Trace('its feedback part', position, run.feedback[part], COLOURS[3]))
    return Panel(
        'loop',
        'Hysteresis, last periods',
        f'head position [{shown(run.length_unit)}]',
        f'[{shown(run.control_unit)}]',
        tuple(traces),
    )
