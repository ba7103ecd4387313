"""
Bode's integral of the sensitivity of the sampled loop, in discrete time.

For a stable closed loop with open-loop poles p_i outside the unit circle, Jensen's formula gives

    1/f_N int_0^f_N ln|S| df = sum ln|p_i| + ln|S(infinity)|,

where f_N is the Nyquist frequency. The drive has no direct feedthrough, so that the loop gain is 0 at z = infinity, S
is 1 there and the last term is 0 for any relative degree. Source of the discrete form: Sung and Hara, Int. J. Control
48(6), 1988.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclasses.dataclass(frozen=True)
class BodeIntegral:
    """
    Means of ``ln|S|`` over frequency from 0 to Nyquist, which can be compared between sample times.

    Attributes
    ----------
    attenuation
        Mean of ``ln|S|`` where ``|S| < 1``, 0 elsewhere; not positive.
    amplification
        The same where ``|S| > 1``; not negative.
    theory
        Theoretical value of their sum: the sum of the logarithms of the open-loop poles outside the unit circle.
    """

    attenuation: float
    amplification: float
    theory: float

    @property
    def value(self) -> float:
        """Mean of ``ln|S|``."""
        return self.attenuation + self.amplification


def bode_integrals(margins: LoopMargins, controller: LinearController) -> list[BodeIntegral]:
    """
    Return Bode's integral of a controller for each linearization of the drive, in the order of ``margins.drives``.

    Parameters
    ----------
    margins
        The loop without its controller.
    controller
        The linear controller.

    Raises
    ------
    ValueError
        If a closed loop is unstable, since the integral is then undefined.
    """
    nyquist = 0.5 / margins.sample_time
    found: list[BodeIntegral] = []
    for drive in margins.drives:
        if not controller.closed_loop_radius(drive) < 1.0:
            raise ValueError('the closed loop is unstable, and its sensitivity has no Bode integral')
        # The logarithm of a zero at f = 0 is integrable over steps that shrink toward it.
        low = np.geomspace(1e-13, 1e-5, 60) * nyquist
        inner = margins.frequencies[(margins.frequencies > low[-1]) & (margins.frequencies < nyquist)]
        found.append(_integral(margins, controller, len(found), np.concatenate([low, inner, [nyquist]])))
    return found


def _integral(
    margins: LoopMargins, controller: LinearController, index: int, edges: NDArray[np.float64]
) -> BodeIntegral:
    widths = np.diff(edges)
    frequencies = edges[:-1, None] + 0.5 * widths[:, None] * (1.0 + _NODES)
    weights = (0.5 * widths[:, None] * _WEIGHTS).ravel() / edges[-1]
    logarithms = -np.log(np.abs(1.0 + margins.loop_gain(controller, index, frequencies.ravel())))
    poles = np.abs(margins.drives[index].poles)
    return BodeIntegral(
        attenuation=float(weights @ np.minimum(logarithms, 0.0)),
        amplification=float(weights @ np.maximum(logarithms, 0.0)),
        theory=float(np.log(poles[poles > 1.0]).sum()),
    )
