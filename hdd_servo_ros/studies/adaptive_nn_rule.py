"""Tuning rule of the adaptive NN controller; see :mod:`~hdd_servo_ros.studies.tune`."""

import dataclasses
import math

from hdd_servo_ros.analysis.largest_gains import (
    DAMPING_RATIO,
    largest_gain_on_r,
    largest_lambda,
    round_down,
    round_up,
    scaled_integral_gain,
)
from hdd_servo_ros.analysis.sensitivity import LoopMargins
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.tuning_runs import AMPLITUDE

SHARES = {'feedback': 0.8, 'phi': 0.1, 'network': 0.1}
"""Shares of the gain g on r."""
DESIRED_SHARES = {'feedback': 0.95, 'phi': 0.025, 'network': 0.025}
"""Shares with desired compensation: the switching terms need less gain, and steps settle sooner."""
SWITCHING_LEAKAGE_RATE = 5.0
"""Leakage rate of phi_hat and W_hat [1/s]."""
ADAPTATION_RATE = 6.0
"""Convergence rate of sigma_hat and m_hat on the design reference, without desired compensation [1/s]."""
DELAYED_MASS_RATE = 2.0
"""Convergence rate of m_hat on the design reference with computation delay [1/s]."""
DESIRED_RATES = {
    'sigma': 100.0,
    'mass': 100.0,
    'bristle.spring': 100.0,
    'bristle.hysteresis': 300.0,
    'bristle.relaxation': 200.0,
}
"""Convergence rates of the estimates with desired compensation, on a sine far above their scales [1/s]."""
LEAKAGE_RATE = 0.03
"""Leakage rate of all estimates but phi_hat and W_hat [1/s]."""
DESIGN_FREQUENCY = 100.0
"""Frequency of the design reference [Hz]."""
SHAPED_DAMPING_RATIO = 0.64
"""Minimum damping ratio of the rigid-body poles with input shaping: the shaper cancels the residual vibration."""


def tune_adaptive_nn(
    plant: PlantParameters, sample_time: float, base: AdaptiveNnParameters, delay: int = 0
) -> dict[str, object]:
    """
    Return the gains of the adaptive NN controller by the tuning rule, under their ROS parameter names.

    A lambda that is too large for the drive is reduced to the largest value that the rule allows, and lambda_i in
    proportion to lambda^2.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    base
        Parameters that the rule does not tune: lambda, lambda_i, the lattice, the scales of desired compensation.
    delay
        Computation delay [samples].
    """
    margins = LoopMargins(plant, sample_time)
    damping = SHAPED_DAMPING_RATIO if base.shaping.share > 0.0 else DAMPING_RATIO
    lambda_ = largest_lambda(margins, base.error_filter_lambda, base.integral_gain, delay, damping)
    integral = base.integral_gain
    if lambda_ < base.error_filter_lambda and integral > 0.0:
        integral = round_down(scaled_integral_gain(integral, base.error_filter_lambda, lambda_))
    g = round_down(largest_gain_on_r(margins, lambda_, integral, delay, damping))
    shares = DESIRED_SHARES if base.desired.enabled else SHARES
    phi_leakage = 1.0 / (shares['phi'] * g)
    network_leakage = _lattice_squares(base, sample_time) / (shares['network'] * g)
    return {
        'error_filter_lambda': lambda_,
        **({} if integral == base.integral_gain else {'integral_gain': integral}),
        'feedback_gain': round_down(shares['feedback'] * g),
        **(_desired_laws(base, g) if base.desired.enabled else _measured_laws(g, delay)),
        'phi.gain': round_down(SWITCHING_LEAKAGE_RATE / phi_leakage),
        'phi.leakage': round_up(phi_leakage),
        'network.gain': [round_down(SWITCHING_LEAKAGE_RATE / network_leakage)],
        'network.leakage': round_up(network_leakage),
        'safe_gain': g,
    }


def _lattice_squares(base: AdaptiveNnParameters, sample_time: float) -> float:
    """Return max(S'S) of the lattice: the contribution of the network to g with a leakage constant of 1."""
    unit = dataclasses.replace(base.network, enabled=True, gain=(1.0,), leakage=1.0)
    lattice = dataclasses.replace(
        base, network=unit, feedback_gain=0.0, phi=dataclasses.replace(base.phi, enabled=False)
    )
    return AdaptiveNn(lattice, sample_time).gain_on_r


def _measured_laws(g: float, delay: int) -> dict[str, object]:
    """Return gains and leakages of (4.18) and (4.19); on a sine an estimate converges at k_i <regressor^2>/g."""
    w = 2.0 * math.pi * DESIGN_FREQUENCY
    velocity_square = 0.5 * (AMPLITUDE * w) ** 2
    mass_rate = DELAYED_MASS_RATE if delay > 0 else ADAPTATION_RATE
    gains = {
        'sigma': round_down(ADAPTATION_RATE * g / velocity_square),
        'mass': round_down(mass_rate * g / (velocity_square * w * w)),
    }
    return _with_leakage(gains)


def _desired_laws(base: AdaptiveNnParameters, g: float) -> dict[str, object]:
    """Return gains and leakages of the normalized laws; an estimate with scale s converges at k_i s^2/(2 g)."""
    laws = base.laws
    rates = {name: rate for name, rate in DESIRED_RATES.items() if base.bristle.enabled or '.' not in name}
    return _with_leakage({name: round_down(2.0 * rate * g / laws[name].scale ** 2) for name, rate in rates.items()})


def _with_leakage(gains: dict[str, float]) -> dict[str, object]:
    """Return gains with the leakages that give ``LEAKAGE_RATE``, under their ROS parameter names."""
    found: dict[str, object] = {}
    for name, gain in gains.items():
        found |= {f'{name}.gain': gain, f'{name}.leakage': round_down(LEAKAGE_RATE / gain)}
    return found
