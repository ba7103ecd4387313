"""Compensation of the zero-order hold in a control law on position and velocity."""

from hdd_servo_ros.numerics.compiled import compiled


@compiled
def middle_of_hold(gain: float, half_sample: float, stiffness: float, damping: float) -> float:
    """
    Return the divisor that makes a law hold at the middle of the sample over which its u is held.

    The zero-order hold delays u by half a sample. If the law u = s e - d v is to hold at the middle, T/2, it is
    implicit in u, because u itself changes error and velocity until then:

        e(T/2) = e - v T/2 - a u T^2/8,    v(T/2) = v + a u T/2.

    The solution is u = (s (e - v T/2) - d v)/(1 + d a T/2 + s a T^2/8), exact for a free body.

    Parameters
    ----------
    gain
        Acceleration of the head per volt a [um/s^2/V].
    half_sample
        T/2 [s].
    stiffness
        Stiffness s: voltage per error in the present state [V/um].
    damping
        Damping d: voltage per velocity [V s/um].
    """
    return 1.0 + gain * half_sample * (damping + 0.5 * half_sample * stiffness)
