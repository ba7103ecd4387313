"""What a report shows of a run, or of several: diagrams as data, which the picture and the page draw alike."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import amplitude_spectrum, is_stepwise, step_response
from hdd_servo_ros.bench.response import FrequencyResponse, decibels, degrees
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.decimation import rows_to_draw
from hdd_servo_ros.reporting.run_metrics import reference_period, shown_unit, steady_start, tracks
from hdd_servo_ros.reporting.summary import NOT_ADAPTED

COLOURS = ('#1f77b4', '#d62728', '#2ca02c', '#ff7f0e', '#9467bd', '#17becf', '#8c564b', '#e377c2', '#bcbd22', '#7f7f7f')
GREY = '#999999'
_BUCKETS = 2500
_COMPARED_POINTS = 20_000
"""How many points all runs of a comparison may have together in one diagram over time."""
_SAMPLES_IN_FULL = 500
"""Rows at the start, about the largest error and at the end that are drawn one by one."""
_LINES_IN_FULL = 1000
"""Lines of a spectrum, from the lowest on, that are drawn one by one."""
_LOOP_SAMPLES = 4000
_PERIODS = 3
_ESTIMATES = 8
_EDGES = 8


@dataclasses.dataclass(frozen=True)
class Trace:
    """One line of a diagram."""

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    colour: str
    wide: bool = False
    marked: bool = False
    """Whether its points are marked instead of joined."""


@dataclasses.dataclass(frozen=True)
class Panel:
    """One diagram; those over time belong together, as they share their axis."""

    name: str
    title: str
    x_label: str
    y_label: str
    traces: tuple[Trace, ...]
    over_time: bool = False
    logarithmic: bool = False
    """Whether both axes are."""
    logarithmic_x: bool = False
    largest_first: bool = False
    """Whether a picture draws the lines in the order of their size, so that none covers the others."""
    y_range: tuple[float, float] | None = None
    close_up: tuple[float, float] | None = None
    """Which part of the horizontal axis a picture shows, where the whole would be a filled band."""


def run_panels(run: RecordedRun, after: float | None = None, response: FrequencyResponse | None = None) -> list[Panel]:
    """
    Return the diagrams of one run; those whose topics the bag does not hold are left out.

    Parameters
    ----------
    run
        The run.
    after
        Time from which the spectrum counts [s]; None for the first half of the run, 2 s at most.
    response
        What a signal analyzer has measured in the run.
    """
    length, volt = shown_unit(run.length_unit), run.control_unit
    lines = _Lines(run, _BUCKETS)
    panels = _bode_panels(response) if response is not None and len(response.frequency) else []
    if 'reference' in run and 'head' in run:
        positions = [lines.over_time('head', run.position, COLOURS[0])]
        if tracks(run):
            positions.insert(0, lines.over_time('reference', run.desired_position, GREY, wide=True))
        panels.append(
            Panel(
                'tracking',
                'Tracking' if tracks(run) else 'Head',
                'time [s]',
                f'position [{length}]',
                tuple(positions),
                over_time=True,
                close_up=_last_periods(run),
            )
        )
    if tracks(run):
        panels.append(_error_panel([run], _BUCKETS))
    if 'control' in run:
        panels.append(
            Panel(
                'control',
                'Control',
                'time [s]',
                f'control [{volt}]',
                (
                    lines.over_time('total', run.command, COLOURS[2]),
                    lines.over_time('feedback part', run.feedback, COLOURS[3]),
                ),
                over_time=True,
            )
        )
    estimates = _estimates_panel(run, lines) if 'estimates' in run else None
    panels += [estimates] if estimates else []
    if tracks(run):
        panels.append(_spectrum_panel([run], after, _BUCKETS))
    if 'reference' in run and 'head' in run:
        panels += filter(None, (_edges_panel(run), _loop_panel(run)))
    return panels


def comparison_panels(runs: Sequence[RecordedRun], after: float | None = None) -> list[Panel]:
    """Return the diagrams in which several runs lie over each other."""
    complete = [run for run in runs if tracks(run)]
    buckets = max(200, min(_BUCKETS, _COMPARED_POINTS // (2 * max(len(runs), 1))))
    panels = []
    if complete:
        panels.append(_error_panel(complete, buckets))
    controlled = [run for run in runs if 'control' in run]
    if controlled:
        panels.append(
            Panel(
                'control',
                'Control',
                'time [s]',
                f'control [{controlled[0].control_unit}]',
                tuple(
                    _Lines(run, buckets).over_time(name, run.command, colour)
                    for run, name, colour in _named(controlled)
                ),
                over_time=True,
                largest_first=True,
            )
        )
    if complete:
        panels += _last_periods_panels(complete)
        panels.append(_spectrum_panel(complete, after, buckets))
    return panels


def run_name(run: RecordedRun) -> str:
    """Return the name of the run's folder."""
    path = run.path.resolve()
    return path.parent.name if path.name == 'bag' and run.description else path.name


