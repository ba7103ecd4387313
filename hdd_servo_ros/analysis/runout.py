"""Repeatable and non-repeatable position error: the mean over revolutions per servo sector, and the rest."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.metrics import repeatable_parts
from hdd_servo_ros.analysis.misregistration import misregistration


@dataclasses.dataclass(frozen=True)
class RunoutParts:
    """
    A position error split by sector; all lengths in the unit of the error.

    Attributes
    ----------
    sectors, revolutions
        Samples per revolution, and number of complete revolutions.
    repeatable
        Repeatable position error (RPE): mean over the revolutions per sector, shape (sectors,). Index 0 is the sector
        of the first sample. Averaging K revolutions leaves 1/K of the variance of the NRPE in it.
    repeatable_peak_to_peak, repeatable_three_sigma
        Peak to peak, and 3 sigma, of the RPE.
    non_repeatable_peak_to_peak, non_repeatable_three_sigma
        Peak to peak, and 3 sigma, of the non-repeatable position error (NRPE), the rest. Sigma accounts for the means
        taken from the same samples: root of the sum of squares over sectors (revolutions - 1).
    """

    sectors: int
    revolutions: int
    repeatable: NDArray[np.float64]
    repeatable_peak_to_peak: float
    repeatable_three_sigma: float
    non_repeatable_peak_to_peak: float
    non_repeatable_three_sigma: float

    def scaled(self, factor: float) -> 'RunoutParts':
        """Return the parts multiplied by a factor, for another unit."""
        return RunoutParts(
            self.sectors,
            self.revolutions,
            factor * self.repeatable,
            factor * self.repeatable_peak_to_peak,
            factor * self.repeatable_three_sigma,
            factor * self.non_repeatable_peak_to_peak,
            factor * self.non_repeatable_three_sigma,
        )


def runout_parts(error: ArrayLike, sectors: int) -> RunoutParts:
    """
    Split a position error into repeatable (RPE) and non-repeatable (NRPE) parts.

    Parameters
    ----------
    error
        Position error after the transient, one sample per servo sector, shape (n,); the last complete revolutions are
        used.
    sectors
        Servo sectors (samples) per revolution.

    Raises
    ------
    ValueError
        If the number of sectors or of complete revolutions is below two.
    """
    y = np.asarray(error, dtype=np.float64)
    if sectors < 2:
        raise ValueError(f'sectors = {sectors} is invalid; expected at least 2 servo sectors per revolution')
    revolutions = len(y) // sectors
    if revolutions < 2:
        raise ValueError(
            f'RPE and NRPE need two complete revolutions of {sectors} samples after the transient; the signal has '
            f'{len(y)} samples'
        )
    mean = repeatable_parts(y, float(sectors)).waveform
    first = len(y) - revolutions * sectors
    rest = y[first:] - mean[np.arange(first, len(y)) % sectors]
    variance = float(np.sum(np.square(rest))) / (sectors * (revolutions - 1))
    return RunoutParts(
        sectors=sectors,
        revolutions=revolutions,
        repeatable=mean,
        repeatable_peak_to_peak=float(np.ptp(mean)),
        repeatable_three_sigma=misregistration(mean),
        non_repeatable_peak_to_peak=float(np.ptp(rest)),
        non_repeatable_three_sigma=3.0 * float(np.sqrt(variance)),
    )
