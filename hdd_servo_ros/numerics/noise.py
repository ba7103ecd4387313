"""
Counter-based noise: the sample at tick k is a function of (seed, stream, k) only.

Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011) generates the bits, and Wichura's
AS 241 (Applied Statistics 37, 1988) converts a uniform number to a normal one. The generator has no state, so a run can
be cut, resumed or computed out of order with the same noise.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import log

MASK = np.uint64(0xFFFFFFFF)
SHIFT = np.uint64(32)
MULTIPLIER_0 = np.uint64(0xD2511F53)
MULTIPLIER_1 = np.uint64(0xCD9E8D57)
WEYL_0 = np.uint64(0x9E3779B9)
WEYL_1 = np.uint64(0xBB67AE85)
TWO_TO_MINUS_52 = 2.0**-52


@compiled
def _round(
    number: int,
    counter: tuple[np.uint64, np.uint64, np.uint64, np.uint64],
    key_0: np.uint64,
    key_1: np.uint64,
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the counter after the Philox round ``number`` (0 to 9)."""
    product_0 = MULTIPLIER_0 * counter[0]
    product_1 = MULTIPLIER_1 * counter[2]
    return (
        (product_1 >> SHIFT) ^ counter[1] ^ ((key_0 + np.uint64(number) * WEYL_0) & MASK),
        product_1 & MASK,
        (product_0 >> SHIFT) ^ counter[3] ^ ((key_1 + np.uint64(number) * WEYL_1) & MASK),
        product_0 & MASK,
    )


@compiled
def philox4x32(
    counter_0: np.uint64,
    counter_1: np.uint64,
    counter_2: np.uint64,
    counter_3: np.uint64,
    key_0: np.uint64,
    key_1: np.uint64,
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return four 32-bit words (as uint64) from a 128-bit counter and a 64-bit key given as 32-bit words (uint64)."""
    # The rounds are unrolled, so that the compiler can interleave the rounds of several ticks in a loop over ticks.
    counter = _round(0, (counter_0, counter_1, counter_2, counter_3), key_0, key_1)
    counter = _round(1, counter, key_0, key_1)
    counter = _round(2, counter, key_0, key_1)
    counter = _round(3, counter, key_0, key_1)
    counter = _round(4, counter, key_0, key_1)
    counter = _round(5, counter, key_0, key_1)
    counter = _round(6, counter, key_0, key_1)
    counter = _round(7, counter, key_0, key_1)
    counter = _round(8, counter, key_0, key_1)
    return _round(9, counter, key_0, key_1)


@compiled
def normal_quantile(p: float) -> float:
    """Return the quantile of the standard normal distribution for 0 < p < 1 (AS 241, PPND16)."""
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        numerator = 3.3871328727963666080e0 + r * (
            1.3314166789178437745e2
            + r
            * (
                1.9715909503065514427e3
                + r
                * (
                    1.3731693765509461125e4
                    + r
                    * (
                        4.5921953931549871457e4
                        + r * (6.7265770927008700853e4 + r * (3.3430575583588128105e4 + r * 2.5090809287301226727e3))
                    )
                )
            )
        )
        denominator = 1.0 + r * (
            4.2313330701600911252e1
            + r
            * (
                6.8718700749205790830e2
                + r
                * (
                    5.3941960214247511077e3
                    + r
                    * (
                        2.1213794301586595867e4
                        + r * (3.9307895800092710610e4 + r * (2.8729085735721942674e4 + r * 5.2264952788528545610e3))
                    )
                )
            )
        )
        return q * numerator / denominator
    r = math.sqrt(-log(p if q < 0.0 else 1.0 - p))
    if r <= 5.0:
        r -= 1.6
        numerator = 1.42343711074968357734e0 + r * (
            4.63033784615654529590e0
            + r
            * (
                5.76949722146069140550e0
                + r
                * (
                    3.64784832476320460504e0
                    + r
                    * (
                        1.27045825245236838258e0
                        + r
                        * (2.41780725177450611770e-1 + r * (2.27238449892691845833e-2 + r * 7.74545014278341407640e-4))
                    )
                )
            )
        )
        denominator = 1.0 + r * (
            2.05319162663775882187e0
            + r
            * (
                1.67638483018380384940e0
                + r
                * (
                    6.89767334985100004550e-1
                    + r
                    * (
                        1.48103976427480074590e-1
                        + r
                        * (1.51986665636164571966e-2 + r * (5.47593808499534494600e-4 + r * 1.05075007164441684324e-9))
                    )
                )
            )
        )
    else:
        r -= 5.0
        numerator = 6.65790464350110377720e0 + r * (
            5.46378491116411436990e0
            + r
            * (
                1.78482653991729133580e0
                + r
                * (
                    2.96560571828504891230e-1
                    + r
                    * (
                        2.65321895265761230930e-2
                        + r
                        * (1.24266094738807843860e-3 + r * (2.71155556874348757815e-5 + r * 2.01033439929228813265e-7))
                    )
                )
            )
        )
        denominator = 1.0 + r * (
            5.99832206555887937690e-1
            + r
            * (
                1.36929880922735805310e-1
                + r
                * (
                    1.48753612908506148525e-2
                    + r
                    * (
                        7.86869131145613259100e-4
                        + r
                        * (1.84631831751005468180e-5 + r * (1.42151175831644588870e-7 + r * 2.04426310338993978564e-15))
                    )
                )
            )
        )
    deviate = numerator / denominator
    return -deviate if q < 0.0 else deviate


@compiled
def uniform_pair(seed: int, stream: int, tick: int) -> tuple[float, float]:
    """Return two independent uniform numbers in (0, 1) for one tick of one noise source; see :func:`normal_pair`."""
    t = np.uint64(tick)
    s = np.uint64(seed)
    word_0, word_1, word_2, word_3 = philox4x32(
        t & MASK, t >> SHIFT, np.uint64(stream), np.uint64(0), s & MASK, s >> SHIFT
    )
    # 52 bits plus a half step keep the uniform number strictly within (0, 1).
    uniform_0 = (float((word_0 << np.uint64(20)) | (word_1 >> np.uint64(12))) + 0.5) * TWO_TO_MINUS_52
    uniform_1 = (float((word_2 << np.uint64(20)) | (word_3 >> np.uint64(12))) + 0.5) * TWO_TO_MINUS_52
    return uniform_0, uniform_1


@compiled
def normal_pair(seed: int, stream: int, tick: int) -> tuple[float, float]:
    """
    Return two independent standard normal deviates for one tick of one noise source.

    Parameters
    ----------
    seed
        Seed of the source, 0 to 2**53 (ROS integers that a float64 represents exactly).
    stream
        Stream number, for sources that need more than two deviates per tick.
    tick
        Tick number, 0 to 2**63 - 1.
    """
    uniform_0, uniform_1 = uniform_pair(seed, stream, tick)
    return normal_quantile(uniform_0), normal_quantile(uniform_1)


@compiled
def fill_normal_pairs(seed: int, stream: int, first_tick: int, deviates: NDArray[np.float64]) -> None:
    """
    Write the pairs of :func:`normal_pair` for consecutive ticks into ``deviates``, shape (2 n,), interleaved.

    Each of the two loops is simple enough for the compiler to vectorize over ticks.
    """
    for row in range(len(deviates) // 2):
        deviates[2 * row], deviates[2 * row + 1] = uniform_pair(seed, stream, first_tick + row)
    for i in range(len(deviates)):
        deviates[i] = normal_quantile(deviates[i])
