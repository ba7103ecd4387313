"""Metrics of a run, from its arrays; each in the unit of its inputs, unless stated otherwise."""

import dataclasses
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND

NANOMETRES = 1e3
"""nm per um."""


def rms(values: ArrayLike) -> float:
    """
    Return the root of the mean square.

    Parameters
    ----------
    values
        Values of any shape and unit.

    Returns
    -------
    float
        In the unit of the values.

    Examples
    --------
    >>> from hdd_servo_ros.analysis import rms
    >>> rms([3.0, -4.0, 3.0, -4.0])
    3.5355339059327378
    """
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


@dataclasses.dataclass(frozen=True)
class TrackingMetrics:
    """
    Tracking of a run: errors [nm] of the true head position after the transient, and command [V].

    Examples
    --------
    >>> from hdd_servo_ros.analysis import TrackingMetrics, tracking_metrics
    >>> metrics = tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.001, -0.001], [0.5, -2.0])
    >>> isinstance(metrics, TrackingMetrics), metrics.peak_control, metrics.max_error
    (True, 2.0, 1.0)
    """

    transient: float
    """End of the transient, from which errors count [s]."""
    samples: int
    """Number of ticks after the transient."""
    rms_error: float
    """Root of the mean squared x - x_d [nm]."""
    max_error: float
    """Peak of x - x_d [nm]."""
    mean_error: float
    """Mean of x - x_d [nm]."""
    tmr: float
    """Track misregistration (thesis eq. 1.1): three standard deviations of x - x_d [nm]."""
    peak_control: float
    """Peak of u over the whole run, including the transient [V]."""
    rms_control: float
    """Root of the mean squared u after the transient [V]."""


def tracking_metrics(
    time: ArrayLike,
    reference: ArrayLike,
    position: ArrayLike,
    control: ArrayLike,
    transient: float = 0.0,
    unit: float = NANOMETRES,
) -> TrackingMetrics:
    """
    Return the tracking metrics of one run.

    Parameters
    ----------
    time, reference, position, control
        Time [s], x_d [um], head position [um] and u [V] of the ticks, each of shape (n,).
    transient
        End of the transient [s]; earlier ticks are used only for the peak of u.
    unit
        Factor from the unit of length of the run to the unit of the errors; 1000 from um to nm.

    Raises
    ------
    ValueError
        If the lengths differ, or no tick is after the transient.

    Notes
    -----
    Source: thesis eq. (1.1) for the track misregistration, TMR.

    Examples
    --------
    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import tracking_metrics
    >>> time = np.arange(1000) * 1e-3
    >>> reference = np.sin(2.0 * np.pi * time)
    >>> metrics = tracking_metrics(time, reference, reference + 0.01, np.zeros(1000), transient=0.5)
    >>> metrics.samples, round(metrics.rms_error, 6), round(metrics.mean_error, 6)  # errors in nm
    (500, 10.0, 10.0)
    """
    t, x_d, x, u = (np.asarray(values, dtype=np.float64) for values in (time, reference, position, control))
    if not t.shape == x_d.shape == x.shape == u.shape or t.ndim != 1:
        raise ValueError(f'arrays of different shape: {t.shape}, {x_d.shape}, {x.shape}, {u.shape}')
    # Half a microsecond includes a tick at the end of the transient despite rounding.
    late = t >= transient - HALF_MICROSECOND
    if not late.any():
        raise ValueError(f'no tick after the transient of {transient:g} s')
    error = (x[late] - x_d[late]) * unit
    return TrackingMetrics(
        transient=transient,
        samples=len(error),
        rms_error=rms(error),
        max_error=float(np.abs(error).max()),
        mean_error=float(error.mean()),
        tmr=misregistration(error) if len(error) > 1 else 0.0,
        peak_control=float(np.abs(u).max()),
        rms_control=rms(u[late]),
    )


