"""
Lower bound of the position error under linear feedback with a limited peak sensitivity, from disturbance spectra.

Variance and sensitivity are a quadratic and an affine function of the taps of an FIR filter Q (see
:mod:`hdd_servo_ros.analysis.feedback_responses`). The smallest variance with ``|S| <= Ms`` is therefore a convex
problem. It is solved by a logarithmic barrier method with Newton steps, whose distance from the optimum is known. Boyd
and Vandenberghe, Convex Optimization, 2004, chapter 11.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.feedback_responses import Channel, FeedbackResponses, MeasuredDrive
from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY

Array = NDArray[np.float64]

TAPS = 128
"""Taps of Q for each measured signal."""
LINES = 4096
"""Number of lines up to Nyquist for the integration of spectra."""
_LIMITS_PER_TAP = 3
"""Constrained frequencies of ``|S|`` per tap; between them it exceeds the limit by less than 1 %."""
_GAP = 5e-3
"""Largest relative distance of the variance from the optimum."""


@dataclasses.dataclass(frozen=True)
class DisturbanceSpectra:
    """
    One-sided power spectral densities of the disturbances, on lines from 0 to Nyquist; 0 beyond the given lines.

    Attributes
    ----------
    frequencies
        Lines [Hz], increasing, shape (f,).
    force
        Disturbance force against u [V^2/Hz], shape (f,).
    track
        Displacement of the track center [um^2/Hz], shape (f,).
    noise
        Noise of each measured signal [unit^2/Hz]: an array of shape (f,), or one number for white noise.
    """

    frequencies: Array
    force: Array
    track: Array
    noise: tuple[float | Array, ...]


@dataclasses.dataclass(frozen=True)
class LeastError:
    """
    Lower bound of the position error under feedback.

    Attributes
    ----------
    three_sigma
        3 sigma of the best feedback found [um].
    floor
        Lower bound for this number of taps [um]; it differs from ``three_sigma`` by the tolerance of the solver.
    peak_sensitivity
        Ms of that feedback; below the limit if the limit is not active.
    """

    three_sigma: float
    floor: float
    peak_sensitivity: float


def white_density(sigma: float, sample_time: float) -> float:
    """Return the one-sided density of white noise of ``sigma`` per sample [unit^2/Hz]."""
    return 2.0 * sample_time * sigma**2


def least_error(
    drive: MeasuredDrive,
    spectra: DisturbanceSpectra,
    max_sensitivity: float = MAX_SENSITIVITY,
    taps: int = TAPS,
) -> LeastError:
    """
    Return the smallest 3 sigma position error of linear feedback with a limited peak sensitivity.

    The drive is linear; the feedback may have any order and knows the drive and the spectra. More taps lower the result
    slightly: twice as many by 0 to 8 %, most for spectra with narrow features.

    Parameters
    ----------
    drive
        The drive.
    spectra
        Disturbance spectra.
    max_sensitivity
        Largest ``|S|`` at any frequency, above 1.
    taps
        Taps of Q for each measured signal.

    Raises
    ------
    ValueError
        If the limit is not above 1, the noise does not match the measured signals, all spectra are zero, or no feedback
        with that peak sensitivity is found.
    """
    if not max_sensitivity > 1.0:
        raise ValueError(f'max_sensitivity = {max_sensitivity!r} is invalid; expected above 1')
    if len(spectra.noise) != len(drive.measured):
        raise ValueError(f'{len(spectra.noise)} densities of noise for {len(drive.measured)} measured signals')
    problem = _Problem(drive, spectra, taps)
    if not problem.constant > 0.0:
        raise ValueError('all disturbance spectra are 0')
    limited = problem.limits(_LIMITS_PER_TAP * taps)
    q, distance = _minimized(problem, *limited, max_sensitivity)
    variance = problem.variance(q)
    return LeastError(
        three_sigma=3.0 * float(np.sqrt(variance)),
        floor=3.0 * float(np.sqrt(max(variance - distance, 0.0))),
        peak_sensitivity=float(np.abs(problem.sensitivity(q)).max()),
    )


class _Problem:
    """Variance q'Pq + 2 c'q + constant, and S on the lines, as functions of the concatenated taps q."""

    def __init__(self, drive: MeasuredDrive, spectra: DisturbanceSpectra, taps: int) -> None:
        nyquist = 0.5 / drive.sample_time
        # Midway between lines k f_N/N, which avoids integrators and the Nyquist frequency.
        self._frequencies = (np.arange(LINES) + 0.5) / LINES * nyquist
        self._sample_time, self._taps, self._signals = drive.sample_time, taps, len(drive.measured)
        responses = FeedbackResponses(drive, self._frequencies)
        self._sensitivity = responses.sensitivity
        size = taps * self._signals
        self.quadratic, self.linear, self.constant = np.zeros((size, size)), np.zeros(size), 0.0
        step = nyquist / LINES
        self._add(responses.error_of_force, step * self._on_lines(spectra.frequencies, spectra.force))
        self._add(responses.error_of_track, step * self._on_lines(spectra.frequencies, spectra.track))
        for channel, density in zip(responses.error_of_noise, spectra.noise, strict=True):
            white = np.broadcast_to(density, spectra.frequencies.shape)
            self._add(channel, step * self._on_lines(spectra.frequencies, white))

    def _on_lines(self, frequencies: Array, density: Array) -> Array:
        return np.interp(self._frequencies, frequencies, density, left=0.0, right=0.0)

    def _add(self, channel: Channel, power: Array) -> None:
        """Add the variance due to an input with this power on each line."""
        from scipy.linalg import toeplitz

        if not power.any():
            return
        self.constant += float(power @ np.abs(channel.at_zero) ** 2)
        filters = channel.from_correction[:, None] * channel.innovations
        for i in range(self._signals):
            rows = slice(i * self._taps, (i + 1) * self._taps)
            self.linear[rows] += self._lags(power * filters[:, i].conj() * channel.at_zero)[0]
            for j in range(self._signals):
                columns = slice(j * self._taps, (j + 1) * self._taps)
                below, right = self._lags(power * filters[:, i].conj() * filters[:, j])
                self.quadratic[rows, columns] += toeplitz(below, right)

    def _lags(self, values: NDArray[np.complex128]) -> tuple[Array, Array]:
        """Return the real parts of sum values z^k for k = 0, 1, ..., taps - 1, and for k = 0, -1, ..."""
        lags = np.arange(self._taps)
        sums = np.fft.ifft(values, 2 * LINES) * (2 * LINES)
        half = np.exp(1j * np.pi * lags / (2 * LINES))
        return (sums[lags] * half).real, (sums[-lags] * half.conj()).real

    def variance(self, q: Array) -> float:
        return float(q @ self.quadratic @ q + 2.0 * self.linear @ q + self.constant)

    def sensitivity(self, q: Array) -> NDArray[np.complex128]:
        """Return S on all lines."""
        padded = np.zeros((self._signals, 2 * LINES), dtype=np.complex128)
        lags = np.arange(self._taps)
        padded[:, : self._taps] = q.reshape(self._signals, -1) * np.exp(-1j * np.pi * lags / (2 * LINES))
        filters = np.fft.fft(padded)[:, :LINES].T
        channel = self._sensitivity
        return np.asarray(channel.at_zero + channel.from_correction * (channel.innovations * filters).sum(axis=1))

    def limits(self, count: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return S = a + G q on about ``count`` lines: a and G."""
        lines = np.unique((np.arange(count) + 0.5) / count * LINES).astype(np.int64)
        powers = np.exp(-2j * np.pi * self._sample_time * np.outer(self._frequencies[lines], np.arange(self._taps)))
        channel = self._sensitivity
        filters = channel.from_correction[lines, None] * channel.innovations[lines]
        return channel.at_zero[lines], np.hstack([filters[:, [i]] * powers for i in range(self._signals)])


