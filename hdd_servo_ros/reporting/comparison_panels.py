"""Plots that overlay several runs; the runs that track set the scale."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import TimedSignals
from hdd_servo_ros.messages.topics import CONTROL
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.evaluation import follows_reference
from hdd_servo_ros.reporting.loop_panels import BUCKETS, TIME_LABEL, Lines, error_label, error_title
from hdd_servo_ros.reporting.over_time import signals_over_time
from hdd_servo_ros.reporting.panel import COLORS, GRAY, CloseUp, Panel, Trace, fitted_range
from hdd_servo_ros.reporting.run_names import run_names
from hdd_servo_ros.reporting.run_panels import spectrum_line, spectrum_panel
from hdd_servo_ros.reporting.seek_panels import access_times_of_runs
from hdd_servo_ros.reporting.verdict import Verdict, verdict_of

_POINTS = 20_000
"""Largest number of points of all runs of a comparison in one time plot."""


@dataclasses.dataclass(frozen=True)
class Compared:
    """A run of a comparison: name, color, verdict, and the start of the window [s], if given."""

    run: RecordedRun
    name: str
    color: str
    verdict: Verdict | None
    after: float | None = None


def compared(runs: Mapping[str, RecordedRun], after: float | None = None) -> list[Compared]:
    """Return named runs with a color and a verdict each."""
    return [
        Compared(run, name, COLORS[index % len(COLORS)], verdict_of(run, after), after)
        for index, (name, run) in enumerate(runs.items())
    ]


def comparison_panels(runs: Sequence[RecordedRun], after: float | None = None) -> list[Panel]:
    """
    Return the plots that overlay several runs.

    Parameters
    ----------
    runs
        The runs.
    after
        Start of the window of spectrum and verdict [s]; None to skip the first half of each run, at most 2 s.
    """
    items = compared(dict(zip(run_names(runs), runs, strict=True)), after)
    following = [item for item in items if follows_reference(item.run)]
    controlled = [item for item in items if CONTROL.name in item.run]
    close_up = _common_close_up(following or controlled)
    panels = []
    if following:
        panels.append(error_panel(following, close_up))
    if controlled:
        label = f'control [{shown(controlled[0].run.control_unit)}]'
        traces = _lines(controlled, close_up, lambda signals: signals.command)
        panels.append(_over_time('control', 'Control', label, traces, close_up))
    seeks = access_times_of_runs({item.name: (item.run, item.color) for item in following})
    if seeks is not None:
        panels.append(seeks)
    if following:
        lines = (spectrum_line(item.name, item.run, after, item.color, _buckets(following)) for item in following)
        panels.append(spectrum_panel([line for line in lines if line is not None], following[0].run.units))
    return panels


def error_panel(items: Sequence[Compared], close_up: CloseUp | None) -> Panel:
    """Return the plot of the position errors of several runs."""
    traces = _lines(items, close_up, lambda signals: signals.units.error_factor * signals.position_error)
    return _over_time(
        'error', error_title([item.run for item in items]), error_label(items[0].run.units), traces, close_up
    )


def position_panel(items: Sequence[Compared], close_up: CloseUp | None) -> Panel:
    """Return the plot of the head positions of several runs of one experiment, with its reference."""
    # A failed run ends early.
    run = max((item.run for item in items), key=lambda run: run.duration)
    signals = signals_over_time(run, items[0].after, close_up)
    lines = Lines(signals, follows=True, close_up=close_up, buckets=_buckets(items))
    reference = lines.over_time('reference', signals.desired_position, GRAY, wide=True)
    heads = _lines(items, close_up, lambda signals: signals.position, reference)
    panel = _over_time('tracking', 'Tracking', f'position [{shown(run.length_unit)}]', (reference, *heads), close_up)
    # The reference is drawn below the head positions, whatever its size.
    return dataclasses.replace(panel, largest_first=False)


def _over_time(name: str, title: str, label: str, traces: tuple[Trace, ...], close_up: CloseUp | None) -> Panel:
    return Panel(name, title, TIME_LABEL, label, traces, over_time=True, largest_first=True, close_up=close_up)


def _common_close_up(items: Sequence[Compared]) -> CloseUp | None:
    """Return the close-up of the shortest run."""
    return close_up_of(min((item.run for item in items), key=lambda run: run.duration)) if items else None


def _buckets(items: Sequence[Compared]) -> int:
    return max(200, min(BUCKETS, _POINTS // (2 * max(len(items), 1))))


def _lines(
    items: Sequence[Compared],
    close_up: CloseUp | None,
    signal: Callable[[TimedSignals], NDArray[np.float64]],
    *others: Trace,
) -> tuple[Trace, ...]:
    """
    Return one signal of each run as a line.

    The runs that track and the other lines of the plot set the scale of the axis. A run that does not track is clipped
    outside that range, and its legend entry states both.
    """
    lines = []
    for item in items:
        signals = signals_over_time(item.run, item.after, close_up)
        drawn = Lines(signals, follows=follows_reference(item.run), close_up=close_up, buckets=_buckets(items))
        lines.append(drawn.over_time(item.name, signal(signals), item.color))
    judged = [(line, item.verdict) for line, item in zip(lines, items, strict=True)]
    # A run without a verdict follows no reference.
    tracking = [line.y for line, verdict in judged if verdict is not None and verdict.tracks]
    scale = fitted_range([*tracking, *(line.y for line in others)]) if tracking else None
    return tuple(_named(line, verdict, scale) for line, verdict in judged)


def _named(line: Trace, verdict: Verdict | None, scale: tuple[float, float] | None) -> Trace:
    if verdict is None or verdict.tracks:
        return line
    clipped = scale is not None and not bool(np.all((line.y >= scale[0]) & (line.y <= scale[1])))
    name = f'{line.name} ({verdict.text}{", clipped" if clipped else ""})'
    return dataclasses.replace(line, name=name, clipped=clipped)
