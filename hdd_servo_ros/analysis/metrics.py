"""Metrics of a run, from its arrays alone; each in the unit of what it is given, unless it says otherwise."""

import dataclasses
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND

NANOMETRES = 1e3
"""nm a um."""


def rms(values: ArrayLike) -> float:
    """
    Return the root of the mean square.

    Parameters
    ----------
    values
        Of any shape and unit.

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
    How well a run tracked: errors [nm] of the head's true position after the transient, peak control [V].

    Examples
    --------
    >>> from hdd_servo_ros.analysis import TrackingMetrics, tracking_metrics
    >>> metrics = tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.001, -0.001], [0.5, -2.0])
    >>> isinstance(metrics, TrackingMetrics), metrics.peak_control, metrics.max_error
    (True, 2.0, 1.0)
    """

    transient: float
    """Time before which nothing counts for the error [s]."""
    samples: int
    """Number of ticks after the transient."""
    rms_error: float
    """Root of the mean squared x - x_d [nm]."""
    max_error: float
    """Largest magnitude of x - x_d [nm]."""
    mean_error: float
    """Mean of x - x_d [nm]."""
    tmr: float
    """Track misregistration (1.1), which is three standard deviations of x - x_d [nm]."""
    peak_control: float
    """Largest magnitude of u over the whole run, the transient included [V]."""
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
        Ticks before this time [s] count for the peak control only.
    unit
        Factor from the run's unit of length to the unit of the errors; 1000 from um to nm.

    Raises
    ------
    ValueError
        If the lengths differ or no tick lies after the transient.

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
    # Half a microsecond lets a tick at the very end of the transient count, whatever its last bit.
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
        T [s].
    segment
        Samples of each of Welch's half-overlapping Hann segments. None for the periodogram of the whole record: its
        integral is the record's variance but for the bias N/(N-1) of (1.2), so that both TMR of (1.1) agree.

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
    # Late: scipy.signal takes longer to import than all else here takes to run.
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
    Return frequencies [Hz] and the amplitude that a sine at each would have [unit], about the signal's mean.

    Welch's half-overlapping segments with a flat-top window: a peak reads the amplitude of a sine within 0.2 %, also
    between two lines. It is up to five lines wide on either side, so sines closer than ten lines merge, and noise reads
    as that of a band of 3.8 lines.

    Parameters
    ----------
    signal, sample_time
        See :func:`power_spectral_density`.
    resolution
        Distance of the lines [Hz]; a record shorter than its inverse has the lines that it can have.

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
    """Return the samples of a segment of :func:`amplitude_spectrum`, in a record of some samples."""
    return min(samples, max(2, round(1.0 / (resolution * sample_time))))


