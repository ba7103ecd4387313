"""Force noise: a white force against u, such as that of windage on the arm."""

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
    """White force noise; the default is that of the NSS benchmark 3.1 on the default drive."""

    enabled: bool = parameter(False, 'whether there is force noise')
    seed: int = parameter(1, 'seed of the noise', minimum=0, maximum=2**53)
    sigma: float = parameter(
        2.44e-3, 'standard deviation of a sample at the sampling frequency reference_rate', unit='V', minimum=0.0
    )
    reference_rate: float = parameter(
        26400.0,
        'sampling frequency for which sigma is given; at another one the density is the same, and the standard '
        'deviation is larger by the square root of the ratio',
        unit='Hz',
        minimum=1.0,
    )

    def sigma_at(self, sample_time: float) -> float:
        """Return the standard deviation of a sample [V] at T [s]."""
        return self.sigma / math.sqrt(self.reference_rate * sample_time)


@compiled
def force_noise(c: np.record, tick: int) -> float:
    """Return the noise of a tick [V]."""
    sigma: float = c.sigma
    return sigma * normal_pair(np.int64(c.seed), FORCE_NOISE, tick)[0]
