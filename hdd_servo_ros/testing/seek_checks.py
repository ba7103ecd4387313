"""Assertions about the seeks of a run: seek time, overshoot and residual vibration."""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.seek_metrics import SAMPLES, SeekResponse, returns_to_earlier_modes, targets_over_time
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.seeks_of_run import (
    measured_position,
    modes_of,
    responses_of,
    seeks_of,
    time_optimal_times,
    tolerance_of,
)

if TYPE_CHECKING:
    from hdd_servo_ros.testing.checks import Checks


class SeekChecks(abc.ABC):
    """
    Assertions about the seeks of a run, part of ``run.check``.

    A run has seeks if its reference has the waveform ``seek``, or if it has steps and a controller with the estimate
    ``seek_mode``. Each check applies to every seek whose length is from ``shortest`` to ``longest``, in the unit of
    the drive; a run without such a seek raises ValueError. A seek that does not arrive has an infinite seek time.
    """

    _run: RecordedRun

    @abc.abstractmethod
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
        """Compare the value of each seek with its limit."""

    @abc.abstractmethod
    def _fail_at(self, what: str, signal: str, values: NDArray[np.float64], row: int) -> Checks:
        """Fail with a plot of a signal about a row."""

    def seek_time(
        self,
        at_most: float,
        tolerance: float | None = None,
        *,
        shortest: float = 0.0,
        longest: float = np.inf,
        samples: int = SAMPLES,
        stay: float | None = None,
        measured: bool = False,
    ) -> Checks:
        """
        Assert the seek time [s] of every seek: from the change of the target until the head has arrived.

        Parameters
        ----------
        at_most
            The limit [s].
        tolerance
            Largest position error on target, in ``run.error_unit``; None for 10 % of the track pitch.
        shortest, longest
            Lengths of the seeks to check.
        samples
            Number of consecutive samples within the tolerance that make an arrival.
        stay
            Time after the arrival in which no sample may leave the tolerance [s]; None until the next seek.
        measured
            Whether to use the measured position instead of the true one.

        Raises
        ------
        ValueError
            If the run has no such seek, or no tolerance is given and the track pitch is unknown.
        """
        __tracebackhide__ = True

        def time(response: SeekResponse) -> float:
            return response.seek_time

        what = 'measured seek time' if measured else 'seek time'
        return self._check_seeks(what, time, at_most, 's', tolerance, shortest, longest, samples, stay, measured)

    def seek_overshoot(
        self, at_most: float, tolerance: float | None = None, *, shortest: float = 0.0, longest: float = np.inf
    ) -> Checks:
        """Assert the overshoot beyond the target until 10 ms after the arrival; see :meth:`seek_time`."""
        __tracebackhide__ = True
        run = self._run

        def overshoot(response: SeekResponse) -> float:
            return run.error_factor * response.overshoot

        what, unit = 'overshoot of a seek', run.error_unit
        return self._check_seeks(what, overshoot, at_most, unit, tolerance, shortest, longest)

    def residual_vibration(
        self, at_most: float, tolerance: float | None = None, *, shortest: float = 0.0, longest: float = np.inf
    ) -> Checks:
        """
        Assert the rms of the position error about its mean in the 10 ms after the arrival; see :meth:`seek_time`.

        It is infinite for a seek that does not arrive.
        """
        __tracebackhide__ = True
        run = self._run

        def residual(response: SeekResponse) -> float:
            return run.error_factor * response.residual_rms if response.has_arrived else np.inf

        what, unit = 'residual vibration, rms,', run.error_unit
        return self._check_seeks(what, residual, at_most, unit, tolerance, shortest, longest)

    def seek_time_over_optimal(
        self, at_most: float, tolerance: float | None = None, *, shortest: float = 0.0, longest: float = np.inf
    ) -> Checks:
        """Assert the ratio of the seek time to T*, the time-optimal seek time of the rigid body."""
        __tracebackhide__ = True
        optimal = time_optimal_times(self._run, list(seeks_of(self._run)))
        if optimal is None:
            raise ValueError(
                f'{self._run.path}: the time-optimal seek time is unknown: run.yaml lacks the drive, or it has no '
                'rigid body (resonance.form modes)'
            )
        by_row = {seek.row: time for seek, time in zip(seeks_of(self._run), optimal.tolist(), strict=True)}

        def ratio(response: SeekResponse) -> float:
            return float(response.seek_time / by_row[response.seek.row])

        return self._check_seeks('seek time over T*', ratio, at_most, '', tolerance, shortest, longest)

    def no_return_to_an_earlier_mode(self) -> Checks:
        """
        Assert that the controller switches from seek to settle to follow in every seek, and never back.

        Raises
        ------
        ValueError
            If the run has no seeks, or its controller has no estimate ``seek_mode``.
        """
        __tracebackhide__ = True
        run, modes = self._run, modes_of(self._run)
        if modes is None:
            raise ValueError(f'{run.path}: the controller has no estimate seek_mode')
        self._require_seeks()
        rows = returns_to_earlier_modes(modes, seeks_of(run))
        if not rows:
            return cast('Checks', self)
        names = ('follow', 'seek', 'settle')
        before, after = (names[int(modes[row])] for row in (rows[0] - 1, rows[0]))
        what = f'the controller returns from {before} to {after}, the first of {len(rows)} returns,'
        return self._fail_at(what, 'seek_mode', modes, rows[0])

    # Implementation.

    def _require_seeks(self) -> None:
        if not seeks_of(self._run):
            raise ValueError(
                f'{self._run.path}: the run has no seeks: expected a reference with the waveform seek, or steps and a '
                'controller with the estimate seek_mode'
            )

    def _check_seeks(
        self,
        what: str,
        number: Callable[[SeekResponse], float],
        at_most: float,
        unit: str,
        tolerance: float | None,
        shortest: float,
        longest: float,
        samples: int = SAMPLES,
        stay: float | None = None,
        measured: bool = False,
    ) -> Checks:
        __tracebackhide__ = True
        run = self._run
        self._require_seeks()
        of_pitch = tolerance_of(run)
        if tolerance is None and of_pitch is None:
            raise ValueError(
                f'{run.path}: the track pitch is in um, and this drive is in {run.length_unit}; give tolerance='
            )
        width = of_pitch if tolerance is None else tolerance / run.error_factor
        assert width is not None
        # The difference of two targets may differ from the requested length in its last bits.
        chosen = [
            response
            for response in responses_of(run, width, stay, samples, measured=measured)
            if shortest * (1.0 - 1e-9) <= abs(response.seek.length) <= longest * (1.0 + 1e-9)
        ]
        if not chosen:
            raise ValueError(f'{run.path}: no seek from {shortest:g} to {longest:g} {run.length_unit}')
        seeks = seeks_of(run)
        target = targets_over_time(seeks, seeks[0].origin, len(run.ticks))
        position = measured_position(run) if measured else run.relative_position
        error = run.error_factor * (position - target)
        values = [number(response) for response in chosen]
        return self._compare_seeks(what, values, at_most, unit, chosen, error, run.error_factor * width)