def _minimized(
    problem: _Problem,
    at_zero: NDArray[np.complex128],
    gradient: NDArray[np.complex128],
    max_sensitivity: float,
) -> tuple[Array, float]:
    """Return the taps with the smallest variance for ``|S| <= Ms``, and a bound of the distance from it."""
    real, imaginary = np.ascontiguousarray(gradient.real), np.ascontiguousarray(gradient.imag)

    def sensitivity(q: Array) -> NDArray[np.complex128]:
        return np.asarray(at_zero + gradient @ q)

    def potential(q: Array, weight: float, limit: float) -> float:
        slack = limit**2 - np.abs(sensitivity(q)) ** 2
        return weight * problem.variance(q) - float(np.log(slack).sum()) if slack.min() > 0.0 else np.inf

    def centered(q: Array, weight: float, limit: float, steps: int) -> Array:
        """Return the taps that minimize weight x variance - sum ``ln(limit^2 - |S|^2)``, after some Newton steps."""
        for _ in range(steps):
            s = sensitivity(q)
            slack = (limit**2 - np.abs(s) ** 2)[:, None]
            along = s.real[:, None] * real + s.imag[:, None] * imaginary
            slope = 2.0 * weight * (problem.quadratic @ q + problem.linear) + (2.0 * along / slack).sum(axis=0)
            root = np.sqrt(2.0 / slack)
            rows = np.vstack([real * root, imaginary * root, along * (2.0 / slack)])
            curvature = 2.0 * weight * problem.quadratic + rows.T @ rows
            curvature[np.diag_indices(len(q))] += 1e-12 * np.trace(curvature) / len(q)
            direction = -np.linalg.solve(curvature, slope)
            descent = float(-slope @ direction)
            if descent < 1e-2:
                break
            before, length = potential(q, weight, limit), 1.0
            while not potential(q + length * direction, weight, limit) <= before - 0.2 * length * descent:
                length *= 0.5
                if length < 1e-9:
                    return q
            q = q + length * direction
        return q

    q, count = np.zeros(gradient.shape[1]), len(at_zero)
    limit = max(max_sensitivity, 1.05 * float(np.abs(at_zero).max()))
    weight = 0.1 * count / problem.constant
    while limit > max_sensitivity:
        q = centered(q, weight, limit, 4)
        tighter = max(max_sensitivity, 1.001 * float(np.abs(sensitivity(q)).max()))
        if tighter > 0.999 * limit and tighter > max_sensitivity:
            if weight < 1e-9 * count / problem.constant:
                raise ValueError(f'no feedback found with a peak sensitivity of at most {max_sensitivity:g}')
            # The variance term dominates the sensitivity constraint.
            weight *= 0.1
        limit = tighter
    weight = count / problem.variance(q)
    while True:
        q = centered(q, weight, max_sensitivity, 60)
        # The distance from the optimum of a centered point.
        if count / weight < _GAP * problem.variance(q):
            return q, count / weight
        weight *= 10.0
