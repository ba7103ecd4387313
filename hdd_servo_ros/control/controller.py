"""Protocols of controllers: the required interface and optional extensions; no inheritance is needed."""

import math
from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled


class Controller(Protocol):
    """
    Interface of a controller for the control loop and the nodes.

    Attributes
    ----------
    estimate_names
        Names of the elements of ``estimates``; the first is ``'t'``, the time of the tick [s].
    estimates
        Array of shape (len(estimate_names),), float64, filled by :meth:`step`.

    Examples
    --------
    A complete controller, proportional and velocity feedback, run for 0.1 s on the default drive:

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
        """Names of the elements of ``estimates``."""

    @property
    def estimates(self) -> NDArray[np.float64]:
        """Internal state at the tick of the last step, as used in that step."""

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """
        Compute the drive voltage for one tick.

        Parameters
        ----------
        inputs
            Measured and desired signals of this tick, by name.

        Returns
        -------
        u, u_unsaturated, u_feedback
            Voltage held until the next tick, voltage before the limit, and its feedback part without feedforward and
            compensation [V]. If an input is not finite, ``u`` must not be finite, so that a diverged run is detected.
        """


@runtime_checkable
class KnowsOutputLimit(Protocol):
    """Controller that uses the output limit after it, for example to freeze integrators and estimates in time."""

    def limit_output(self, limit: float) -> None:
        """
        Receive the output limit +-``limit`` [V] of the DSP after the controller.

        The node and `simulate` call it before tick 0 and after every change of the DSP's parameters.
        """


@runtime_checkable
class WarnsBeforeRun(Protocol):
    """Controller that may return warnings before a run."""

    def warnings(self) -> Iterable[str]:
        """
        Return the warnings, one line each; or nothing.

        The node and `simulate` call it once before tick 0, after ``limit_output``, and log the lines.
        """


@runtime_checkable
class ReportsFault(Protocol):
    """Controller that can end a run by returning a non-finite voltage, and can report the reason."""

    def fault(self) -> str:
        """
        Return in one line why the run cannot continue; an empty string if it can.

        The node and `simulate` call it after a non-finite message; the line becomes the reason of the failed run.
        """


@runtime_checkable
class HasPlan(Protocol):
    """Controller whose plan has a fixed number of ticks, such as a sweep."""

    @property
    def last_tick(self) -> int:
        """
        Last tick of the plan.

        The node and `simulate` read it before the run. A run without a duration ends there; a shorter duration is
        rejected.
        """


@compiled
def saturated(u: float, limit: float) -> float:
    """Return ``u`` limited to +-``limit``; a value that is not finite is returned unchanged."""
    if abs(u) < math.inf:
        if u > limit:
            return limit
        if u < -limit:
            return -limit
    return u


@compiled
def all_finite(inputs: ControllerInputs) -> bool:
    """Return whether all inputs of a controller are finite."""
    measured = abs(inputs.displacement_volts) + abs(inputs.velocity_volts)
    desired = abs(inputs.desired_position) + abs(inputs.desired_velocity) + abs(inputs.desired_acceleration)
    return measured + desired < math.inf
