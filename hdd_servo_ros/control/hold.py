"""What the hold at the output does to a law that reads position and velocity, and how the law allows for it."""

from hdd_servo_ros.numerics.compiled import compiled


@compiled
def middle_of_hold(gain: float, half_sample: float, stiffness: float, damping: float) -> float:
    """
    Return the divisor by which a law holds in the middle of the sample for which its u is held.

    A u held from now on has half a sample of delay. A law u = s e - d v that is to hold in the middle, at T/2, instead
    is implicit in u, as u itself changes error and velocity until then:

        e(T/2) = e - v T/2 - a u T^2/8,    v(T/2) = v + a u T/2.

    Solved for u it is u = (s (e - v T/2) - d v)/(1 + d a T/2 + s a T^2/8), exact for a free body.

    Parameters
    ----------
    gain
        Acceleration of the head per volt a [um/s^2/V].
    half_sample
        T/2 [s].
    stiffness
        s, voltage per error at the present state [V/um].
    damping
        d, voltage per velocity [V s/um].
    """
    return 1.0 + gain * half_sample * (damping + 0.5 * half_sample * stiffness)
