"""PTOS against its definition, an ODE solution of a free body, and a drive with delay."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.control.ptos import PTOS, PtosParameters, ptos_constants, ptos_step, ptos_velocity
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError

GAIN = 4.0968e7
LIMIT = 10.0
T = 1e-4
laws = st.builds(
    PtosParameters, natural_frequency=st.floats(50.0, 2000.0), discount=st.floats(0.05, 0.999), lag=st.just(0.0)
)


def constants(parameters=None, sample_time=T):
    return ptos_constants(parameters or PtosParameters(), GAIN, LIMIT, sample_time)


def named(parameters=None, sample_time=T):
    return record(constants(parameters, sample_time), PTOS)


@given(laws)
def test_poles_of_the_linear_region(law):
    c = named(law)
    poles = np.roots([1.0, GAIN * c.k2, GAIN * c.k1])
    assert abs(np.prod(poles)) == pytest.approx((2.0 * math.pi * law.natural_frequency) ** 2)
    damping = -poles.real.sum() / (2.0 * math.sqrt(abs(np.prod(poles))))
    assert damping == pytest.approx(law.damping_ratio)


@given(laws)
def test_curve_and_its_slope_are_continuous(law):
    c = named(law)
    below, beyond = (ptos_velocity(c, float(c.linear_error * side)) for side in (1.0 - 1e-9, 1.0 + 1e-9))
    assert below == pytest.approx(beyond, rel=1e-8)
    assert below[0] == pytest.approx(LIMIT / c.k2, rel=1e-8)


@given(laws, st.floats(-3.0, 3.0))
def test_slope_is_that_of_the_curve(law, exponent):
    c = named(law)
    error = 10.0**exponent * c.linear_error
    step = 1e-5 * error
    above, below = (ptos_velocity(c, error + side)[0] for side in (step, -step))
    assert ptos_velocity(c, error)[1] == pytest.approx((above - below) / (2.0 * step), rel=1e-4)


@given(laws, st.floats(1.01, 1e3))
def test_braking_along_the_curve_takes_the_discounted_voltage(law, distance):
    c = named(law)
    error = distance * c.linear_error
    wanted, slope = ptos_velocity(c, error)
    velocity = wanted + c.offset
    # v = f(e) + u_max/k2 is kept if v' = -f' v.
    assert slope * velocity == pytest.approx(law.discount * GAIN * LIMIT)


@given(laws, st.floats(-1e3, 1e3), st.floats(-1e6, 1e6))
def test_is_odd_and_limited(law, error, velocity):
    c = constants(law)
    u = ptos_step(c, error, velocity, 0.0)
    assert u == -ptos_step(c, -error, -velocity, 0.0)
    assert abs(u) <= LIMIT


def test_a_value_that_is_not_finite_is_seen():
    assert math.isnan(ptos_step(constants(), math.nan, 0.0, 0.0))


def law_of_the_text(parameters, error, velocity):
    """Return u of PTOS as in the textbook."""
    k1 = (2.0 * math.pi * parameters.natural_frequency) ** 2 / GAIN
    k2 = math.sqrt(2.0 * k1 / (GAIN * parameters.discount))
    if abs(error) <= LIMIT / k1:
        wanted = k1 / k2 * error
    else:
        wanted = math.copysign(math.sqrt(2.0 * GAIN * parameters.discount * LIMIT * abs(error)) - LIMIT / k2, error)
    return min(max(k2 * (wanted - velocity), -LIMIT), LIMIT)


def sampled(parameters, length, sample_time, duration):
    """Return time, error and velocity of a free body under the law, from rest."""
    c = constants(parameters, sample_time)
    error, velocity, found = length, 0.0, []
    for tick in range(round(duration / sample_time)):
        found.append((tick * sample_time, error, velocity))
        u = ptos_step(c, error, velocity, 0.0)
        error -= velocity * sample_time + 0.5 * GAIN * u * sample_time**2
        velocity += GAIN * u * sample_time
    return np.array(found).T


def reference(parameters, length, times):
    """Return error and velocity of the continuous law at times."""
    solved = solve_ivp(
        lambda _, x: [-x[1], GAIN * law_of_the_text(parameters, x[0], x[1])],
        (0.0, times[-1]),
        [length, 0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-9,
        max_step=1e-5,
    )
    return solved.y


@pytest.mark.parametrize('length', [5.0, 150.0])
def test_equals_the_continuous_law_on_a_free_body(length):
    parameters = PtosParameters(natural_frequency=600.0, discount=0.8)
    times, error, velocity = sampled(parameters, length, 1e-6, 4e-3)
    wanted = reference(parameters, length, times)
    assert np.abs(error - wanted[0]).max() < 1e-3 * length
    assert np.abs(velocity - wanted[1]).max() < 1e-3 * np.abs(wanted[1]).max()
    assert abs(error[-1]) < 2e-5 * length


def test_allows_for_the_hold():
    """The delay of half a sample would cause a first-order error in T; the remaining error is of second order."""
    parameters = PtosParameters(natural_frequency=600.0, discount=0.8)
    off = []
    for sample_time in (4e-5, 2e-5, 1e-5):
        times, error, _ = sampled(parameters, 5.0, sample_time, 2e-3)
        off.append(np.abs(error - reference(parameters, 5.0, times)[0]).max())
    # Without saturation; the orders between the three sample times.
    assert np.log2(off[0] / off[1]) > 1.8
    assert np.log2(off[1] / off[2]) > 1.8


def test_lag_makes_up_for_a_delay_exactly():
    """A free body whose input is delayed by a sample moves as without delay, a sample later."""

    def errors(law, delay):
        c = constants(law)
        error, velocity, last, found = 120.0, 0.0, 0.0, []
        for _ in range(60):
            found.append(error)
            u = ptos_step(c, error, velocity, last)
            acting = last if delay else u
            error -= velocity * T + 0.5 * GAIN * acting * T**2
            velocity += GAIN * acting * T
            last = u
        return np.array(found)

    late = errors(PtosParameters(lag=T), delay=True)
    np.testing.assert_allclose(late[1:], errors(PtosParameters(), delay=False)[:-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ('name', 'value'), [('natural_frequency', 0.0), ('discount', 1.0), ('discount', 0.0), ('lag', -1e-6)]
)
def test_rejects_what_makes_no_law(name, value):
    with pytest.raises(ParameterError, match=f'parameter {name}: '):
        PtosParameters(**{name: value})
