"""
Results of a long run, computed block by block.

The first pass computes the sums of the verdict, the statistics of error and command, the edges of the reference and the
rows of the time plots. A second pass computes the results that depend on the first: the responses to edges, and the
spectrum without repeatable runout.
"""

import functools
import weakref

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import StepResponse
from hdd_servo_ros.analysis.streamed_steps import StreamedEdges, StreamedSteps
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.topics import CONTROL, DISTURBANCE, REFERENCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.chosen_rows import ChosenRows, RowChooser
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_control import LongControl
from hdd_servo_ros.reporting.long_errors import LongCumulative, LongError, LongTrack
from hdd_servo_ros.reporting.long_runs import BLOCK, blocks, rows_of
from hdd_servo_ros.reporting.loop_panels import BUCKETS, ends_in_full, peak_in_full
from hdd_servo_ros.reporting.reference_period import control_cycles, reference_period, whole_periods
from hdd_servo_ros.reporting.run_sums import keep_sums, new_sums
from hdd_servo_ros.reporting.track_of_run import sectors_of, track_pitch

Array = NDArray[np.float64]


class LongFigures:
    """
    Results of a long run.

    Parameters
    ----------
    run
        A long run.
    after
        Start of the window [s]; see :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.

    Raises
    ------
    ValueError
        If the run ends before that time.
    """

    def __init__(self, run: RecordedRun, after: float | None) -> None:
        self._run = weakref.ref(run)
        self._count, self._start = run.row_count, steady_start(run, after)
        self._late = self._count - self._start
        if self._late <= 0:
            raise ValueError(f'{run.path}: no samples after {after} s: the run ends at {run.duration:g} s')
        self._follows, self._sample_time = follows_reference(run), run.sample_time
        self._has_track = self._follows and DISTURBANCE.name in run
        self._sectors = sectors_of(run) if self._has_track else 0
        period = reference_period(run) if self._follows else None
        whole = 0 if period is None or self._late < 2.0 * period else whole_periods(period).numerator
        self.error = LongError(self._late, run.sample_time, whole) if self._follows else None
        self.track = LongTrack(self._late, self._sectors, track_pitch(run)) if self._has_track else None
        self.control = LongControl(self._start, *control_cycles(run, self._start)) if CONTROL.name in run else None
        self.edges = StreamedEdges(self._count) if REFERENCE.name in run else None
        self._cumulative = LongCumulative(self._late, run.sample_time) if self._has_track else None
        self._first_offset = 0.0
        self._largest_error = -np.inf
        self._peak = 0
        self._chooser = RowChooser(self._count, BUCKETS, ends_in_full(self._count))
        sums = new_sums(run, after)
        for block in blocks(run, self._block_size):
            sums.add(block)
            self._chooser.add(block)
            self._add(block)
        keep_sums(run, after, sums)

    @property
    def _block_size(self) -> int:
        return self._chooser.size * max(1, BLOCK // self._chooser.size)

    def _late_rows(self, block: SignalRows) -> slice:
        return slice(max(self._start - block.first_tick, 0), None)

    def _add(self, block: SignalRows) -> None:
        late = self._late_rows(block)
        if self.edges is not None:
            self.edges.add(block.desired_position)
        if self.control is not None:
            self.control.add(block)
        if self.error is not None:
            error = block.position_error
            if block.first_tick == 0:
                self._first_offset = float(block.desired_position[0] - block.position[0])
            magnitude = np.abs(error)
            row = int(magnitude.argmax())
            if not magnitude[row] <= self._largest_error and not np.isnan(self._largest_error):
                self._largest_error, self._peak = float(magnitude[row]), block.first_tick + row
            self.error.add(block.units.error_factor * error[late])
        if self.track is not None and self._cumulative is not None:
            self.track.add(block.track_error[late])
            self._cumulative.add(block.units.error_factor * block.track_error[late])

    @property
    def is_stepwise(self) -> bool:
        """Whether the reference is constant except for a few steps."""
        return self.edges is not None and self.edges.is_stepwise

    @functools.cached_property
    def cumulative_spectrum(self) -> tuple[Array, Array]:
        """Cumulative spectrum of the track error of a run with a disturbance."""
        assert self._cumulative is not None
        return self._cumulative.result()

    @functools.cached_property
    def _second(self) -> '_SecondPass':
        run = self._run()
        assert run is not None
        second = _SecondPass(self, run)
        for block in blocks(run):
            second.add(block)
        return second

    @property
    def steps(self) -> StepResponse | None:
        """Responses of the head to the edges of a stepwise reference; None without an edge."""
        if not (self.is_stepwise and self._follows):
            return None
        steps = self._second.steps
        return None if steps is None else steps.response(self._sample_time)

    @property
    def cumulative_without_runout(self) -> tuple[Array, Array] | None:
        """Cumulative spectrum without repeatable runout; None if the revolutions are unknown."""
        if self.track is None or self.track.revolutions is None:
            return None
        return self._second.cumulative.result()

    @functools.cached_property
    def rows_over_time(self) -> ChosenRows:
        """The rows of the time plots, without a close-up."""
        run = self._run()
        assert run is not None
        chosen = self._chooser.chosen()
        return chosen.with_stretches(rows_of(run, peak_in_full(self._peak))) if self._follows else chosen


class _SecondPass:
    """Results that depend on the edges and the repeatable runout."""

    def __init__(self, figures: LongFigures, run: RecordedRun) -> None:
        self._start = figures._start
        self.steps: StreamedSteps | None = None
        if figures.edges is not None and figures.is_stepwise:
            try:
                self.steps = StreamedSteps(figures.edges, figures._count, figures._first_offset)
            except ValueError:
                # A constant reference.
                self.steps = None
        self.cumulative = LongCumulative(figures._late, run.sample_time)
        revolutions = None if figures.track is None else figures.track.revolutions
        self._mean = None if revolutions is None else revolutions.waveform
        self._is_first = True

    def add(self, block: SignalRows) -> None:
        """Add the rows of the next block."""
        if self.steps is not None:
            position = block.relative_position
            if block.first_tick == 0:
                # The position of the track at the first tick is not an edge.
                position = np.array(position)
                position[0] = block.position[0]
            self.steps.add(block.desired_position, position)
        if self._mean is not None:
            first = max(block.first_tick, self._start)
            error = block.track_error[first - block.first_tick :]
            index = np.arange(first - self._start, first - self._start + len(error))
            self.cumulative.add(block.units.error_factor * (error - self._mean[index % len(self._mean)]))


_FOUND: weakref.WeakKeyDictionary[RecordedRun, dict[float | None, LongFigures]] = weakref.WeakKeyDictionary()


def long_figures(run: RecordedRun, after: float | None = None) -> LongFigures:
    """Return the results of a long run, computed once; for ``after`` see :func:`~.evaluation.transient_end`."""
    found = _FOUND.setdefault(run, {})
    if after not in found:
        found[after] = LongFigures(run, after)
    return found[after]
