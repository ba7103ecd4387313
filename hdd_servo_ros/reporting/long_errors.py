"""Error statistics of a long run, computed block by block: size, repeatable part, spectra, time off track."""

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
    """Count, mean, deviation and peak of a signal, computed block by block."""

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
        """Three standard deviations, see :func:`~hdd_servo_ros.analysis.misregistration.misregistration`."""
        return 3.0 * math.sqrt(self.variance * self.count / (self.count - 1)) if self.count > 1 else 0.0


class LongError:
    """
    Position error after the transient, in the unit of errors.

    Parameters
    ----------
    samples
        Total number of samples.
    sample_time
        Sample time T [s].
    period
        Samples per period of the reference; 0 if it is not periodic.
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
        """Sums over the period of the reference; None for fewer than two periods."""

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        self.size.add(error)
        self._density.add(error)
        self._spectrum.add(error)
        if self.periods is not None:
            self.periods.add(error)

    @property
    def misregistration_from_spectrum(self) -> float:
        """3 sigma of the error from its periodogram, by Parseval's theorem."""
        return self._density.misregistration(self.size.mean, self.size.variance)

    def amplitude_spectrum(self) -> tuple[Array, Array]:
        """Return frequencies [Hz] and the amplitude of a sine at each of them."""
        frequencies, power = self._spectrum.result()
        return frequencies, np.sqrt(2.0 * power)


class LongTrack:
    """
    Track error after the transient, in the unit of lengths.

    Parameters
    ----------
    samples
        Total number of samples.
    sectors
        Samples per revolution; 0 if this is not an integer.
    pitch
        Track pitch; None if it is unknown.
    """

    def __init__(self, samples: int, sectors: int, pitch: float | None) -> None:
        self.size = LongSignal()
        self.off_track = (
            {} if pitch is None else {limit: StreamedOffTrack(limit * pitch) for limit in (WRITE_LIMIT, READ_LIMIT)}
        )
        """Time off track by limit, a fraction of the track pitch."""
        self.revolutions = StreamedPeriods(samples, sectors) if sectors and samples >= 2 * sectors else None
        """Sums over the revolutions; None for fewer than two revolutions."""

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        self.size.add(error)
        for off in self.off_track.values():
            off.add(error)
        if self.revolutions is not None:
            self.revolutions.add(error)


class LongCumulative:
    """
    Cumulative spectrum of a signal, computed block by block.

    See :func:`~hdd_servo_ros.analysis.error_spectrum.cumulative_spectrum`.

    Parameters
    ----------
    samples
        Total number of samples.
    sample_time
        Sample time T [s].
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
        """Return frequencies [Hz] and the root of the power below each of them."""
        frequencies, density = self._spectrum.result()
        return accumulated(frequencies, density)
