"""The exact discrete form of an adaptation law with leakage."""

from hdd_servo_ros.numerics.elementary import exp


def decay_and_step(gain: float, leakage: float, sample_time: float) -> tuple[float, float]:
    """
    Return (a, b) of theta_{k+1} = a theta_k + b w_k, the exact solution of theta' = gain (w - leakage theta).

    Every law of (4.18)-(4.21) has this form, with w held over the sample: a = exp(-gain leakage T) and
    b = (1 - a)/leakage, whose limit without leakage is gain T. As 0 <= a <= 1 for any gain and leakage that are not
    negative (a underflows to 0 for gain leakage T above 708), the estimate follows its law's own solution and cannot
    oscillate or grow by the discretization, which Euler's rule does as soon as gain leakage T exceeds 2.

    Parameters
    ----------
    gain
        k_i or an element of Gamma.
    leakage
        sigma_i.
    sample_time
        T [s].
    """
    x = gain * leakage * sample_time
    if abs(x) < 1e-3:
        # (1 - exp(-x))/x by its series: the difference would cancel.
        return exp(-x), gain * sample_time * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0))))
    a = exp(-x)
    return a, (1.0 - a) / leakage
