"""
Elementary functions that use IEEE 754 operations only.

The ``exp``, ``sin`` and ``log`` of the system differ in the last bit between C libraries and between processors. A
feedback loop with sgn(r) turns such a difference into a different run. The functions of this module follow fdlibm (Sun
Microsystems, 1993) and use only operations that IEEE 754 rounds exactly. Their error is at most one unit in the last
place over the stated ranges.
"""

import math

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled

__all__ = ['exp', 'log', 'sine_cosine_of_turns']

LN2_HIGH = 6.93147180369123816490e-01
LN2_LOW = 1.90821492927058770002e-10
INVERSE_LN2 = 1.44269504088896338700e00
SQRT_HALF = 0.70710678118654752440
MANTISSA_BITS = 0x000FFFFFFFFFFFFF
HALF_BITS = 0x3FE0000000000000
"""Sign and exponent of the numbers in [0.5, 1)."""
TWO_PI = 6.283185307179586476925286766559


@compiled
def exp(x: float) -> float:
    """
    Return e**x; 0 below x = -708 (no subnormal results), infinity above 709.78 (fdlibm ``e_exp.c``).

    Parameters
    ----------
    x
        Exponent.

    Returns
    -------
    float
        Within one unit in the last place.

    Examples
    --------
    >>> from hdd_servo_ros.numerics.elementary import exp
    >>> exp(1.0), exp(-1000.0)
    (2.7182818284590455, 0.0)
    """
    if x != x:
        return x
    if x > 709.782712893383973096:
        return math.inf
    if x < -708.0:
        return 0.0
    # Not ``math.floor``, which returns an integer that would have to be converted back.
    k: float = np.floor(INVERSE_LN2 * x + 0.5)
    high = x - k * LN2_HIGH
    low = k * LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t * (6.61375632143793436117e-05 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))
        )
    )
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    if k > 1023.0:
        # 2**1024 overflows, but y times it does not.
        return 2.0 * y * _power_of_two(1023)
    return y * _power_of_two(np.int64(k))


@compiled
def _power_of_two(n: int) -> float:
    """Return 2**n for -1022 <= n <= 1023 by writing the exponent field."""
    return np.int64((n + 1023) << 52).view(np.float64)  # type: ignore[no-any-return]


@compiled
def log(x: float) -> float:
    """
    Return the natural logarithm of a normal number x > 0, or NaN if x is not finite (fdlibm ``e_log.c``).

    Parameters
    ----------
    x
        Normal number above 0.

    Returns
    -------
    float
        Within one unit in the last place.

    Examples
    --------
    >>> from hdd_servo_ros.numerics.elementary import log
    >>> log(2.0)
    0.6931471805599453
    """
    if not x < math.inf:
        return x - x
    # x = mantissa * 2**exponent, mantissa in [0.5, 1); without ``math.frexp``, which calls the C library.
    bits = np.float64(x).view(np.int64)
    exponent = (bits >> 52) - 1022
    mantissa: float = np.int64((bits & MANTISSA_BITS) | HALF_BITS).view(np.float64)
    if mantissa < SQRT_HALF:
        mantissa *= 2.0
        exponent -= 1
    f = mantissa - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    t1 = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    t2 = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half_square = 0.5 * f * f
    k = float(exponent)
    return k * LN2_HIGH - ((half_square - (s * (half_square + (t1 + t2)) + k * LN2_LOW)) - f)


@compiled
def _sine_kernel(x: float) -> float:
    """Return sin x for ``|x| <= pi/4`` (fdlibm ``k_sin.c``)."""
    z = x * x
    r = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    return x + z * x * (-1.66666666666666324348e-01 + z * r)


@compiled
def _cosine_kernel(x: float) -> float:
    """Return cos x for ``|x| <= pi/4`` (fdlibm ``k_cos.c``)."""
    z = x * x
    r = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))
            )
        )
    )
    half_square = 0.5 * z
    w = 1.0 - half_square
    return w + (((1.0 - w) - half_square) + z * r)


@compiled
def sine_cosine_of_turns(turns: float) -> tuple[float, float]:
    """
    Return sin and cos of 2 pi ``turns``.

    Because the argument counts turns, its reduction to an eighth of a turn is exact for runs of any duration.

    Parameters
    ----------
    turns
        Number of turns.

    Returns
    -------
    sine, cosine
        Each within one unit in the last place.

    Notes
    -----
    Source: fdlibm ``k_sin.c`` and ``k_cos.c`` (Sun Microsystems, 1993).

    Examples
    --------
    >>> from hdd_servo_ros.numerics.elementary import sine_cosine_of_turns
    >>> sine_cosine_of_turns(0.25), sine_cosine_of_turns(1e9 + 0.125)[0]
    ((1.0, -0.0), 0.7071067811865476)
    """
    quarter = np.floor(4.0 * turns + 0.5)
    x = (turns - 0.25 * quarter) * TWO_PI
    s = _sine_kernel(x)
    c = _cosine_kernel(x)
    quadrant = np.int64(quarter) & 3
    if quadrant == 0:
        return s, c
    if quadrant == 1:
        return c, -s
    if quadrant == 2:
        return -s, -c
    return -c, s
