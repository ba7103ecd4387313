"""What every controller offers, and what some do: protocols that let a new one into the loop without inheritance."""

import math
from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.controller_inputs import ControllerInputs
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

    Examples
    --------
    A proportional and velocity feedback as a whole controller, run for 0.1 s on the default drive:

    >>> import numpy as np
    >>> from hdd_servo_ros.control import Controller
    >>> from hdd_servo_ros.simulation import Experiment
    >>> class Proportional:
    ...     estimate_names = ('t', 'e')
    ...     estimates = np.zeros(2)
    ...
    ...     def step(self, inputs):
    ...         e = inputs.position - inputs.desired_position
    ...         self.estimates[:] = inputs.tick * 1e-4, e
    ...         u = -0.5 * e - 9.7e-5 * (inputs.velocity - inputs.desired_velocity)
    ...         return u, u, u
    >>> controller: Controller = Proportional()
    >>> run = Experiment(1e-4, controller).run(0, 1001)
    >>> f'{1e3 * abs(run.position_error[500:]).max():.1f} nm'
    '51.6 nm'
    """

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """The names of the elements of ``estimates``."""

    @property
    def estimates(self) -> NDArray[np.float64]:
        """The controller's inner state at the tick of the last step, as used in that step."""

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """
        Compute the drive voltage of one tick.

        Parameters
        ----------
        inputs
            What is measured and desired at this tick, by name.

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
        """
        Take note that at most +-``limit`` [V] comes out of the DSP behind the controller.

        The node and `simulate` call it before tick 0, and after every change of the DSP's parameters.
        """


@runtime_checkable
class WarnsBeforeRun(Protocol):
    """A controller that may have something to tell its user before a run."""

    def warnings(self) -> Iterable[str]:
        """
        Return a line for each thing to tell, none if all is well.

        The node and `simulate` call it once before tick 0, after ``limit_output``, and log the lines.
        """


@runtime_checkable
class ReportsFault(Protocol):
    """A controller that ends a run by a voltage that is not finite, and can say why."""

    def fault(self) -> str:
        """
        Return why the run cannot go on, in one line, empty if it can.

        The node and `simulate` call it once a message was not finite; the line is then the reason of the failed run.
        """


@runtime_checkable
class HasPlan(Protocol):
    """A controller with a plan for a certain number of ticks, such as a sweep."""

    @property
    def last_tick(self) -> int:
        """
        The last tick of the plan.

        The node and `simulate` read it before the run: one without a duration ends there, a shorter one is rejected.
        """


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
def all_finite(inputs: ControllerInputs) -> bool:
    """Return whether no input of a controller is infinite or not a number."""
    measured = abs(inputs.displacement_volts) + abs(inputs.velocity_volts)
    desired = abs(inputs.desired_position) + abs(inputs.desired_velocity) + abs(inputs.desired_acceleration)
    return measured + desired < math.inf
