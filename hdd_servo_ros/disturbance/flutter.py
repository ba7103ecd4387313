"""
Flutter and windage: second-order modes driven by white noise, with exact discretization.

A mode with frequency w/(2 pi), damping ratio z and standard deviation sigma obeys

    y'' + 2 z w y' + w^2 y = 2 sigma sqrt(z w^3) xi

with white noise xi of unit two-sided density. This is white noise filtered by A 2 z w^2/(s^2 + 2 z w s + w^2). In the
stationary state y and y'/w are uncorrelated, and both have the standard deviation sigma. With the transition matrix Phi
over T, the noise of a sample therefore has the covariance sigma^2 (I - Phi Phi'), and the sampled mode has exactly the
variance and the autocovariance of the continuous mode.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.streams import FLUTTER
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, sine_cosine_of_turns
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.numerics.records import layout, record, size
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

FLUTTER_LAYOUT = layout('is_enabled', 'seed')

MODE = layout('a11', 'a12', 'a21', 'a22', 'own_noise', 'shared_noise', 'rate_noise', 'sigma')
"""Transition of (y, y'/w) over T, Cholesky factor of its noise (both for sigma = 1), and sigma [um]."""


@dataclasses.dataclass(frozen=True)
class FlutterParameters(ParameterSet):
    """
    Non-repeatable motion of the track center.

    The default modes are those of the NSS benchmark 3.1 (github.com/macs-lab/NSS-HDD-Benchmark), at its track pitch of
    254 nm.
    """

    enabled: bool = parameter(False, 'enable the non-repeatable motion of the track center')
    seed: int = parameter(1, 'seed of the white noise', minimum=0, maximum=2**53)
    frequencies: tuple[float, ...] = parameter(
        (750.0, 780.0, 900.0, 1020.0, 1080.0, 1230.0, 1800.0, 3000.0, 5000.0),
        'natural frequency of each mode',
        unit='Hz',
        above=0.0,
    )
    damping_ratios: tuple[float, ...] = parameter(
        (0.01, 0.01, 0.01, 0.01, 0.005, 0.01, 0.005, 0.002, 0.002),
        'damping ratio of each mode',
        above=0.0,
        maximum=0.999,
    )
    sigmas: tuple[float, ...] = parameter(
        (9.652e-4, 1.8796e-3, 2.3876e-3, 2.1844e-3, 5.588e-4, 1.2192e-3, 6.858e-4, 5.588e-4, 1.2954e-3),
        'standard deviation of each mode',
        unit='um',
        minimum=0.0,
    )

    def check_together(self) -> None:
        """Check the lengths of the lists."""
        count = len(self.frequencies)
        for name in ('damping_ratios', 'sigmas'):
            value = getattr(self, name)
            if len(value) != count:
                raise ParameterError(name, value, f'{count} elements, as many as frequencies')


def flutter_modes(parameters: FlutterParameters, sample_time: float) -> NDArray[np.float64]:
    """Return the modes for the kernel at sample time T [s], one row of layout :data:`MODE` per mode."""
    modes = np.zeros((len(parameters.frequencies), size(MODE)))
    lists = zip(parameters.frequencies, parameters.damping_ratios, parameters.sigmas, strict=True)
    for i, (frequency, damping, sigma) in enumerate(lists):
        row = record(modes, MODE, i)
        root = math.sqrt(1.0 - damping * damping)
        decay = exp(-damping * TWO_PI * frequency * sample_time)
        sine, cosine = sine_cosine_of_turns(root * frequency * sample_time)
        a12 = decay * sine / root
        row.a11 = decay * cosine + damping * a12
        row.a12 = a12
        row.a21 = -a12
        row.a22 = decay * cosine - damping * a12
        # Factor the rate first: for a short T it has most of the noise, so the rest loses no precision.
        rate = 1.0 - (row.a21 * row.a21 + row.a22 * row.a22)
        shared = -(row.a11 * row.a21 + row.a12 * row.a22)
        own = 1.0 - (row.a11 * row.a11 + row.a12 * row.a12)
        row.rate_noise = math.sqrt(max(rate, 0.0))
        row.shared_noise = shared / row.rate_noise if row.rate_noise > 0.0 else 0.0
        row.own_noise = math.sqrt(max(own - row.shared_noise * row.shared_noise, 0.0))
        row.sigma = sigma
    return modes


def stationary_states(modes: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Return the stationary (y, y'/w)/sigma of each mode at tick 0, shape (n, 2)."""
    states = np.zeros((len(modes), 2))
    for i in range(len(modes)):
        states[i] = normal_pair(seed, FLUTTER + i, 0)
    return states


@compiled
def flutter_step(c: np.record, modes: NDArray[np.float64], states: NDArray[np.float64], tick: int) -> float:
    """Return the displacement of the track center at a tick [um]; advances the modes from the previous tick."""
    seed = np.int64(c.seed)
    total = 0.0
    for i in range(len(modes)):
        mode = record(modes, MODE, i)
        if tick > 0:
            first, second = normal_pair(seed, FLUTTER + i, tick)
            position, rate = states[i, 0], states[i, 1]
            states[i, 0] = mode.a11 * position + mode.a12 * rate + mode.own_noise * first + mode.shared_noise * second
            states[i, 1] = mode.a21 * position + mode.a22 * rate + mode.rate_noise * second
        total += mode.sigma * states[i, 0]
    return total
