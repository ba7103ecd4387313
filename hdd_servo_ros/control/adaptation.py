"""Exact discretization of an adaptation law with leakage."""

from hdd_servo_ros.numerics.elementary import exp


def decay_and_step(gain: float, leakage: float, sample_time: float) -> tuple[float, float]:
    """
    Return (a, b) of theta_{k+1} = a theta_k + b w_k, the exact solution of theta' = gain (w - leakage theta).

    All laws (4.18)-(4.21) have this form, with w held over the sample: a = exp(-gain leakage T) and
    b = (1 - a)/leakage, with the limit gain T without leakage. Since 0 <= a <= 1 for all nonnegative gains and leakages
    (a underflows to 0 for gain leakage T above 708), the discretization cannot make the estimate oscillate or grow.
    Euler's method does both as soon as gain leakage T exceeds 2.

    Parameters
    ----------
    gain
        Adaptation gain k_i, or an element of Gamma.
    leakage
        Leakage sigma_i.
    sample_time
        T [s].
    """
    x = gain * leakage * sample_time
    if abs(x) < 1e-3:
        # Series of (1 - exp(-x))/x, to avoid cancellation.
        return exp(-x), gain * sample_time * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0))))
    a = exp(-x)
    return a, (1.0 - a) / leakage