def run_names(runs: Sequence[RecordedRun]) -> list[str]:
    """Return a name for each of several runs, all different."""
    names = [run_name(run) for run in runs]
    return [name if names.count(name) == 1 else str(run.path) for run, name in zip(runs, names, strict=True)]


def _named(runs: Sequence[RecordedRun]) -> list[tuple[RecordedRun, str, str]]:
    colours = [COLOURS[place % len(COLOURS)] for place in range(len(runs))]
    return list(zip(runs, run_names(runs), colours, strict=True))


class _Lines:
    """Makes lines over the time of one run, decimated."""

    def __init__(self, run: RecordedRun, buckets: int) -> None:
        self._run = run
        self._buckets = buckets
        rows = len(run.ticks)
        self._in_full = [slice(0, _SAMPLES_IN_FULL), slice(max(0, rows - _SAMPLES_IN_FULL), rows)]
        if tracks(run):
            peak = int(np.abs(run.error).argmax())
            self._in_full.append(slice(max(0, peak - _SAMPLES_IN_FULL // 2), peak + _SAMPLES_IN_FULL // 2))

    def over_time(self, name: str, values: NDArray[np.float64], colour: str, wide: bool = False) -> Trace:
        rows = rows_to_draw(values, self._buckets, self._in_full)
        return Trace(name, self._run.time[rows], values[rows], colour, wide)


def _last_periods(run: RecordedRun) -> tuple[float, float] | None:
    """Return begin and end of the last periods of a smooth periodic reference [s]."""
    period = reference_period(run)
    if period is None or is_stepwise(run.desired_position):
        return None
    return run.duration - min(_PERIODS * period * run.sample_time, run.duration), run.duration


def _last_periods_panels(runs: Sequence[RecordedRun]) -> list[Panel]:
    """Return error and control of several runs in the last periods of the shortest one, sample by sample."""
    window = _last_periods(min(runs, key=lambda run: run.duration))
    if window is None or (window[1] - window[0]) / runs[0].sample_time > _LOOP_SAMPLES:
        return []
    errors, controls = [], []
    for run, name, colour in _named(runs):
        rows = slice(run.since(window[0]).start, run.since(window[1]).start + 1)
        errors.append(Trace(name, run.time[rows], run.error_factor * run.error[rows], colour))
        if 'control' in run:
            controls.append(Trace(name, run.time[rows], run.command[rows], colour))
    unit = shown_unit(runs[0].error_unit)
    panels = [Panel('last_errors', 'Tracking error, last periods', 'time [s]', f'error [{unit}]', tuple(errors))]
    if controls:
        label = f'control [{runs[0].control_unit}]'
        panels.append(Panel('last_controls', 'Control, last periods', 'time [s]', label, tuple(controls)))
    return panels


def _error_panel(runs: Sequence[RecordedRun], buckets: int) -> Panel:
    unit, factor = runs[0].error_unit, runs[0].error_factor
    return Panel(
        'error',
        'Tracking error, x - x_d',
        'time [s]',
        f'error [{shown_unit(unit)}]',
        tuple(
            _Lines(run, buckets).over_time(name, factor * run.error, colour if len(runs) > 1 else COLOURS[1])
            for run, name, colour in _named(runs)
        ),
        over_time=True,
        largest_first=True,
    )


def _bode_panels(response: FrequencyResponse) -> list[Panel]:
    """Return gain, phase and, where it was measured, coherence of a response."""
    curves = [
        ('gain', f'gain [dB, {shown_unit(response.unit)}]', decibels(response)),
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


def _estimates_panel(run: RecordedRun, lines: _Lines) -> Panel | None:
    traces: list[Trace] = []
    for name, values in run.estimates.items():
        largest = float(np.abs(values).max())
        if name in NOT_ADAPTED or np.all(values == values[0]) or len(traces) == _ESTIMATES:
            continue
        colour = COLOURS[len(traces) % len(COLOURS)]
        traces.append(lines.over_time(f'{name} (largest {largest:.3g})', values / largest, colour))
    label = 'over largest magnitude'
    return Panel('estimates', 'Estimates', 'time [s]', label, tuple(traces), over_time=True) if traces else None


def _spectrum_panel(runs: Sequence[RecordedRun], after: float | None, buckets: int) -> Panel:
    unit, factor = runs[0].error_unit, runs[0].error_factor
    traces = []
    for run, name, colour in _named(runs):
        error = factor * run.error[steady_start(run, after) :]
        if len(error) > 2:
            frequencies, amplitudes = amplitude_spectrum(error, run.sample_time)
            # The mean is taken out, and a logarithmic axis has no 0 Hz. Its low lines lie far apart.
            rows = 1 + rows_to_draw(amplitudes[1:], buckets, [slice(0, _LINES_IN_FULL)])
            traces.append(Trace(name, frequencies[rows], amplitudes[rows], colour))
    return Panel(
        'spectrum',
        'Spectrum of the position error signal',
        'frequency [Hz]',
        f'amplitude of a sine [{shown_unit(unit)}]',
        tuple(traces),
        logarithmic=True,
    )


def _edges_panel(run: RecordedRun) -> Panel | None:
    if not tracks(run) or not is_stepwise(run.desired_position):
        return None
    try:
        response = step_response(run.time, run.desired_position, run.position)
    except ValueError:
        return None
    shown = np.unique(np.linspace(0, len(response) - 1, _EDGES).round().astype(int))
    ends = np.append(response.row[1:], len(run.ticks))
    traces: list[Trace] = []
    for place in shown:
        row, height = response.row[place], response.height[place]
        rows = slice(row, min(ends[place], row + _SAMPLES_IN_FULL))
        x = 1e3 * (run.time[rows] - run.time[row])
        y = 1.0 + (run.position[rows] - run.desired_position[row]) / height
        name = f'edge at {run.time[row]:g} s'
        traces.append(Trace(name, x, y, COLOURS[len(traces) % len(COLOURS)]))
    return Panel('edges', 'Answers to the edges', 'time after the edge [ms]', 'of the height', tuple(traces))


def _loop_panel(run: RecordedRun) -> Panel | None:
    """Return friction and feedback over the position: the last periods of a periodic reference."""
    period = reference_period(run)
    if period is None or is_stepwise(run.desired_position):
        return None
    rows = min(len(run.ticks), round(period * max(1, min(_PERIODS, int(_LOOP_SAMPLES // period)))))
    part = slice(len(run.ticks) - rows, len(run.ticks), max(1, rows // _LOOP_SAMPLES))
    traces = [Trace('pivot friction', run.position[part], run.head[part, 2], COLOURS[4])]
    if 'control' in run:
        traces.append(Trace('control', run.position[part], run.command[part], COLOURS[2]))
        traces.append(Trace('its feedback part', run.position[part], run.feedback[part], COLOURS[3]))
    length = shown_unit(run.length_unit)
    return Panel(
        'loop', 'Hysteresis, last periods', f'head position [{length}]', f'[{run.control_unit}]', tuple(traces)
    )
