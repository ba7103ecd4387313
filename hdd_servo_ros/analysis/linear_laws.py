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
    """[V s/um]."""
    m_hat: float
    """[V s^2/um]."""


def acts_on_loop(controller: AdaptiveNn, part: SigmaParameters | MassParameters) -> bool:
    """Return whether the estimate of a part multiplies a measured signal: it is on, without desired compensation."""
    return part.enabled and not controller.parameters.desired.enabled


def frozen_law(controller: AdaptiveNn, estimates: FrozenEstimates, delay: int = 0) -> LinearController:
    """Return the linear controller that a law is with frozen estimates; see :func:`frozen_laws`."""
    return frozen_laws(controller, [estimates], delay)[0]


def frozen_laws(controller: AdaptiveNn, estimates: Iterable[FrozenEstimates], delay: int = 0) -> list[LinearController]:
    """
    Return the linear controllers that a law is with frozen estimates.

    Its gain on r is g = k + 1/sigma_phi + max(S'S)/sigma_w. As a_r = x_d'' - lambda e' - lambda_i e, m_hat a_r adds
    m_hat lambda to the gain on velocity and m_hat lambda_i to that on position; sigma_hat v takes sigma_hat off the
    former. With desired compensation both multiply signals of the reference instead, and like the bristles and the
    compensator, which read the reference alone, they are not part of the loop.

    Parameters
    ----------
    controller
        The law.
    estimates
        sigma_hat and m_hat of each; those of a part that :func:`acts_on_loop` denies do not count.
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
    Return the linear controller that a PID controller is inside its limit.

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
