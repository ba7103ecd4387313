"""Repeatable and non-repeatable position error: the mean over revolutions of each servo sector, and the rest."""

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
        Samples per revolution, and the number of whole revolutions that count.
    repeatable
        RPE: mean over the revolutions of each sector, shape (sectors,); index 0 is the sector of the first sample of
        the signal. Averaging K revolutions leaves 1/K of the variance of the NRPE in it.
    repeatable_peak_to_peak, repeatable_three_sigma
        Of the RPE.
    non_repeatable_peak_to_peak, non_repeatable_three_sigma
        Of the NRPE, what remains of the error. Its sigma is corrected for the sectors' means taken from the same
        samples: root of the sum of squares over sectors (revolutions - 1).
    """

    sectors: int
    revolutions: int
    repeatable: NDArray[np.float64]
    repeatable_peak_to_peak: float
    repeatable_three_sigma: float
    non_repeatable_peak_to_peak: float
    non_repeatable_three_sigma: float

    def scaled(self, factor: float) -> 'RunoutParts':
        """Return the same in another unit, by the factor to it."""
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
        Position error after the transient, one sample per servo sector, shape (n,); the last whole revolutions count.
    sectors
        Servo sectors, and thus samples, per revolution.

    Raises
    ------
    ValueError
        If there are less than two sectors, or less than two whole revolutions.
    """
    y = np.asarray(error, dtype=np.float64)
    if sectors < 2:
        raise ValueError(f'sectors = {sectors}: a revolution has at least 2 servo sectors')
    revolutions = len(y) // sectors
    if revolutions < 2:
        raise ValueError(
            f'RPE and NRPE need two whole revolutions of {sectors} samples after the transient, and there are '
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
