"""CNF: closed forms against the matrices of its definition, and the law on a free body."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from hdd_servo_ros.control.cnf import CNF, CNF_STATE, CnfParameters, cnf_constants, cnf_design, cnf_gains, cnf_step
from hdd_servo_ros.control.hold import middle_of_hold
from hdd_servo_ros.numerics.records import record, zeros
from hdd_servo_ros.parameters import ParameterError

GAIN = 4.0968e7
LIMIT = 10.0
T = 1e-4
laws = st.builds(
    lambda frequency, ratio, damping, added, share, steepness: CnfParameters(
        natural_frequency=frequency,
        settling_frequency=frequency * ratio,
        damping_ratio=damping,
        settling_damping_ratio=damping + added,
        start_share=share,
        steepness=steepness,
    ),
    st.floats(50.0, 2000.0),
    st.floats(1.0, 3.0),
    st.floats(0.05, 1.5),
    st.floats(0.0, 1.0),
    st.floats(0.2, 10.0),
    st.floats(0.0, 10.0),
)
lengths = st.floats(0.1, 1000.0)
viscous = st.floats(0.0, 2e-5)


class Matrices:
    """Law of a seek from the matrices of its definition, with P from scipy."""

    def __init__(self, law, length, viscous_coefficient, beta, added):
        w = 2.0 * math.pi * law.natural_frequency
        w = min(w, math.sqrt(law.start_share * LIMIT * GAIN / length))
        self.frequency, self.beta = w, beta
        a = np.array([[0.0, 1.0], [0.0, -GAIN * viscous_coefficient]])
        b = np.array([[0.0], [GAIN]])
        self.f = -np.array([[w * w, 2.0 * law.damping_ratio * w - GAIN * viscous_coefficient]]) / GAIN
        closed = a + b @ self.f
        self.closed = closed
        self.g = -1.0 / (np.array([[1.0, 0.0]]) @ np.linalg.solve(closed, b))[0, 0]
        self.unit_equilibrium = -np.linalg.solve(closed, b)[:, 0] * self.g
        # The added damping for the law's mu; P is linear in q.
        mu = 4.0 * law.damping_ratio * beta / added - 1.0 if added > 0.0 else math.inf
        self.mu = mu
        if math.isfinite(mu):
            p = solve_continuous_lyapunov(closed.T, -np.diag([1.0, mu / w**2]))
            self.p = p * (2.0 * w / (GAIN**2 * p[1, 1]))
            self.bp = (b.T @ self.p)[0]

    def control(self, x, r, nearness):
        x_e = self.unit_equilibrium * r
        return (self.f @ x)[0] + self.g * r - self.beta * nearness * self.bp @ (x - x_e)


@given(laws, lengths, viscous)
def test_closed_forms_equal_the_matrices(law, length, viscous_coefficient):
    c = record(cnf_constants(law, GAIN, LIMIT, T, viscous_coefficient), CNF)
    frequency, beta, added = cnf_design(c, length)
    if not 1e-3 < added < 1e3:
        return
    found = Matrices(law, length, viscous_coefficient, beta, added)
    assert frequency == pytest.approx(found.frequency)
    # W has no negative weight, P is positive definite, and the poles are those that F should place.
    assert found.mu >= -1e-9
    assert np.linalg.eigvalsh(found.p).min() > 0.0
    assert np.poly(found.closed) == pytest.approx([1.0, 2.0 * law.damping_ratio * frequency, frequency**2])
    np.testing.assert_allclose(found.unit_equilibrium, [1.0, 0.0], atol=1e-9)
    for nearness in (0.0, 0.3, 1.0):
        stiffness, damping = cnf_gains(c, nearness, length)
        r, y, v = 17.0, 12.0, 3e4
        scale = stiffness * (r - y) + abs(damping) * v
        u = stiffness * (r - y) - damping * v
        assert u == pytest.approx(found.control(np.array([y, v]), r, nearness), abs=1e-9 * scale)


@given(laws, lengths)
def test_all_seeks_settle_alike(law, length):
    c = record(cnf_constants(law, GAIN, LIMIT, T), CNF)
    frequency, beta, _ = cnf_design(c, length)
    stiffness, damping = cnf_gains(c, 1.0, length)
    wanted = 2.0 * math.pi * law.settling_frequency
    assert beta >= 0.0
    assert GAIN * damping == pytest.approx(2.0 * law.settling_damping_ratio * wanted)
    assert GAIN * stiffness <= wanted**2 * (1.0 + 1e-9)
    if (wanted / frequency) ** 2 - 1.0 <= 4.0 * law.damping_ratio * beta:
        assert GAIN * stiffness == pytest.approx(wanted**2)


def test_start_asks_for_the_share_of_the_voltage():
    law = CnfParameters(natural_frequency=700.0, start_share=0.7, steepness=50.0)
    c = cnf_constants(law, GAIN, LIMIT, 1e-9)
    for length in (50.0, 300.0):
        assert cnf_step(c, zeros(CNF_STATE), length, 0.0, length) == pytest.approx(7.0, rel=1e-4)
    short = cnf_step(c, zeros(CNF_STATE), 1.0, 0.0, 1.0)
    assert short == pytest.approx((2.0 * math.pi * 700.0) ** 2 / GAIN, rel=1e-4)


@given(laws, st.floats(-1e3, 1e3), st.floats(-1e6, 1e6))
def test_is_odd_and_limited(law, error, velocity):
    c = cnf_constants(law, GAIN, LIMIT, T)
    u = cnf_step(c, zeros(CNF_STATE), error, velocity, 100.0)
    assert u == -cnf_step(c, zeros(CNF_STATE), -error, -velocity, 100.0)
    assert abs(u) <= LIMIT


def test_a_seek_of_no_length_is_a_law_all_the_same():
    c = cnf_constants(CnfParameters(), GAIN, LIMIT, T)
    assert cnf_step(c, zeros(CNF_STATE), 0.0, 0.0, 0.0) == 0.0
    assert math.isfinite(cnf_step(c, zeros(CNF_STATE), 1.0, 0.0, 0.0))
    assert math.isnan(cnf_step(c, zeros(CNF_STATE), math.nan, 0.0, 1.0))


def sampled(law, length, sample_time, duration, force=0.0):
    """Return time and error of a free body under the law, from rest, and the integral at the end."""
    c = cnf_constants(law, GAIN, LIMIT, sample_time)
    state = zeros(CNF_STATE)
    error, velocity, found = length, 0.0, []
    for tick in range(round(duration / sample_time)):
        found.append((tick * sample_time, error))
        u = cnf_step(c, state, error, velocity, length) - force
        error -= velocity * sample_time + 0.5 * GAIN * u * sample_time**2
        velocity += GAIN * u * sample_time
    times, errors = np.array(found).T
    return times, errors, state[0]


def reference(law, length, times):
    """Return the error of the continuous law, by the matrices."""
    c = record(cnf_constants(law, GAIN, LIMIT, T), CNF)
    _, beta, added = cnf_design(c, length)
    matrices = Matrices(law, length, 0.0, beta, added)

    def rate(_, x):
        u = matrices.control(x, length, math.exp(-law.steepness * abs(x[0] - length) / length))
        return [x[1], GAIN * min(max(u, -LIMIT), LIMIT)]

    solved = solve_ivp(rate, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-9, max_step=1e-5)
    return length - solved.y[0]


@pytest.mark.parametrize('length', [5.0, 150.0])
def test_equals_the_continuous_law_on_a_free_body(length):
    law = CnfParameters(natural_frequency=400.0, settling_frequency=600.0)
    times, error, _ = sampled(law, length, 1e-6, 4e-3)
    assert np.abs(error - reference(law, length, times)).max() < 1e-3 * length


def test_allows_for_the_hold():
    """The delay of half a sample would cause a first-order error in T; the remaining error is of second order."""
    law = CnfParameters(natural_frequency=400.0, settling_frequency=600.0)
    off = []
    for sample_time in (4e-5, 2e-5, 1e-5):
        times, error, _ = sampled(law, 5.0, sample_time, 2e-3)
        off.append(np.abs(error - reference(law, 5.0, times)).max())
    assert np.log2(off[0] / off[1]) > 1.8
    assert np.log2(off[1] / off[2]) > 1.8


def test_integral_takes_up_a_constant_force():
    force = 0.13
    _, without, _ = sampled(CnfParameters(), 20.0, T, 0.05, force)
    _, error, integral = sampled(CnfParameters(integral_rate=300.0), 20.0, T, 0.05, force)
    gains = cnf_gains(record(cnf_constants(CnfParameters(), GAIN, LIMIT, T), CNF), 1.0, 20.0)
    # The law expects its u to move the head by the middle of the sample, which the force prevents.
    softer = middle_of_hold(GAIN, 0.5 * T, *gains)
    assert without[-1] == pytest.approx(force * softer / gains[0], rel=0.05)
    assert abs(error[-1]) < 1e-4
    assert integral == pytest.approx(force, rel=1e-3)


def test_integral_is_frozen_while_the_voltage_is_limited():
    c = cnf_constants(CnfParameters(integral_rate=300.0), GAIN, LIMIT, T)
    state = zeros(CNF_STATE)
    assert cnf_step(c, state, 500.0, 0.0, 500.0) == LIMIT
    assert state[0] == 0.0
    assert cnf_step(c, state, 1.0, 0.0, 500.0) < LIMIT
    assert state[0] > 0.0


@pytest.mark.parametrize(
    ('values', 'name'),
    [
        ({'natural_frequency': 0.0}, 'natural_frequency'),
        ({'start_share': 0.0}, 'start_share'),
        ({'natural_frequency': 901.0, 'settling_frequency': 900.0}, 'settling_frequency'),
        ({'damping_ratio': 0.8, 'settling_damping_ratio': 0.7}, 'settling_damping_ratio'),
        ({'integral_rate': -1.0}, 'integral_rate'),
    ],
)
def test_rejects_what_makes_no_law(values, name):
    with pytest.raises(ParameterError, match=f'parameter {name}: '):
        CnfParameters(**values)
