"""White force noise against u, such as windage on the arm."""

import dataclasses
import math

import numpy as np

from hdd_servo_ros.disturbance.streams import FORCE_NOISE
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterSet, parameter

FORCE_NOISE_LAYOUT = layout('is_enabled', 'seed', 'sigma')


@dataclasses.dataclass(frozen=True)
class ForceNoiseParameters(ParameterSet):
    """White force noise; the default is the value of the NSS benchmark 3.1 for the default drive."""

    enabled: bool = parameter(False, 'enable the force noise')
    seed: int = parameter(1, 'seed of the force noise', minimum=0, maximum=2**53)
    sigma: float = parameter(
        2.44e-3, 'standard deviation per sample at the sampling rate reference_rate', unit='V', minimum=0.0
    )
    reference_rate: float = parameter(
        26400.0,
        'sampling rate that sigma refers to; at another rate the spectral density is the same, so the standard '
        'deviation scales with the square root of the rate',
        unit='Hz',
        minimum=1.0,
    )

    def sigma_at(self, sample_time: float) -> float:
        """Return the standard deviation per sample [V] at sample time T [s]."""
        return self.sigma / math.sqrt(self.reference_rate * sample_time)


@compiled
def force_noise(c: np.record, tick: int) -> float:
    """Return the force noise at a tick [V]."""
    sigma: float = c.sigma
    return sigma * normal_pair(np.int64(c.seed), FORCE_NOISE, tick)[0]
