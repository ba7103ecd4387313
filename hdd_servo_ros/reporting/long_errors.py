"""The position error of a long run, summed up block by block: its size, what repeats, its spectra, time off track."""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.error_spectrum import RESOLUTION, accumulated, segment_of
from hdd_servo_ros.analysis.metrics import amplitude_power, amplitude_segment, power_spectral_density
from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT
from hdd_servo_ros.analysis.streamed_periods import StreamedPeriods
from hdd_servo_ros.analysis.streamed_spectrum import StreamedDensity, StreamedSpectrum
from hdd_servo_ros.analysis.streamed_sums import StreamedOffTrack
from hdd_servo_ros.numerics.moments import Moments

Array = NDArray[np.float64]


class LongSignal(Moments):
    """Count, mean, deviation and largest magnitude of a signal that comes in blocks."""

    @property
    def rms(self) -> float:
        """Root mean square."""
        return self.rms_about(0.0)

    @property
    def variance(self) -> float:
        """Mean square about the mean."""
        return self.rms_about(None) ** 2

    @property
    def misregistration(self) -> float:
        """Three standard deviations, as :func:`~hdd_servo_ros.analysis.misregistration.misregistration` has it."""
        return 3.0 * math.sqrt(self.variance * self.count / (self.count - 1)) if self.count > 1 else 0.0


class LongError:
    """
    The position error of a long run after its transient, in the unit of errors.

    Parameters
    ----------
    samples
        How many samples will come.
    sample_time
        T [s].
    period
        Samples over which the reference repeats, 0 if it does not.
    """

    def __init__(self, samples: int, sample_time: float, period: int) -> None:
        self.size = LongSignal()
        self._density = StreamedDensity(samples)
        self._spectrum = StreamedSpectrum(
            samples,
            amplitude_segment(samples, sample_time),
            lambda values, segment: amplitude_power(values, sample_time, segment),
        )
        self.periods = StreamedPeriods(samples, period) if period and samples >= 2 * period else None
        """Sums over the reference's period; None if there are not two."""

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        self.size.add(error)
        self._density.add(error)
        self._spectrum.add(error)
        if self.periods is not None:
            self.periods.add(error)

    @property
    def misregistration_from_spectrum(self) -> float:
        """What the periodogram of the whole error gives, by Parseval's theorem."""
        return self._density.misregistration(self.size.mean, self.size.variance)

    def amplitude_spectrum(self) -> tuple[Array, Array]:
        """Return frequencies [Hz] and the amplitude that a sine at each would have."""
        frequencies, power = self._spectrum.result()
        return frequencies, np.sqrt(2.0 * power)


class LongTrack:
    """
    The track error of a long run after its transient, in the unit of lengths.

    Parameters
    ----------
    samples
        How many samples will come.
    sectors
        Samples of a revolution, 0 if they are no whole number.
    pitch
        Track pitch, None if it is not known.
    """

    def __init__(self, samples: int, sectors: int, pitch: float | None) -> None:
        self.size = LongSignal()
        self.off_track = (
            {} if pitch is None else {limit: StreamedOffTrack(limit * pitch) for limit in (WRITE_LIMIT, READ_LIMIT)}
        )
        """By the share of the pitch that is the limit."""
        self.revolutions = StreamedPeriods(samples, sectors) if sectors and samples >= 2 * sectors else None
        """Sums over the revolutions; None if there are not two."""

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        self.size.add(error)
        for off in self.off_track.values():
            off.add(error)
        if self.revolutions is not None:
            self.revolutions.add(error)


class LongCumulative:
    """
    The cumulative spectrum of a signal that comes in blocks.

    See :func:`~hdd_servo_ros.analysis.error_spectrum.cumulative_spectrum`.

    Parameters
    ----------
    samples
        How many samples will come.
    sample_time
        T [s].
    """

    def __init__(self, samples: int, sample_time: float) -> None:
        self._spectrum = StreamedSpectrum(
            samples,
            segment_of(samples, sample_time, RESOLUTION),
            lambda values, segment: power_spectral_density(values, sample_time, segment),
        )

    def add(self, values: Array) -> None:
        """Add samples, shape (n,)."""
        self._spectrum.add(values)

    def result(self) -> tuple[Array, Array]:
        """Return frequencies [Hz] and the root of the power below each."""
        frequencies, density = self._spectrum.result()
        return accumulated(frequencies, density)
