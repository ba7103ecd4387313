"""The rule that tunes the adaptive NN controller for a drive; `tune` explains it."""

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
"""Of the gain on r."""
DESIRED_SHARES = {'feedback': 0.95, 'phi': 0.025, 'network': 0.025}
"""The same with desired compensation, which leaves less for the switching terms to bound; steps settle sooner."""
FORGETTING_RATE = 5.0
"""Of phi_hat and W_hat [1/s]."""
LEARNING_RATE = 6.0
"""Of sigma_hat and m_hat on the design reference, without desired compensation [1/s]."""
LATE_MASS_RATE = 2.0
"""Of m_hat on the design reference where the command comes late [1/s]."""
DESIRED_RATES = {
    'sigma': 100.0,
    'mass': 100.0,
    'bristle.spring': 100.0,
    'bristle.hysteresis': 300.0,
    'bristle.relaxation': 200.0,
}
"""Of the estimates of desired compensation, on a sine far above their scales [1/s]."""
LEAKAGE_RATE = 0.03
"""Of all these estimates [1/s]."""
DESIGN_FREQUENCY = 100.0
"""Of the design reference [Hz]."""
SHAPED_DAMPING_RATIO = 0.64
"""Least damping ratio of the rigid head in the loop where steps are shaped: the shaper cancels what rings."""


def tune_adaptive_nn(
    plant: PlantParameters, sample_time: float, base: AdaptiveNnParameters, delay: int = 0
) -> dict[str, object]:
    """
    Return the adaptive NN controller's gains by the rule, under their ROS names.

    A lambda that is too large for the drive is reduced to the largest that the rule allows, and lambda_i with its
    square.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    base
        lambda, lambda_i, the lattice, the scales of desired compensation, and all else that the rule leaves alone.
    delay
        Computation delay [samples].
    """
    margins = LoopMargins(plant, sample_time)
    damping = SHAPED_DAMPING_RATIO if base.shaping.share > 0.0 else DAMPING_RATIO
    reach = largest_lambda(margins, base.error_filter_lambda, base.integral_gain, delay, damping)
    integral = base.integral_gain
    if reach < base.error_filter_lambda and integral > 0.0:
        integral = round_down(scaled_integral_gain(integral, base.error_filter_lambda, reach))
    g = round_down(largest_gain_on_r(margins, reach, integral, delay, damping))
    shares = DESIRED_SHARES if base.desired.enabled else SHARES
    phi_leakage = 1.0 / (shares['phi'] * g)
    network_leakage = _lattice_squares(base, sample_time) / (shares['network'] * g)
    return {
        'error_filter_lambda': reach,
        **({} if integral == base.integral_gain else {'integral_gain': integral}),
        'feedback_gain': round_down(shares['feedback'] * g),
        **(_desired_laws(base, g) if base.desired.enabled else _measured_laws(g, delay)),
        'phi.gain': round_down(FORGETTING_RATE / phi_leakage),
        'phi.leakage': round_up(phi_leakage),
        'network.gain': [round_down(FORGETTING_RATE / network_leakage)],
        'network.leakage': round_up(network_leakage),
        'safe_gain': g,
    }


def _lattice_squares(base: AdaptiveNnParameters, sample_time: float) -> float:
    """Return max(S'S) of the lattice: what a leakage of 1 adds to the gain."""
    unit = dataclasses.replace(base.network, enabled=True, gain=(1.0,), leakage=1.0)
    lattice = dataclasses.replace(
        base, network=unit, feedback_gain=0.0, phi=dataclasses.replace(base.phi, enabled=False)
    )
    return AdaptiveNn(lattice, sample_time).gain_on_r


def _measured_laws(g: float, delay: int) -> dict[str, object]:
    """Return gain and leakage of (4.18) and (4.19): the rate of a law on a sine is k_i <regressor^2>/g."""
    w = 2.0 * math.pi * DESIGN_FREQUENCY
    velocity_square = 0.5 * (AMPLITUDE * w) ** 2
    mass_rate = LATE_MASS_RATE if delay > 0 else LEARNING_RATE
    gains = {
        'sigma': round_down(LEARNING_RATE * g / velocity_square),
        'mass': round_down(mass_rate * g / (velocity_square * w * w)),
    }
    return _with_leakage(gains)


def _desired_laws(base: AdaptiveNnParameters, g: float) -> dict[str, object]:
    """Return gain and leakage of the normalized laws, whose rate comes to k_i s^2/(2 g) for a scale s."""
    laws = base.laws
    rates = {name: rate for name, rate in DESIRED_RATES.items() if base.bristle.enabled or '.' not in name}
    return _with_leakage({name: round_down(2.0 * rate * g / laws[name].scale ** 2) for name, rate in rates.items()})


def _with_leakage(gains: dict[str, float]) -> dict[str, object]:
    """Return gains and leakages that forget at ``LEAKAGE_RATE``, under their ROS names."""
    found: dict[str, object] = {}
    for name, gain in gains.items():
        found |= {f'{name}.gain': gain, f'{name}.leakage': round_down(LEAKAGE_RATE / gain)}
    return found