def amplitude_power(
    signal: NDArray[np.float64], sample_time: float, segment: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies [Hz] and half the square of what :func:`amplitude_spectrum` gives, by segments of a length."""
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
    """How many of them were averaged."""
    waveform: NDArray[np.float64]
    """One period of the repeatable part, shape (period,); the mean belongs to it."""
    repeatable_rms: float
    """Root mean square of the repeatable part."""
    non_repeatable_rms: float
    """Root mean square of what is left; the squares of the two add up to the signal's."""


def repeatable_parts(signal: ArrayLike, period: float) -> RepeatableParts:
    """
    Split a signal into what repeats with the reference and what does not.

    Averaging K periods leaves 1/K of the variance of the non-repeatable part in the repeatable one.

    Parameters
    ----------
    signal
        Shape (n,); its last whole periods are used.
    period
        Period of the reference in samples. Where it is no whole number, the fewest periods that are one (up to 1000 of
        them) are averaged together.

    Raises
    ------
    ValueError
        If the signal does not hold two of them.

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
        raise ValueError(f'two periods of {samples} samples are needed, and there are {len(y)} samples')
    folded = y[len(y) - cycles * samples :].reshape(cycles, samples)
    waveform = folded.mean(axis=0)
    # In the phase of the whole signal: its first sample is the waveform's, whatever was left out before.
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
    The answers to all edges of a step or square reference; one element an edge.

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
    """How far the head went beyond the new reference [% of the height]; 0 if it did not."""
    settling_time: NDArray[np.float64]
    """Time after which the head stays within the band about the new reference [s]; infinite if it does not."""
    steady_error: NDArray[np.float64]
    """Mean of x - x_d over the last half of what follows the edge, or over what the caller asked for."""

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
    """Return whether a reference stands still but for a few jumps, the first one perhaps before its first row."""
    x_d = np.asarray(reference, dtype=np.float64)
    jumps = np.flatnonzero(np.diff(x_d))
    return len(jumps) <= len(x_d) / 10 and (len(jumps) < 2 or int(np.diff(jumps).min()) > 1)


def step_response(
    time: ArrayLike, reference: ArrayLike, position: ArrayLike, band: float = 0.02, steady_part: float = 0.5
) -> StepResponse:
    """
    Return how the head answers the edges of a step or square reference.

    A last edge of several is left out where the record ends before half the time between edges is over.

    Parameters
    ----------
    time, reference, position
        Time [s], x_d and head position of the ticks, each of shape (n,).
    band
        Half width of the settling band, as a fraction of the edge's height.
    steady_part
        Over which last part of what follows an edge the steady error is averaged.

    Raises
    ------
    ValueError
        If the reference is not stepwise, or has no edge.

    Examples
    --------
    A step of 10 um that overshoots by 1 um, settles after 3 ms and keeps an error of 0.1 um:

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
        # Both such that what is not a number shows: as an overshoot that is none, and as outside of the band.
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
    Return the edges of a reference that :func:`step_response` counts: first row, height, and the row behind the last.

    Parameters
    ----------
    rows, heights
        Of all edges, shape (m,).
    samples
        Rows of the record.
    first_offset
        x_d less x at the first row.

    Raises
    ------
    ValueError
        If there is none.
    """
    # A reference that has stepped by its first row is an edge as well, from where the head stands.
    if abs(first_offset) > 0.1 * np.abs(heights).max(initial=0.0):
        rows, heights = np.append(0, rows), np.append(first_offset, heights)
    ends = np.append(rows[1:], samples)
    # The record may end just behind an edge, as a whole number of periods does.
    if len(rows) > 1 and samples - rows[-1] < 0.5 * (rows[-1] - rows[-2]):
        rows, heights, ends = rows[:-1], heights[:-1], ends[:-1]
    if not len(rows):
        raise ValueError('the reference has no edge')
    return rows, heights, ends


@dataclasses.dataclass(frozen=True)
class ControlEffort:
    """What a controller asks of the actuator."""

    rms: float
    """Root mean square."""
    peak: float
    """Largest magnitude."""
    total_variation: float
    """Sum of the magnitudes of all changes from tick to tick."""


def control_effort(control: ArrayLike) -> ControlEffort:
    """Return the effort of a command u, shape (n,)."""
    u = np.asarray(control, dtype=np.float64)
    return ControlEffort(rms(u), float(np.abs(u).max()), float(np.abs(np.diff(u)).sum()))


def loop_area(displacement: ArrayLike, force: ArrayLike, cycles: int = 1) -> float:
    """
    Return the area that a closed curve encloses in the plane of displacement and force: the work lost in a cycle.

    Parameters
    ----------
    displacement, force
        Points of the curve, shape (n,), over a whole number of cycles, without the repeated first point.
    cycles
        How often the points go round.

    Returns
    -------
    float
        Closed integral of force over displacement, a cycle's mean; positive for a force that has the sign of the
        velocity, as the friction has that an actuator overcomes.
    """
    x, f = (np.asarray(values, dtype=np.float64) for values in (displacement, force))
    # By trapezoids; the last point joins the first.
    return float(np.sum(0.5 * (f + np.roll(f, -1)) * (np.roll(x, -1) - x)) / cycles)
