"""Tracking metrics of a run, from its arrays alone."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

NANOMETRES = 1e3
"""nm a um."""


@dataclasses.dataclass(frozen=True)
class TrackingMetrics:
    """How well a run tracked: errors [nm] of the head's true position after the transient, peak control [V]."""

    transient: float
    """Time before which nothing counts for the error [s]."""
    samples: int
    """Number of ticks after the transient."""
    rms_error: float
    """Root of the mean squared x - x_d [nm]."""
    max_error: float
    """Largest |x - x_d| [nm]."""
    mean_error: float
    """Mean of x - x_d [nm]."""
    tmr: float
    """Track misregistration, (1.1): three standard deviations of x - x_d [nm]."""
    peak_control: float
    """Largest |u| over the whole run, the transient included [V]."""
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
    """
    t, x_d, x, u = (np.asarray(values, dtype=np.float64) for values in (time, reference, position, control))
    if not t.shape == x_d.shape == x.shape == u.shape or t.ndim != 1:
        raise ValueError(f'arrays of different shape: {t.shape}, {x_d.shape}, {x.shape}, {u.shape}')
    # Half a microsecond lets a tick at the very end of the transient count, whatever its last bit.
    late = t >= transient - 0.5e-6
    if not late.any():
        raise ValueError(f'no tick after the transient of {transient:g} s')
    error = (x[late] - x_d[late]) * unit
    mean = float(error.mean())
    # (1.2): N - 1, as the mean is the sample's own.
    deviation = float(np.sqrt(((error - mean) ** 2).sum() / max(len(error) - 1, 1)))
    return TrackingMetrics(
        transient=transient,
        samples=len(error),
        rms_error=float(np.sqrt(np.mean(error**2))),
        max_error=float(np.abs(error).max()),
        mean_error=mean,
        tmr=3.0 * deviation,
        peak_control=float(np.abs(u).max()),
        rms_control=float(np.sqrt(np.mean(u[late] ** 2))),
    )
