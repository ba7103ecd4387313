"""Assertions about the track error of a run: how well the head follows a disturbed track."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.analysis.off_track import WRITE_LIMIT, ShockResponse, off_track, shock_responses
from hdd_servo_ros.analysis.runout import RunoutParts, runout_parts
from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.track_of_run import sectors_of, shocks_of, track_pitch, why_no_sectors

if TYPE_CHECKING:
    from hdd_servo_ros.testing.checks import Checks

_SIGNAL = 'track_error'


class TrackChecks(abc.ABC):
    """
    Assertions about the track error, head - reference - track center, in ``run.error_unit``; part of ``run.check``.

    Without a disturbance the track error is the tracking error.
    """

    _run: RecordedRun

    @abc.abstractmethod
    def _rows(self, after: float, before: float | None) -> slice:
        """Return the rows between two times."""

    @abc.abstractmethod
    def _compare(
        self, what: str, value: float, at_most: float, unit: str, signal: str, values: NDArray[np.float64], rows: slice
    ) -> Checks:
        """Compare a value with its limit."""

    @abc.abstractmethod
    def _require_finite(self, what: str, name: str, values: NDArray[np.float64], unit: str | None = None) -> None:
        """Fail if a signal has a value that is not finite."""

    def track_error(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the 3 sigma track error between two times."""
        __tracebackhide__ = True
        error, rows = self._track_error(after, before)
        return self._check('track error, 3 sigma,', misregistration(error[rows]), at_most, error, rows)

    def peak_track_error(self, at_most: float, after: float = 0.0, before: float | None = None) -> Checks:
        """Assert the peak of the track error between two times."""
        __tracebackhide__ = True
        error, rows = self._track_error(after, before)
        return self._check('peak track error', float(np.abs(error[rows]).max()), at_most, error, rows)

    def rpe(
        self, at_most: float, after: float = 0.0, before: float | None = None, sectors: int | None = None
    ) -> Checks:
        """Assert the peak-to-peak repeatable position error over complete revolutions; see :meth:`nrpe`."""
        __tracebackhide__ = True
        parts, error, rows = self._runout(after, before, sectors)
        return self._check('RPE, peak to peak,', parts.repeatable_peak_to_peak, at_most, error, rows)

    def nrpe(
        self, at_most: float, after: float = 0.0, before: float | None = None, sectors: int | None = None
    ) -> Checks:
        """
        Assert the 3 sigma non-repeatable position error over the complete revolutions between two times.

        Parameters
        ----------
        at_most
            The limit.
        after, before
            Start and end of the window [s]; ``before`` is None for the end of the run.
        sectors
            Samples per revolution; None for the value of the run's ``disturbance_generator``.

        Raises
        ------
        ValueError
            If a revolution is not an integer number of samples, or the window has fewer than two revolutions.
        """
        __tracebackhide__ = True
        parts, error, rows = self._runout(after, before, sectors)
        return self._check('NRPE, 3 sigma,', parts.non_repeatable_three_sigma, at_most, error, rows)

    def time_off_track(
        self, at_most: float, beyond: float = WRITE_LIMIT, after: float = 0.0, before: float | None = None
    ) -> Checks:
        """Assert the fraction of samples (0 to 1) whose track error exceeds ``beyond`` times the track pitch."""
        __tracebackhide__ = True
        error, rows = self._track_error(after, before)
        found = off_track(error[rows], self._of_pitch(beyond), self._run.sample_time)
        what = f'fraction of time more than {100.0 * beyond:g} % of pitch off track'
        return self._compare(what, found.fraction, at_most, '', _SIGNAL, error, rows)

    def longest_off_track(
        self, at_most: float, beyond: float = WRITE_LIMIT, after: float = 0.0, before: float | None = None
    ) -> Checks:
        """Assert the longest time [s] for which the track error exceeds ``beyond`` times the track pitch."""
        __tracebackhide__ = True
        error, rows = self._track_error(after, before)
        found = off_track(error[rows], self._of_pitch(beyond), self._run.sample_time)
        what = f'longest time more than {100.0 * beyond:g} % of pitch off track'
        return self._compare(what, found.longest, at_most, 's', _SIGNAL, error, rows)

    def shock_peak(self, at_most: float, shocks: Sequence[float] | None = None) -> Checks:
        """Assert the largest track error after the worst shock; see :meth:`shock_recovery`."""
        __tracebackhide__ = True
        error, responses = self._shocks(shocks, 0.0)
        rows = slice(self._run.since(responses[0].time).start, len(error))
        return self._check('peak after a shock', max(response.peak for response in responses), at_most, error, rows)

    def shock_outside(self, at_most: float, band: float, shocks: Sequence[float] | None = None) -> Checks:
        """Assert the time [s] outside the band after the worst shock; see :meth:`shock_recovery`."""
        __tracebackhide__ = True
        return self._shock_time('outside', 'time outside the band after a shock', at_most, band, shocks)

    def shock_recovery(self, at_most: float, band: float, shocks: Sequence[float] | None = None) -> Checks:
        """
        Assert the time [s] from the start of the worst shock until the track error stays within the band.

        Parameters
        ----------
        at_most
            The limit [s].
        band
            Half width of the band, in ``run.error_unit``.
        shocks
            Start times of the shocks [s]; None to find them on `/base_acceleration`. Each lasts until the next.

        Raises
        ------
        ValueError
            If the run has no shock.
        """
        __tracebackhide__ = True
        return self._shock_time('recovery', 'time to recover from a shock', at_most, band, shocks)

    def error_over_least(self, at_most: float, after: float = 0.0) -> Checks:
        """
        Assert the ratio of the 3 sigma track error to its lower bound for feedback alone, without repeatable runout.

        Raises
        ------
        ValueError
            If the lower bound is unknown; the message has the reason.
        """
        __tracebackhide__ = True
        # Imported late: it solves an optimization problem with the linear drive.
        from hdd_servo_ros.reporting.run_bound import run_bound, why_no_bound

        error, rows = self._track_error(after, None)
        bound = run_bound(self._run, rows.start)
        if bound is None:
            raise ValueError(
                f'{self._run.path}: unknown lower bound of the error: {why_no_bound(self._run, rows.start)}'
            )
        return self._compare(
            'track error over its lower bound',
            bound.reached / bound.three_sigma,
            at_most,
            '',
            _SIGNAL,
            error,
            rows,
        )

    # Implementation.

    def _check(self, what: str, value: float, at_most: float, error: NDArray[np.float64], rows: slice) -> Checks:
        __tracebackhide__ = True
        return self._compare(what, value, at_most, self._run.error_unit, _SIGNAL, error, rows)

    def _track_error(self, after: float, before: float | None) -> tuple[NDArray[np.float64], slice]:
        return self._run.error_factor * self._run.track_error, self._rows(after, before)

    def _of_pitch(self, fraction: float) -> float:
        pitch = track_pitch(self._run)
        if pitch is None:
            raise ValueError(
                f'{self._run.path}: the track pitch is in um, and this drive is in {self._run.length_unit}'
            )
        return self._run.error_factor * fraction * pitch

    def _runout(
        self, after: float, before: float | None, sectors: int | None
    ) -> tuple[RunoutParts, NDArray[np.float64], slice]:
        error, rows = self._track_error(after, before)
        used = sectors_of(self._run) if sectors is None else sectors
        if not used:
            raise ValueError(f'{self._run.path}: RPE and NRPE are unknown: {why_no_sectors(self._run)}; give sectors=')
        return runout_parts(error[rows], used), error, rows

    def _shocks(self, shocks: Sequence[float] | None, band: float) -> tuple[NDArray[np.float64], list[ShockResponse]]:
        run = self._run
        if shocks is None and BASE_ACCELERATION.name in run:
            # A shock of nan would not be found.
            for name, values in zip(BASE_ACCELERATION.field_names, run[BASE_ACCELERATION.name].T, strict=True):
                self._require_finite('shock response', f'{BASE_ACCELERATION.name}.{name}', values, '')
        times = shocks_of(run).tolist() if shocks is None else list(shocks)
        if not times:
            raise ValueError(f'{run.path}: no shock on /base_acceleration; give shocks=')
        error = run.error_factor * run.track_error
        return error, shock_responses(run.time, error, times, band)

    def _shock_time(self, name: str, what: str, at_most: float, band: float, shocks: Sequence[float] | None) -> Checks:
        __tracebackhide__ = True
        error, responses = self._shocks(shocks, band)
        rows = slice(self._run.since(responses[0].time).start, len(error))
        value = max(getattr(response, name) for response in responses)
        return self._compare(what, value, at_most, 's', _SIGNAL, error, rows)
