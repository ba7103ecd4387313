"""The controllers of this package as linear controllers, for small motion around a reference."""

from collections.abc import Iterable
from typing import NamedTuple

from hdd_servo_ros.analysis.sensitivity import LinearController
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.control.adaptive_nn_parameters import MassParameters, SigmaParameters
from hdd_servo_ros.control.pid import PidParameters


class FrozenEstimates(NamedTuple):
    """The estimates that act on the linear loop."""

    sigma_hat: float
    """sigma_hat [V s/um]."""
    m_hat: float
    """m_hat [V s^2/um]."""


def acts_on_loop(controller: AdaptiveNn, part: SigmaParameters | MassParameters) -> bool:
    """Return whether an estimate multiplies a measured signal (enabled, without desired compensation)."""
    return part.enabled and not controller.parameters.desired.enabled


def frozen_law(controller: AdaptiveNn, estimates: FrozenEstimates, delay: int = 0) -> LinearController:
    """Return the linear controller of a law with frozen estimates; see :func:`frozen_laws`."""
    return frozen_laws(controller, [estimates], delay)[0]


def frozen_laws(controller: AdaptiveNn, estimates: Iterable[FrozenEstimates], delay: int = 0) -> list[LinearController]:
    """
    Return the linear controllers of a law with frozen estimates.

    Its gain on r is taken as g = k + 1/sigma_phi + max(S'S)/sigma_w, an upper bound. As a_r = x_d'' - lambda e' -
    lambda_i e, m_hat a_r adds m_hat lambda to the velocity gain and m_hat lambda_i to the position gain; sigma_hat v
    subtracts sigma_hat from the velocity gain. With desired compensation both multiply signals of the reference
    instead. They are then not part of the loop, like the bristles and the compensator, which read only the reference.

    Parameters
    ----------
    controller
        The controller.
    estimates
        sigma_hat and m_hat of each law; estimates that do not act on the loop (:func:`acts_on_loop`) are ignored.
    delay
        Samples by which u comes late.
    """
    g, p = controller.gain_on_r, controller.parameters
    uses_sigma, uses_mass = float(acts_on_loop(controller, p.sigma)), float(acts_on_loop(controller, p.mass))
    difference = p.velocity_source == 'difference'
    return [
        LinearController(
            proportional=g * p.error_filter_lambda + uses_mass * m_hat * p.integral_gain,
            derivative=g - uses_sigma * sigma_hat + uses_mass * m_hat * p.error_filter_lambda,
            integral=g * p.integral_gain,
            bandwidth=p.velocity_bandwidth if difference else 0.0,
            delay=delay,
            difference=difference,
        )
        for sigma_hat, m_hat in estimates
    ]


def pid_law(parameters: PidParameters, delay: int = 0) -> LinearController:
    """
    Return the linear controller of a PID controller without saturation.

    Parameters
    ----------
    parameters
        Gains, filter and source of the velocity.
    delay
        Samples by which u comes late.
    """
    return LinearController(
        proportional=parameters.proportional_gain,
        derivative=parameters.derivative_gain,
        integral=parameters.integral_gain,
        bandwidth=parameters.derivative_bandwidth,
        delay=delay,
        difference=parameters.velocity_source == 'difference',
    )