def power_spectral_density(
    signal: ArrayLike, sample_time: float, segment: int | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return frequencies [Hz] and the one-sided power spectral density of a signal about its mean [unit^2/Hz].

    Parameters
    ----------
    signal
        Equally spaced samples, shape (n,).
    sample_time
        Sample time T [s].
    segment
        Samples per segment for Welch's method with half-overlapping Hann windows. None for the periodogram of the whole
        record, whose integral is the variance up to the factor N/(N-1) (thesis eq. 1.2), so that both forms of the TMR
        (thesis eq. 1.1) agree.

    Notes
    -----
    Source: Welch, IEEE Trans. Audio and Electroacoustics 15(2), 1967; thesis eq. (1.2) for the variance.

    Examples
    --------
    The integral of the density is the variance of the signal:

    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import power_spectral_density
    >>> signal = 3.0 * np.sin(2.0 * np.pi * 50.0 * np.arange(1000) * 1e-3)
    >>> frequency, density = power_spectral_density(signal, sample_time=1e-3)
    >>> f'{density.sum() * frequency[1]:.3f}'
    '4.500'
    """
    # Imported late: scipy.signal takes longer to import than the other functions here to run.
    from scipy.signal import periodogram, welch

    y = np.asarray(signal, dtype=np.float64)
    if segment is None:
        frequencies, density = periodogram(y, fs=1.0 / sample_time, detrend='constant')
    else:
        frequencies, density = welch(y, fs=1.0 / sample_time, nperseg=min(segment, len(y)), detrend='constant')
    return frequencies, density


def amplitude_spectrum(
    signal: ArrayLike, sample_time: float, resolution: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return frequencies [Hz] and the amplitude of a sine at each of them [unit], without the mean of the signal.

    The method is Welch's with half-overlapping flat-top windows. A peak shows the amplitude of a sine within 0.2 %,
    also between two lines. It extends up to five lines to each side, so that sines closer than ten lines merge, and
    noise appears as in a band of 3.8 lines.

    Parameters
    ----------
    signal, sample_time
        See :func:`power_spectral_density`.
    resolution
        Distance of the lines [Hz]; a record shorter than its inverse has a coarser resolution.

    Examples
    --------
    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import amplitude_spectrum
    >>> signal = 3.0 * np.sin(2.0 * np.pi * 50.0 * np.arange(1000) * 1e-3)
    >>> frequency, amplitude = amplitude_spectrum(signal, sample_time=1e-3)
    >>> f'{amplitude.max():.2f} at {frequency[amplitude.argmax()]:.0f} Hz'
    '3.00 at 50 Hz'
    """
    y = np.asarray(signal, dtype=np.float64)
    frequencies, power = amplitude_power(y, sample_time, amplitude_segment(len(y), sample_time, resolution))
    return frequencies, np.sqrt(2.0 * power)


def amplitude_segment(samples: int, sample_time: float, resolution: float = 1.0) -> int:
    """Return the samples per segment of :func:`amplitude_spectrum` for a record of given length."""
    return min(samples, max(2, round(1.0 / (resolution * sample_time))))


def amplitude_power(
    signal: NDArray[np.float64], sample_time: float, segment: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies [Hz] and half the squared amplitudes of :func:`amplitude_spectrum`, for a segment length."""
    from scipy.signal import welch

    frequencies, power = welch(
        signal, fs=1.0 / sample_time, window='flattop', nperseg=segment, detrend='constant', scaling='spectrum'
    )
    return frequencies, power


@dataclasses.dataclass(frozen=True)
class RepeatableParts:
    """
    A signal split by averaging it synchronously over the reference period.

    Examples
    --------
    >>> from hdd_servo_ros.analysis import RepeatableParts, repeatable_parts
    >>> isinstance(repeatable_parts([1.0, -1.0] * 4, period=2), RepeatableParts)
    True
    """

    period: int
    """Samples of the averaged period."""
    cycles: int
    """Number of averaged periods."""
    waveform: NDArray[np.float64]
    """One period of the repeatable part, including the mean, shape (period,)."""
    repeatable_rms: float
    """Root mean square of the repeatable part."""
    non_repeatable_rms: float
    """Root mean square of the non-repeatable part; the two mean squares add up to that of the signal."""


def repeatable_parts(signal: ArrayLike, period: float) -> RepeatableParts:
    """
    Split a signal into the part that repeats with the reference and the rest.

    Averaging K periods leaves 1/K of the variance of the non-repeatable part in the repeatable one.

    Parameters
    ----------
    signal
        Signal, shape (n,); its last complete periods are used.
    period
        Period of the reference in samples. If it is not an integer, the smallest number of periods (up to 1000) that
        is an integer number of samples is averaged as one.

    Raises
    ------
    ValueError
        If the signal has fewer than two of them.

    Examples
    --------
    >>> from hdd_servo_ros.analysis import repeatable_parts
    >>> parts = repeatable_parts([1.0, -1.0, 1.5, -0.5] * 5, period=2)
    >>> parts.waveform.tolist(), parts.repeatable_rms > parts.non_repeatable_rms
    ([1.25, -0.75], True)
    """
    y = np.asarray(signal, dtype=np.float64)
    samples = Fraction(period).limit_denominator(1000).numerator
    cycles = len(y) // samples if samples > 0 else 0
    if cycles < 2:
        raise ValueError(f'expected at least two periods of {samples} samples; the signal has {len(y)} samples')
    folded = y[len(y) - cycles * samples :].reshape(cycles, samples)
    waveform = folded.mean(axis=0)
    # In phase with the whole signal: its first sample is that of the waveform.
    return RepeatableParts(
        period=samples,
        cycles=cycles,
        waveform=np.roll(waveform, (len(y) - cycles * samples) % samples),
        repeatable_rms=rms(waveform),
        non_repeatable_rms=rms(folded - waveform),
    )


@dataclasses.dataclass(frozen=True)
class StepResponse:
    """
    Responses to all edges of a step or square reference; one element per edge.

    Examples
    --------
    >>> from hdd_servo_ros.analysis import StepResponse, step_response
    >>> reference = [0.0] * 10 + [2.0] * 10
    >>> response = step_response(range(20), reference, reference)
    >>> isinstance(response, StepResponse), len(response), response.height.tolist()
    (True, 1, [2.0])
    """

    row: NDArray[np.int64]
    """Row of the edge, the first one with the new reference."""
    height: NDArray[np.float64]
    """New reference minus old one."""
    overshoot: NDArray[np.float64]
    """Overshoot beyond the new reference [% of the height], at least 0."""
    settling_time: NDArray[np.float64]
    """Time after which the head stays within the band around the new reference [s]; infinite if it does not."""
    steady_error: NDArray[np.float64]
    """Mean of x - x_d over the second half of the interval after the edge, or over a given part."""

    def __len__(self) -> int:
        return len(self.row)

    def worst(self) -> dict[str, float]:
        """Return the largest overshoot and settling time, and the largest magnitude of the steady errors."""
        return {name: float(np.max(values)) for name, values in self._magnitudes().items()}

    def median(self) -> dict[str, float]:
        """Return the medians of overshoot, settling time and magnitude of the steady errors."""
        return {name: float(np.median(values)) for name, values in self._magnitudes().items()}

    def _magnitudes(self) -> dict[str, NDArray[np.float64]]:
        return {
            'overshoot': self.overshoot,
            'settling_time': self.settling_time,
            'steady_error': np.abs(self.steady_error),
        }


def is_stepwise(reference: ArrayLike) -> bool:
    """Return whether a reference is constant except for a few steps, the first perhaps before its first row."""
    x_d = np.asarray(reference, dtype=np.float64)
    jumps = np.flatnonzero(np.diff(x_d))
    return len(jumps) <= len(x_d) / 10 and (len(jumps) < 2 or int(np.diff(jumps).min()) > 1)


def step_response(
    time: ArrayLike, reference: ArrayLike, position: ArrayLike, band: float = 0.02, steady_part: float = 0.5
) -> StepResponse:
    """
    Return the responses of the head to the edges of a step or square reference.

    The last of several edges is omitted if the record ends within half of the time between edges.

    Parameters
    ----------
    time, reference, position
        Time [s], x_d and head position of the ticks, each of shape (n,).
    band
        Half width of the settling band, as a fraction of the height of the edge.
    steady_part
        Last fraction of the interval after an edge over which the steady error is averaged.

    Raises
    ------
    ValueError
        If the reference is not stepwise, or has no edge.

    Examples
    --------
    A step of 10 µm with an overshoot of 1 µm, a settling time of 3 ms and a steady error of 0.1 µm:

    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import step_response
    >>> time, reference = 1e-3 * np.arange(30), np.repeat([0.0, 10.0], [5, 25])
    >>> position = np.concatenate([np.zeros(5), [5.0, 11.0, 10.5], np.full(22, 10.1)])
    >>> response = step_response(time, reference, position)
    >>> {name: round(value, 6) for name, value in response.worst().items()}
    {'overshoot': 10.0, 'settling_time': 0.003, 'steady_error': 0.1}
    """
    t, x_d, x = (np.asarray(values, dtype=np.float64) for values in (time, reference, position))
    if not is_stepwise(x_d):
        raise ValueError('the reference is neither a step nor a square wave')
    rows = np.flatnonzero(np.diff(x_d)) + 1
    heights = np.diff(x_d)[rows - 1]
    rows, heights, ends = counted_edges(rows, heights, len(x), x_d[0] - x[0])
    overshoot, settling, steady = (np.empty(len(rows)) for _ in range(3))
    for step, (row, end, height) in enumerate(zip(rows, ends, heights, strict=True)):
        error = x[row:end] - x_d[row]
        # Both expressions propagate nan: to the overshoot, and as outside the band.
        overshoot[step] = 100.0 * np.maximum(0.0, (error / height).max())
        outside = np.flatnonzero(~(np.abs(error) <= band * abs(height)))
        inside = row + (int(outside[-1]) + 1 if len(outside) else 0)
        settling[step] = t[inside] - t[row] if inside < end else np.inf
        steady[step] = error[min(len(error) - 1, int(len(error) * (1.0 - steady_part))) :].mean()
    return StepResponse(rows, heights, overshoot, settling, steady)


def counted_edges(
    rows: NDArray[np.int64], heights: NDArray[np.float64], samples: int, first_offset: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the edges that :func:`step_response` uses: first row, height, and the row after the last.

    Parameters
    ----------
    rows, heights
        Rows and heights of all edges, shape (m,).
    samples
        Number of rows of the record.
    first_offset
        x_d - x at the first row.

    Raises
    ------
    ValueError
        If the reference has no edge.
    """
    # A reference that differs from the head position at its first row is an edge too.
    if abs(first_offset) > 0.1 * np.abs(heights).max(initial=0.0):
        rows, heights = np.append(0, rows), np.append(first_offset, heights)
    ends = np.append(rows[1:], samples)
    # A record of an integer number of periods ends just after an edge.
    if len(rows) > 1 and samples - rows[-1] < 0.5 * (rows[-1] - rows[-2]):
        rows, heights, ends = rows[:-1], heights[:-1], ends[:-1]
    if not len(rows):
        raise ValueError('the reference has no edge')
    return rows, heights, ends


@dataclasses.dataclass(frozen=True)
class ControlEffort:
    """Effort of a controller."""

    rms: float
    """Root mean square."""
    peak: float
    """Peak magnitude."""
    total_variation: float
    """Total variation: sum of the magnitudes of all changes per tick."""


def control_effort(control: ArrayLike) -> ControlEffort:
    """Return the effort of a command u, shape (n,)."""
    u = np.asarray(control, dtype=np.float64)
    return ControlEffort(rms(u), float(np.abs(u).max()), float(np.abs(np.diff(u)).sum()))


def loop_area(displacement: ArrayLike, force: ArrayLike, cycles: int = 1) -> float:
    """
    Return the area of a closed curve of force over displacement, which is the work lost per cycle.

    Parameters
    ----------
    displacement, force
        Points of the curve, shape (n,), over an integer number of cycles, without the repeated first point.
    cycles
        Number of cycles.

    Returns
    -------
    float
        Mean closed integral of force over displacement per cycle; positive for a force with the sign of the velocity,
        such as the force that overcomes friction.
    """
    x, f = (np.asarray(values, dtype=np.float64) for values in (displacement, force))
    # Trapezoidal rule; the last point connects to the first.
    return float(np.sum(0.5 * (f + np.roll(f, -1)) * (np.roll(x, -1) - x)) / cycles)
