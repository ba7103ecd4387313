"""The plots of seeks: seek time over length with bounds, errors on two scales, residual spectra."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from hdd_servo_ros.analysis.off_track import WRITE_LIMIT
from hdd_servo_ros.analysis.seek_metrics import RESIDUAL_TIME, SeekResponse, residual_spectrum
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.loop_panels import error_label
from hdd_servo_ros.reporting.panel import COLORS, GRAY, Panel, Trace
from hdd_servo_ros.reporting.seek_view import COARSE, FINE
from hdd_servo_ros.reporting.seeks_of_run import bound_curve, part_with_seeks, responses_of, seeks_of, tolerance_of

_DARK = '#444444'
_SEEKS = 7
"""Number of overlaid seeks."""
_AFTER_ARRIVAL = 3e-3
"""Time after the last arrival in the plot [s]."""


def seek_panels(run: RecordedRun) -> list[Panel]:
    """Return the plots of the seeks; empty without seeks, or for a drive that is not in um."""
    tolerance = tolerance_of(run)
    if tolerance is None or not seeks_of(run):
        return []
    responses = responses_of(run, tolerance)
    chosen = _spread(responses)
    return [
        _access_times(run, responses, tolerance),
        *_errors(run, chosen, tolerance),
        *_spectrum(run, _spread([response for response in responses if response.has_arrived])),
    ]


def _spread(responses: list[SeekResponse]) -> list[SeekResponse]:
    """Return some responses, evenly spaced over their lengths, the shortest seek first."""
    ordered = sorted(responses, key=lambda response: abs(response.seek.length))
    if not ordered:
        return []
    rows = np.unique(np.linspace(0, len(ordered) - 1, _SEEKS).round().astype(int))
    return [ordered[row] for row in rows.tolist()]


def access_times_of_runs(runs: Mapping[str, tuple[RecordedRun, str]]) -> Panel | None:
    """
    Return the seek times of several runs over length, with the bounds of the run with the most lengths.

    Parameters
    ----------
    runs
        Runs and colors by name.

    Returns
    -------
    Panel or None
        None if no run has seeks, or no drive is in um.
    """
    parts = {name: (part_with_seeks(run), color) for name, (run, color) in runs.items()}
    known = [(name, run, color, tolerance_of(run)) for name, (run, color) in parts.items() if seeks_of(run)]
    seeking = [(name, run, color, tolerance) for name, run, color, tolerance in known if tolerance is not None]
    if not seeking:
        return None
    _, run, _, tolerance = max(seeking, key=lambda item: len({abs(seek.length) for seek in seeks_of(item[1])}))
    panel = _access_times(run, [], tolerance)
    traces = []
    for name, run, color, tolerance in seeking:
        responses = responses_of(run, tolerance)
        lost = sum(not response.has_arrived for response in responses)
        label = f'{name} ({lost} of {len(responses)} do not arrive)' if lost else name
        traces += _marks(run, label, [response for response in responses if response.has_arrived], color)
    # Runs with many seeks are drawn below those with few.
    traces.sort(key=lambda trace: -len(trace.x))
    return dataclasses.replace(
        panel, title='Seek times, within 10 % of the track pitch', traces=(*panel.traces, *traces)
    )


def _marks(run: RecordedRun, name: str, responses: list[SeekResponse], color: str) -> list[Trace]:
    """Return the seek times over length [ms]; for a seek that does not arrive, the observation time."""
    if not responses:
        return []
    times = [1e3 * (response.seek_time if response.has_arrived else response.watched) for response in responses]
    lengths = [abs(response.seek.length) for response in responses]
    # A logarithmic axis has no 0, the seek time of a head that is already on target.
    return [Trace(name, np.array(lengths), np.maximum(times, 1e3 * run.sample_time), color, marked=True)]


def _access_times(run: RecordedRun, responses: list[SeekResponse], tolerance: float) -> Panel:
    traces = []
    curve = bound_curve(run, tolerance)
    if curve is not None:
        known = np.isfinite(curve.fastest)
        traces = [
            Trace('T*, time-optimal rigid body', curve.lengths, 1e3 * curve.time_optimal, GRAY, wide=True),
            Trace('fastest with modes', curve.lengths[known], 1e3 * curve.fastest[known], _DARK),
        ]
    for name, arrived, color in (
        ('seek', True, COLORS[0]),
        ('seek that does not arrive: observation time', False, COLORS[1]),
    ):
        traces += _marks(run, name, [response for response in responses if response.has_arrived == arrived], color)
    within = f'{run.error_factor * tolerance:.4g} {shown(run.error_unit)}'
    return Panel(
        'access_times',
        f'Seek time, within {within} until the next seek',
        f'length of the seek [{shown(run.length_unit)}]',
        'time [ms]',
        tuple(traces),
        logarithmic=True,
    )


def _name(response: SeekResponse) -> str:
    return f'{response.seek.length:+.4g} {shown("um")} at {response.time:.4g} s'


def _errors(run: RecordedRun, responses: list[SeekResponse], tolerance: float) -> list[Panel]:
    factor, position = run.error_factor, run.relative_position
    arrivals = [response.seek_time for response in responses if response.has_arrived]
    longest = max(arrivals, default=math.inf) + _AFTER_ARRIVAL
    traces, last = [], 0.0
    for index, response in enumerate(responses):
        seek = response.seek
        rows = slice(seek.row, seek.row + math.ceil(min(response.watched, longest) / run.sample_time))
        since = 1e3 * (run.time[rows] - run.time[seek.row])
        last = max(last, float(since[-1]))
        error = factor * (position[rows] - seek.target)
        traces.append(Trace(_name(response), since, error, COLORS[index % len(COLORS)]))
    x, limit = np.array([0.0, last, last, 0.0, last]), factor * tolerance
    limits = Trace(f'{100.0 * WRITE_LIMIT:g} % of pitch', x, np.array([limit, limit, np.nan, -limit, -limit]), GRAY)
    return [
        Panel(
            f'seek_errors_{scale}',
            f'Position error after the start of a seek, {scale} scale',
            'time from the start of the seek [ms]',
            error_label(run.units),
            (limits, *traces),
            y_range=(-factor * half, factor * half),
        )
        for scale, half in (('coarse', COARSE), ('fine', FINE))
    ]


def _spectrum(run: RecordedRun, responses: list[SeekResponse]) -> list[Panel]:
    traces: list[Trace] = []
    position = run.relative_position
    for response in responses:
        arrival = response.seek.row + round(response.seek_time / run.sample_time)
        end = min(
            response.seek.row + round(response.watched / run.sample_time),
            arrival + math.ceil(RESIDUAL_TIME / run.sample_time - 1e-9),
        )
        error = run.error_factor * (position[arrival:end] - response.seek.target)
        if len(error) < 4:
            continue
        frequencies, amplitudes = residual_spectrum(error, run.sample_time)
        traces.append(Trace(_name(response), frequencies, amplitudes, COLORS[len(traces) % len(COLORS)]))
    if not traces:
        return []
    return [
        Panel(
            'residual_spectrum',
            f'Residual vibration, {1e3 * RESIDUAL_TIME:g} ms after arrival',
            'frequency [Hz]',
            f'amplitude of a sine [{shown(run.error_unit)}]',
            tuple(traces),
            logarithmic=True,
        )
    ]
