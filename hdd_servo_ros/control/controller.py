"""What every controller offers: the protocol that lets a new one into the loop without inheritance."""

import math
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled


class Controller(Protocol):
    """
    A controller as the loop and the nodes see it.

    Attributes
    ----------
    estimate_names
        What the elements of ``estimates`` are; the first is ``'t'``, the time of the tick [s].
    estimates
        Array of shape (len(estimate_names),), float64, filled by :meth:`step`.
    """

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """The names of the elements of ``estimates``."""

    @property
    def estimates(self) -> NDArray[np.float64]:
        """The controller's inner state at the tick of the last step, as used in that step."""

    def step(
        self, tick: int, displacement_volts: float, velocity_volts: float, x_d: float, dx_d: float, ddx_d: float
    ) -> tuple[float, float, float]:
        """
        Compute the drive voltage of one tick.

        Parameters
        ----------
        tick
            Number k of the tick; its time is k T.
        displacement_volts, velocity_volts
            The vibrometer's outputs at this tick [V].
        x_d, dx_d, ddx_d
            Reference [um] and its first [um/s] and second derivative [um/s^2] at this tick.

        Returns
        -------
        u, u_unsaturated, u_feedback
            The voltage held until the next tick, the voltage before the limit, and its feedback part before any
            compensation [V]. If an input is not finite, neither is ``u``: a run that has diverged must be seen to.
        """


@runtime_checkable
class KnowsOutputLimit(Protocol):
    """A controller that wants to know what comes out behind it, so that integrals and estimates rest in time."""

    def limit_output(self, limit: float) -> None:
        """Take note that at most +-``limit`` [V] comes out; called before tick 0 and after changes."""


@compiled
def saturated(u: float, limit: float) -> float:
    """Return ``u`` limited to +-``limit``; what is not finite stays so, as no limit makes it meaningful."""
    if abs(u) < math.inf:
        if u > limit:
            return limit
        if u < -limit:
            return -limit
    return u


@compiled
def all_finite(displacement_volts: float, velocity_volts: float, x_d: float, dx_d: float, ddx_d: float) -> bool:
    """Return whether no input of a controller is infinite or not a number."""
    return abs(displacement_volts) + abs(velocity_volts) + abs(x_d) + abs(dx_d) + abs(ddx_d) < math.inf
