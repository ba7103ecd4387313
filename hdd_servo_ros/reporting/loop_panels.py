"""Time plots of the loop signals: positions, error, command and estimates."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import TimedSignals
from hdd_servo_ros.messages.topics import CONTROL, DISTURBANCE, ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.messages.units import Units, shown
from hdd_servo_ros.reporting.chosen_rows import ChosenRows
from hdd_servo_ros.reporting.decimation import chosen_rows_to_draw, rows_to_draw
from hdd_servo_ros.reporting.evaluation import NOT_ADAPTED, changes_at_all
from hdd_servo_ros.reporting.panel import COLORS, GRAY, CloseUp, Panel, Shade, Trace
from hdd_servo_ros.reporting.seek_view import COARSE, FINE, SeekView

Array = NDArray[np.float64]

BUCKETS = 2500
TIME_LABEL = 'time [s]'
_SAMPLES_IN_FULL = 500
"""Rows at the start, around the largest error and at the end that are not decimated."""
_ESTIMATES = 8
FEEDFORWARD = 'u_ff'
"""Name of the estimate with the accelerometer feedforward."""
FEEDFORWARD_TITLE = 'Running rms of the measured error'
_SHOWN_ELSEWHERE = (FEEDFORWARD, 'ff_rms', 'ff_rms_without', 'observed_position', 'observed_velocity')
"""Estimates that are not adapted: feedforward and errors, which have their own plots, and those of the observer."""


def ends_in_full(rows: int) -> list[slice]:
    """Return the rows at the start and at the end of a run that are not decimated."""
    return [slice(0, _SAMPLES_IN_FULL), slice(max(0, rows - _SAMPLES_IN_FULL), rows)]


def peak_in_full(peak: int) -> slice:
    """Return the rows around the largest error, in row ``peak``, that are not decimated."""
    return slice(max(0, peak - _SAMPLES_IN_FULL // 2), peak + _SAMPLES_IN_FULL // 2)


class Lines:
    """
    Creates decimated lines over the time of one run that keep every peak.

    Parameters
    ----------
    signals
        The signals.
    follows
        Whether the head follows the reference; if so, the rows around the largest error are not decimated.
    close_up
        The close-up, which gets as many points as the whole run.
    buckets
        Number of buckets; see :func:`~hdd_servo_ros.reporting.decimation.rows_to_draw`.
    """

    def __init__(
        self, signals: TimedSignals, *, follows: bool, close_up: CloseUp | None = None, buckets: int = BUCKETS
    ) -> None:
        self._time = signals.time
        self._buckets = buckets
        self._chosen = signals if isinstance(signals, ChosenRows) else None
        rows = len(self._time) if self._chosen is None else self._chosen.row_count
        in_full = ends_in_full(rows)
        if follows:
            peak = int(np.abs(signals.position_error).argmax())
            in_full.append(peak_in_full(peak if self._chosen is None else int(self._chosen.ticks[peak])))
        self._in_full = [self._available(part) for part in in_full]
        self._large = slice(0, 0)
        if close_up is not None:
            begin, end = np.searchsorted(self._time, (close_up.start, close_up.end), side='left')
            self._large = slice(int(begin), int(end) + 1)

    def _available(self, rows: slice) -> slice:
        """Return the available rows within a stretch of the whole run."""
        if self._chosen is None:
            return rows
        begin, end = np.searchsorted(self._chosen.ticks, (rows.start, rows.stop)).tolist()
        return slice(begin, end)

    def over_time(self, name: str, values: Array, color: str, wide: bool = False) -> Trace:
        """Return a signal, shape (n,), as a line."""
        if self._chosen is None:
            rows = rows_to_draw(values, self._buckets, self._in_full)
        else:
            rows = chosen_rows_to_draw(values, self._chosen.ticks, self._chosen.row_count, self._buckets, self._in_full)
        large = values[self._large]
        if len(large):
            rows = np.union1d(rows, self._large.start + rows_to_draw(large, BUCKETS))
        return Trace(name, self._time[rows], values[rows], color, wide)


def loop_panels(
    signals: TimedSignals, *, follows: bool, close_up: CloseUp | None = None, seeks: SeekView | None = None
) -> list[Panel]:
    """
    Return the time plots, without those whose topics are missing.

    Parameters
    ----------
    signals
        The signals.
    follows
        Whether the head follows the reference; otherwise reference and error are omitted.
    close_up
        The close-up.
    seeks
        Target and mode of a run with seeks, whose error from the target is plotted on two scales.
    """
    lines = Lines(signals, follows=follows, close_up=close_up)
    length, volt = shown(signals.units.length), shown(signals.units.control)
    panels: list[Panel] = []

    def add(
        name: str,
        title: str,
        y_label: str,
        traces: list[Trace],
        largest_first: bool = False,
        y_range: tuple[float, float] | None = None,
        shades: tuple[Shade, ...] = (),
    ) -> None:
        panels.append(
            Panel(
                name,
                title,
                TIME_LABEL,
                y_label,
                tuple(traces),
                over_time=True,
                largest_first=largest_first,
                y_range=y_range,
                close_up=close_up,
                shades=shades,
            )
        )

    if REFERENCE.name in signals and HEAD.name in signals:
        head = lines.over_time('head', signals.position, COLORS[0])
        if follows and seeks is not None:
            shades = seeks.shades(signals.time)
            position, errors = _seek_lines(signals, lines, seeks)
            title = 'Seeks' if seeks.mode is None else 'Seeks; not shaded: mode follow'
            add('tracking', title, f'position [{length}]', [*position, head], shades=shades)
            label, factor = error_label(signals.units), signals.units.error_factor
            for name, scale, half in (('error', 'coarse', COARSE), ('error_fine', 'fine', FINE)):
                limit = factor * half
                title = f'Position error, {scale} scale'
                add(name, title, label, errors, y_range=(-limit, limit), shades=shades)
        elif follows:
            reference = lines.over_time('reference', signals.desired_position, GRAY, wide=True)
            add('tracking', 'Tracking', f'position [{length}]', [reference, head])
            add(
                'error',
                error_title([signals]),
                error_label(signals.units),
                [lines.over_time(error_name(signals), signals.units.error_factor * signals.position_error, COLORS[1])],
            )
        else:
            add('tracking', 'Head', f'position [{length}]', [head])
    if CONTROL.name in signals:
        total = lines.over_time('total', signals.command, COLORS[2])
        feedback = lines.over_time('feedback part', signals.feedback, COLORS[3])
        add('control', 'Control', f'control [{volt}]', [total, feedback], largest_first=True)
    if DISTURBANCE.name in signals and signals.disturbance.force.any():
        forces = _forces(signals, lines)
        add('disturbance', 'Disturbance', f'force [{volt}]', forces, largest_first=True)
    if ESTIMATES.name in signals and FEEDFORWARD in signals.estimates and follows:
        compared = _with_and_without(signals, lines)
        add('feedforward', FEEDFORWARD_TITLE, f'rms error [{shown(signals.units.error)}]', compared)
    estimates = _estimates(signals, lines) if ESTIMATES.name in signals else []
    if estimates:
        add('estimates', 'Estimates', 'normalized by the peak', estimates)
    return panels


def error_title(shown: Sequence[TimedSignals]) -> str:
    """Return the title of a plot of position errors."""
    kinds = {signals.is_track_following for signals in shown}
    if len(kinds) > 1:
        return 'Position error, x - x_d, with the servo sensor minus the track center'
    return 'Track error, x - x_d - track center' if kinds == {True} else 'Tracking error, x - x_d'


def error_name(signals: TimedSignals, less: str = 'reference') -> str:
    """Return the terms of the position error of a run, from the reference or from another position."""
    return f'head - {less} - track center' if signals.is_track_following else f'head - {less}'


def error_label(units: Units) -> str:
    """Return the label of an error axis."""
    return f'error [{shown(units.error)}]'


def _seek_lines(signals: TimedSignals, lines: Lines, seeks: SeekView) -> tuple[list[Trace], list[Trace]]:
    """Return the lines of the target and the trajectory, and the errors of the head from both."""
    factor = signals.units.error_factor
    position = [_stairs(lines.over_time('target', seeks.target, GRAY, wide=True))]
    error = factor * (signals.position_error + signals.desired_position - seeks.target)
    errors = [lines.over_time(error_name(signals, 'target'), error, COLORS[1])]
    if not np.array_equal(seeks.target, signals.desired_position):
        position.append(lines.over_time('trajectory', signals.desired_position, COLORS[3]))
        errors.insert(0, lines.over_time(error_name(signals, 'trajectory'), factor * signals.position_error, COLORS[3]))
    return position, errors


def _stairs(trace: Trace) -> Trace:
    """Return a step line, which holds each value until the next point."""
    return dataclasses.replace(trace, x=np.repeat(trace.x, 2)[1:], y=np.repeat(trace.y, 2)[:-1])


def _forces(signals: TimedSignals, lines: Lines) -> list[Trace]:
    """Return the disturbance force, and the feedforward that cancels it."""
    has_feedforward = ESTIMATES.name in signals and FEEDFORWARD in signals.estimates
    # Wide, so that it remains visible below a feedforward that is nearly equal.
    forces = [lines.over_time('force against u', signals.disturbance.force, COLORS[4], wide=has_feedforward)]
    if has_feedforward:
        forces.append(lines.over_time('feedforward', signals.estimates[FEEDFORWARD], COLORS[5]))
    return forces


def _with_and_without(signals: TimedSignals, lines: Lines) -> list[Trace]:
    """Return the running rms of the error, and its estimate without feedforward by the supervisor."""
    factor, estimates = signals.units.error_factor, signals.estimates
    return [
        lines.over_time('without feedforward, estimated', factor * estimates['ff_rms_without'], GRAY, wide=True),
        lines.over_time('with feedforward', factor * estimates['ff_rms'], COLORS[1]),
    ]


def _estimates(signals: TimedSignals, lines: Lines) -> list[Trace]:
    """Return the adapted estimates, each normalized by its peak, which its name states."""
    traces: list[Trace] = []
    for name, values in signals.estimates.items():
        if name in NOT_ADAPTED or name in _SHOWN_ELSEWHERE or not changes_at_all(values) or len(traces) == _ESTIMATES:
            continue
        largest = float(np.abs(values).max())
        color = COLORS[len(traces) % len(COLORS)]
        traces.append(lines.over_time(f'{name} (largest {largest:.3g})', values / largest, color))
    return traces
