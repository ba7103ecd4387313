"""Assertions about a recorded run; a failed check reports value, limit and tick, and saves a plot."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import rms
from hdd_servo_ros.analysis.seek_metrics import SeekResponse
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, CONTROL, LDV, PES, Field
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import edge_responses
from hdd_servo_ros.testing.seek_checks import SeekChecks
from hdd_servo_ros.testing.track_checks import TrackChecks

plot_directory: Path | None = None
"""Directory for the plots of failed checks; None for the directory of the run. The pytest plugin sets it."""

_ERRORS = {'error': 'position_error', 'track_error': 'track_error'}
"""Attribute of a run for each error signal."""
_CLOSE_UP_ROWS = 250
_BUCKETS = 2000


class CheckFailed(AssertionError):
    """An assertion about a run does not hold."""


class Checks(TrackChecks, SeekChecks):
    """
    Assertions about one run, available as ``run.check``. Each returns this object, so that checks can be chained.

    Errors are errors of the true head position, in ``run.error_unit``: nm for a drive in um. With the servo sensor
    they are relative to the track center. Times are in s.

    Parameters
    ----------
    run
        The run.

    Raises
    ------
    CheckFailed
        If a check does not hold; the message has value, limit and tick, and a plot of the signal is saved.
    ValueError
        If a limit is not a finite number at least 0, or the window has no tick.

    Examples
    --------
    >>> from hdd_servo_ros import Run
    >>> run = Run.open('runs/first')
    >>> checks = run.check.finished().rms_error(at_most=2.0, after=0.2).peak_control(at_most=1.0).unsaturated()
    >>> isinstance(checks, hdd_servo_ros.testing.Checks)
    True
    """

    def __init__(self, run: RecordedRun) -> None:
        self._run = run

    # Completeness.

    def finished(self) -> Checks:
        """Assert that the run reached its planned end, and that every topic has all its samples, all finite."""
        __tracebackhide__ = True
        run = self._run
        if not run.description:
            raise CheckFailed(
                'run.yaml is missing, which records how a run ended: finished() needs the directory of a run, not only '
                f'a bag; samples(count) accepts a bag\n{self._where()}'
            )
        planned = run.description.get('last_tick_planned')
        if run.status != 'finished':
            held = f'the bag ends at tick {run.last_tick}' if self._has_ticks() else 'the bag holds no complete tick'
            until = '' if planned is None else f', tick {planned} was planned'
            raise CheckFailed(
                f'run {run.status}{f": {run.reason}" if run.reason else ""}; {held}{until}\n'
                f'{self._where()}{self._error_at_the_end()}'
            )
        self.samples(None if planned is None else planned + 1)
        for topic in run.counts:
            for column in np.atleast_2d(run[topic].T):
                self._require_finite('end of the run', f'a number of {topic}', column, '')
        return self

    def samples(self, count: int | None = None) -> Checks:
        """Assert that every loop topic has ``count`` messages, one per tick from 0; None: up to the last tick."""
        __tracebackhide__ = True
        run = self._run
        wanted = run.last_tick + 1 if count is None else count
        for topic, found in run.counts.items():
            # A bag may lack a topic that has no message.
            ticks = run.message_ticks(topic) if found else np.empty(0, dtype=np.int64)
            # All ticks beyond the last share one bin.
            per_tick = np.bincount(np.minimum(ticks, wanted), minlength=wanted + 1)
            wrong = np.flatnonzero(per_tick != np.append(np.ones(wanted, dtype=np.int64), 0))
            if len(wrong):
                first = int(wrong[0])
                beyond = first == wanted
                tick = int(ticks[ticks >= wanted].min()) if beyond else first
                held = f'tick {tick} is beyond the last' if beyond else f'tick {tick} has {per_tick[first]}'
                shown = per_tick[: wanted + beyond].astype(np.float64)
                rows = np.arange(len(shown))
                plot = self._plot(f'samples of {topic}', f'messages on {topic}', '', shown, None, first, ticks=rows)
                raise CheckFailed(
                    f'{topic} has {found} messages, expected {wanted}: {held} ({tick * run.sample_time:g} s)\n'
                    f'{self._where()}\nplot: {plot}'
                )
            run[topic]  # raises if the receive times are not the times of the ticks
        return self

    def parameter(self, node: str, name: str, equals: Any, tick: int | None = None) -> Checks:
        """Assert the value of a parameter at a tick (None: the last); see :meth:`RecordedRun.parameter`."""
        __tracebackhide__ = True
        value = self._run.parameter(node, name, tick)
        expected = list(equals) if isinstance(equals, tuple) else equals
        if value != expected:
            at = self._run.last_tick if tick is None else tick
            since = [
                change.tick
                for change in self._run.parameter_changes
                if change.node.endswith(node) and change.name == name and change.tick <= at
            ]
            origin = f'changed at tick {since[-1]}' if since else 'from the start'
            raise CheckFailed(
                f'{node} {name} is {value!r} at tick {at} ({origin}), not {equals!r}\n'
                f'{self._where()}{self._parameter_over_time(node, name, equals, at)}'
            )
        return self

    # Errors and signals.

    def rms_error(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the rms tracking error between two times."""
        __tracebackhide__ = True
        error, rows = self._error(after, before)
        return self._compare('rms error', rms(error[rows]), at_most, self._run.error_unit, 'error', error, rows)

    def max_error(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the peak of the tracking error between two times."""
        __tracebackhide__ = True
        error, rows = self._error(after, before)
        value = float(np.abs(error[rows]).max())
        return self._compare('max error', value, at_most, self._run.error_unit, 'error', error, rows)

    def mean_error(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the magnitude of the mean of the tracking error between two times."""
        __tracebackhide__ = True
        error, rows = self._error(after, before)
        value = abs(float(error[rows].mean()))
        return self._compare('magnitude of the mean error', value, at_most, self._run.error_unit, 'error', error, rows)

    def peak_control(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the peak of the command between two times."""
        __tracebackhide__ = True
        return self.bounded('command', at_most, after, before)

    def bounded(self, signal: str, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """
        Assert that a signal is finite and that its magnitude does not exceed a bound between two times.

        Parameters
        ----------
        signal
            ``error``, ``track_error``, ``position``, ``command``, ``feedback``, the name of an estimate such as
            ``m_hat``, or a topic with a field, such as ``control.before_saturation``, or with a column, such as
            ``control.y``. Errors are in ``run.error_unit``, other signals in the unit that the topic declares.
        at_most
            The bound.
        after, before
            Start and end of the window [s]; ``before`` is None for the end of the run.

        Raises
        ------
        LookupError
            If the run has no such signal.
        """
        __tracebackhide__ = True
        values, unit = self._signal(signal)
        rows = self._rows(after, before)
        value = float(np.abs(values[rows]).max()) if np.isfinite(values[rows]).all() else math.inf
        return self._compare(f'largest |{signal}|', value, at_most, unit, signal, values, rows)

    def unsaturated(self, after: float = 0.0) -> Checks:
        """Assert that no sensor output and no drive voltage is clipped after a time."""
        __tracebackhide__ = True
        # Imported late, since it imports the parameters of the instruments.
        from hdd_servo_ros.reporting.saturation import saturated_rows

        run, first = self._run, self._rows(after, None).start
        for topic in (LDV, PES, CONTROL):
            if topic.name in run:
                for index, field in enumerate(topic.fields):
                    values = run[topic.name][:, index]
                    self._require_finite('saturation', f'{topic.name}.{field.name}', values, field.unit_in(run.units))
        for name, rows in saturated_rows(run, run.description).items():
            late = rows[rows >= first]
            if len(late):
                signals = {
                    'displacement output': 'ldv.displacement',
                    'velocity output': 'ldv.velocity',
                    'fraction of a track': 'pes.error',
                }
                values, unit = self._signal(signals.get(name, 'command'))
                plot = self._plot(f'{name} clipped', name, unit, values, None, int(late[0]))
                raise CheckFailed(
                    f'{name} is clipped at {len(late)} of {len(run.ticks) - first} samples after {after:g} s, '
                    f'first at tick {run.ticks[late[0]]} ({run.time[late[0]]:g} s)\n{self._where()}\nplot: {plot}'
                )
        return self

    # Steps.

    def overshoot(self, at_most: float) -> Checks:
        """Assert the overshoot of the worst edge of a step or square reference [% of the edge]."""
        __tracebackhide__ = True
        return self._compare_edges('overshoot', at_most, '%', 1.0)

    def settling_time(self, at_most: float, band: float = 0.02) -> Checks:
        """Assert the time [s] after which the response to the worst edge stays within ``band`` times the edge."""
        __tracebackhide__ = True
        return self._compare_edges('settling_time', at_most, 's', 1.0, band)

    def steady_error(self, at_most: float) -> Checks:
        """Assert the mean error over the second half of the interval after the worst edge."""
        __tracebackhide__ = True
        return self._compare_edges('steady_error', at_most, self._run.error_unit, self._run.error_factor)

    # Implementation.

    def _rows(self, after: float, before: float | None) -> slice:
        rows = self._run.since(after)
        end = len(self._run.ticks) if before is None else self._run.since(before).start
        if rows.start >= end:
            until = self._run.duration if before is None else before
            raise ValueError(
                f'{self._run.path}: no tick between {after:g} s and {until:g} s; it ends at {self._run.duration:g} s'
            )
        return slice(rows.start, end)

    def _error(self, after: float, before: float | None) -> tuple[NDArray[np.float64], slice]:
        return self._run.error_factor * self._run.position_error, self._rows(after, before)

    def _signal(self, name: str) -> tuple[NDArray[np.float64], str]:
        run = self._run
        if name in _ERRORS:
            return run.error_factor * getattr(run, _ERRORS[name]), run.error_unit
        units = {'position': run.length_unit, 'command': run.control_unit, 'feedback': run.control_unit}
        if name in units:
            return getattr(run, name), units[name]
        topic, _, column = name.partition('.')
        if topic in run and column in (fields := _vector_fields(topic)):
            index, field = fields[column]
            return run[topic][:, index], '' if field is None else field.unit_in(run.units)
        if 'estimates' in run and name in run.estimates:
            return run.estimates[name], ''
        known = [*_ERRORS, *units, *(run.estimates if 'estimates' in run else ()), 'head.velocity']
        raise LookupError(f'{run.path}: unknown signal {name!r}; known signals include {", ".join(known)}')

    def _compare(
        self, what: str, value: float, at_most: float, unit: str, signal: str, values: NDArray[np.float64], rows: slice
    ) -> Checks:
        __tracebackhide__ = True
        _reject_no_limit(at_most)
        run, part = self._run, values[rows]
        # nan fails every check: a comparison with it is false.
        if value <= at_most and not np.isfinite(part).all():
            value = math.nan
        if value <= at_most:
            return self
        bad = np.flatnonzero(~np.isfinite(part))
        row = (rows.start or 0) + int(bad[0] if len(bad) else np.abs(part).argmax())
        plot = self._plot(what, signal, unit, values, at_most, row)
        raise CheckFailed(
            f'{what} is {_text(value, unit)}, above {_text(at_most, unit)}, '
            f'from {run.time[rows][0]:g} to {run.time[rows][-1]:g} s; '
            f'{signal} is largest at tick {run.ticks[row]} ({run.time[row]:g} s): {_text(values[row], unit)}\n'
            f'{self._where()}\nplot: {plot}'
        )

    def _compare_edges(self, name: str, at_most: float, unit: str, factor: float, band: float = 0.02) -> Checks:
        __tracebackhide__ = True
        _reject_no_limit(at_most)
        run = self._run
        self._require_finite(name.replace('_', ' '), 'position', run.position)
        self._require_finite(name.replace('_', ' '), 'reference', run.desired_position)
        response = edge_responses(run, band)
        values = factor * np.abs(getattr(response, name))
        worst = int(values.argmax())
        if values[worst] <= at_most:
            return self
        row, what = int(response.row[worst]), name.replace('_', ' ')
        height = _text(response.height[worst], run.length_unit)
        plot = self._plot(what, 'position', run.length_unit, run.position, None, row, run.desired_position)
        raise CheckFailed(
            f'{what} is {_text(values[worst], unit)}, above {_text(at_most, unit)}, after the edge of {height} at tick '
            f'{run.ticks[row]} ({run.time[row]:g} s), {worst + 1} of {len(values)}; '
            f'the median of all is {_text(float(np.median(values)), unit)}\n'
            f'{self._where()}\nplot: {plot}'
        )

    def _compare_seeks(
        self,
        what: str,
        values: Sequence[float],
        at_most: float,
        unit: str,
        responses: Sequence[SeekResponse],
        error: NDArray[np.float64],
        tolerance: float,
    ) -> Checks:
        __tracebackhide__ = True
        _reject_no_limit(at_most)
        # nan exceeds every limit.
        numbers = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=math.inf, posinf=math.inf)
        worst = int(numbers.argmax())
        if numbers[worst] <= at_most:
            return self
        run, response = self._run, responses[worst]
        row = response.seek.row
        has_missed = not response.has_arrived
        left = ', and leaves the tolerance again after it first arrives' if response.first_arrival < math.inf else ''
        how = f'; the head does not arrive within {_text(tolerance, run.error_unit)}{left}' if has_missed else ''
        plot = self._plot(what, 'head - target', run.error_unit, error, tolerance, row)
        raise CheckFailed(
            f'{what} is {_text(float(numbers[worst]), unit)}, above {_text(at_most, unit)}, for the seek of '
            f'{response.seek.length:+.4g} {run.length_unit} at tick {run.ticks[row]} ({run.time[row]:g} s){how}; '
            f'{int((numbers > at_most).sum())} of {len(numbers)} seeks are above\n{self._where()}\nplot: {plot}'
        )

    def _fail_at(self, what: str, signal: str, values: NDArray[np.float64], row: int) -> Checks:
        __tracebackhide__ = True
        run = self._run
        plot = self._plot(signal, signal, '', values, None, row)
        raise CheckFailed(f'{what} is at tick {run.ticks[row]} ({run.time[row]:g} s)\n{self._where()}\nplot: {plot}')

    def _require_finite(self, what: str, name: str, values: NDArray[np.float64], unit: str | None = None) -> None:
        """Fail if a signal has a value that is not finite: nan would pass comparisons."""
        __tracebackhide__ = True
        finite = np.isfinite(values)
        if finite.all():
            return
        run, row = self._run, int(np.flatnonzero(~finite)[0])
        unit = run.length_unit if unit is None else unit
        plot = self._plot(what, name, unit, values, None, row)
        raise CheckFailed(
            f'{what} is unknown: {name} is {_text(values[row], unit)} at tick {run.ticks[row]} '
            f'({run.time[row]:g} s), and at {int((~finite).sum())} ticks in all\n{self._where()}\nplot: {plot}'
        )

    def _where(self) -> str:
        run = self._run
        return f'run: {run.path} ({run.controller} on {run.frame_id}, {run.status})'

    def _has_ticks(self) -> bool:
        try:
            return len(self._run.ticks) > 0
        except BagError:
            return False

    def _error_at_the_end(self) -> str:
        """Plot the error about the last tick; return the line with the path, empty without an error signal."""
        try:
            error = self._run.error_factor * self._run.position_error
        except BagError:  # one of its topics is missing or damaged
            return ''
        row = len(error) - 1
        return f'\nplot: {self._plot("end of the run", "error", self._run.error_unit, error, None, row)}'

    def _parameter_over_time(self, node: str, name: str, equals: Any, tick: int) -> str:
        """Plot a numeric parameter; return the line with the path."""
        run = self._run
        changes = {change.tick for change in run.parameter_changes if 0 < change.tick <= run.last_tick}
        ticks = sorted({0, *changes})
        held = [run.parameter(node, name, changed) for changed in ticks]
        if not all(isinstance(value, int | float) for value in (*held, equals)):
            return ''
        values = np.array(held, dtype=np.float64)[np.searchsorted(ticks, run.ticks, side='right') - 1]
        row = int(np.searchsorted(run.ticks, tick))
        wanted = np.full(len(values), float(equals))
        return f'\nplot: {self._plot(f"{node} {name}", name, "", values, None, row, wanted)}'

    def _plot(
        self,
        what: str,
        name: str,
        unit: str,
        values: NDArray[np.float64],
        limit: float | None,
        row: int,
        reference: NDArray[np.float64] | None = None,
        ticks: NDArray[np.int64] | None = None,
    ) -> Path:
        """Plot the whole signal and a close-up about a row; return the path. ``ticks`` is None for those of the run."""
        # Imported late: only a failed test waits for matplotlib.
        from hdd_servo_ros.reporting.decimation import rows_to_draw
        from hdd_servo_ros.reporting.panel import COLORS, GRAY, CloseUp, Panel, Trace
        from hdd_servo_ros.reporting.plot import write_plot
        from hdd_servo_ros.reporting.run_names import run_name

        run = self._run
        ticks = run.ticks if ticks is None else ticks
        times: NDArray[np.float64] = np.asarray(ticks * run.sample_time, dtype=np.float64)
        nearby = slice(max(0, row - _CLOSE_UP_ROWS), min(len(values), row + _CLOSE_UP_ROWS))
        drawn = rows_to_draw(values, _BUCKETS, [nearby])
        time = times[drawn]
        traces = [] if reference is None else [Trace('reference', time, reference[drawn], GRAY, wide=True)]
        traces.append(Trace(name, time, values[drawn], COLORS[0]))
        close_up = CloseUp(float(times[nearby][0]), float(times[nearby][-1]), f'about tick {ticks[row]}')
        if limit is not None:
            # One line with a gap: both limits share a legend entry, and both appear in the close-up.
            x = np.array([time[0], close_up.start, close_up.end, time[-1]])
            y = np.full(len(x), limit)
            x, y = np.concatenate([x, [np.nan], x]), np.concatenate([y, [np.nan], -y])
            # The gap needs a time too, so that a close-up keeps it.
            x[len(y) // 2] = close_up.end
            traces.append(Trace(f'limit {_text(limit, unit)}', x, y, COLORS[1]))
        traces.append(Trace('this tick', times[[row]], values[[row]], COLORS[3], marked=True))
        label = f'{name} [{unit}]' if unit else name
        panel = Panel(name, 'whole run', 'time [s]', label, tuple(traces), close_up=close_up)
        stem = f'{run_name(run)}-{"".join(c if c.isalnum() else "_" for c in what).strip("_")}'
        path = _free_path(plot_directory or run.path, stem)
        write_plot([panel], f'{what}: {run_name(run)}', path)
        return path


def _vector_fields(name: str) -> dict[str, tuple[int, Field | None]]:
    """Return the columns of a topic with fixed fields and their declarations, by component and by field name."""
    found: dict[str, tuple[int, Field | None]] = {}
    for topic in ALL_LOOP_TOPICS:
        if topic.name == name and topic.codec.width:
            components = topic.codec.components
            found = {component: (index, None) for index, component in enumerate(components)}
            for index, field in enumerate(topic.fields):
                found[components[index]] = found[field.name] = (index, field)
    return found


def _reject_no_limit(at_most: float) -> None:
    if not (math.isfinite(at_most) and at_most >= 0.0):
        raise ValueError(f'invalid limit: at_most = {at_most!r}; expected a finite number at least 0')


def _text(value: float, unit: str) -> str:
    return f'{value:.4g} {unit}'.rstrip()


def _free_path(directory: Path, stem: str) -> Path:
    """Return an unused path for a plot, in a temporary directory if the given one is not writable."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError:
        directory = Path(tempfile.mkdtemp(prefix='hdd_servo_ros-'))
    path, number = directory / f'{stem}.png', 1
    while path.exists():
        number += 1
        path = directory / f'{stem}-{number}.png'
    return path
