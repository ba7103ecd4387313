"""V, c1, c2 and the bounds of theorem 4.1 against the formulas written out, and an independent solver."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.stability.bounds import (
    Bounds,
    CertificateMonitor,
    check,
    convergence_rates,
    lyapunov,
    residual_rate,
    theorem_bounds,
    weight_energy,
)
from hdd_servo_ros.stability.error_filter import ErrorFilter
from hdd_servo_ros.stability.ideal_values import IdealValues

P = from_mapping(
    AdaptiveNnParameters,
    {
        **BARE_LAW,
        'feedback_gain': 3.0,
        'error_filter_lambda': 2.0,
        'sigma.gain': 0.5,
        'sigma.leakage': 0.7,
        'sigma.initial': 0.25,
        'mass.gain': 4.0,
        'mass.leakage': 0.2,
        'phi.gain': 2.0,
        'phi.leakage': 0.3,
        'phi.initial': 0.1,
        'network.nodes': 2,
        'network.gain': (0.5, 1.0, 2.0, 4.0),
        'network.leakage': 1.5,
        'network.initial': (0.1, 0.2, 0.3, 0.4),
    },
)
IDEAL = IdealValues(sigma=1.5, mass=5.0, phi=0.8, weights=np.array([1.0, -0.5, 0.0, 2.0]))
WEIGHTS = np.array([[0.1, 0.2, 0.3, 0.4]])


def test_constants():
    rates = convergence_rates(P, IDEAL)
    # 2k/m, not the printed 2k; lambda_max of diag(2, 1, 1/2, 1/4) is 2.
    assert rates == pytest.approx(
        {'feedback': 6.0 / 5.0, 'sigma_hat': 0.35, 'm_hat': 0.8, 'phi_hat': 0.6, 'network': 0.75}
    )
    expected = 0.5 * (0.7 * 1.5**2 + 0.2 * 5.0**2 + 0.3 * 0.8**2 + 1.5 * (1.0 + 0.25 + 4.0))
    assert residual_rate(P, IDEAL) == pytest.approx(expected)
    assert theorem_bounds(P, IDEAL, 1.0).c1 == pytest.approx(0.35)


def test_lyapunov():
    energy = weight_energy(P, IDEAL, WEIGHTS, np.zeros((1, P.compensator.nodes**2)))
    inverse = np.diag([2.0, 1.0, 0.5, 0.25])
    off = WEIGHTS[0] - IDEAL.weights
    assert energy[0] == pytest.approx(0.5 * off @ inverse @ off)
    estimates = {'sigma_hat': np.array([0.25]), 'm_hat': np.array([0.0]), 'phi_hat': np.array([0.1])}
    value = lyapunov(P, IDEAL, np.array([-2.0]), estimates, energy)
    expected = 0.5 * 5.0 * 4.0 + 1.25**2 / (2 * 0.5) + 5.0**2 / (2 * 4.0) + 0.7**2 / (2 * 2.0) + energy[0]
    assert value[0] == pytest.approx(expected)


def test_parts_that_take_no_part_do_not_count():
    p = from_mapping(AdaptiveNnParameters, {**BARE_LAW, 'sigma.enabled': False, 'network.enabled': False})
    assert set(convergence_rates(p, IDEAL)) == {'feedback', 'm_hat', 'phi_hat'}
    assert residual_rate(p, IDEAL) == pytest.approx(0.5 * (p.mass.leakage * 25.0 + p.phi.leakage * 0.64))
    assert not weight_energy(p, IDEAL, np.ones((3, 25)), np.ones((3, 49))).any()


def test_compensator_adds_its_weights():
    p = from_mapping(AdaptiveNnParameters, {**BARE_LAW, 'compensator.enabled': True, 'network.enabled': False})
    energy = weight_energy(p, IDEAL, np.zeros((1, 25)), np.full((1, 49), 0.1))
    assert energy[0] == pytest.approx(0.5 * 49 * 0.01 / p.compensator.gain)
    assert convergence_rates(p, IDEAL)['compensator'] == p.compensator.gain * p.compensator.leakage


@given(
    initial=st.floats(0.0, 50.0),
    c1=st.floats(0.1, 5.0),
    c2=st.floats(0.0, 20.0),
    mass=st.floats(0.2, 5.0),
    lam=st.floats(0.5, 20.0),
    error=st.floats(-2.0, 2.0),
)
@settings(max_examples=25)
def test_bounds_over_time_against_the_worst_case_integrated(initial, c1, c2, mass, lam, error):
    """V' = -c1 V + c2 and e' = -lambda e + sqrt(2 V/m) are the worst that (4.29) and (4.40) allow."""
    bounds = Bounds(mass, ErrorFilter(lam), c1, c2, initial)
    time = np.linspace(0.0, 2.0, 2001)

    def worst(t, y):
        return [-c1 * y[0] + c2, -lam * y[1] + math.sqrt(2.0 * max(y[0], 0.0) / mass)]

    solved = solve_ivp(worst, (0.0, 2.0), [initial, abs(error)], t_eval=time, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(bounds.level(time), solved.y[0], rtol=1e-6, atol=1e-6)
    e = bounds.e_over(time, error)
    assert (e >= solved.y[1] - 1e-6).all()
    np.testing.assert_allclose(e, solved.y[1], rtol=0.02, atol=5e-3)
    assert (bounds.r_over(time) <= bounds.r_of(bounds.uniform) * (1.0 + 1e-12)).all()
    assert (e <= abs(error) + bounds.e_of(bounds.uniform) + 1e-9).all()


def test_with_integral_action_e_is_bounded_by_the_norm_of_its_filter():
    p = from_mapping(AdaptiveNnParameters, {**BARE_LAW, 'error_filter_lambda': 3.0, 'integral_gain': 2.0})
    bounds = theorem_bounds(p, IDEAL, 1.0)
    # The poles are -1 and -2: g = 2 e^(-2t) - e^(-t) is zero at ln 2, and h = e^(-t) - e^(-2t) is 1/4 there.
    assert bounds.e_of(1.0) == pytest.approx(0.5 * bounds.r_of(1.0))
    far, fast = bounds.omega(0.2)
    assert far == pytest.approx(0.2 + 0.5 * bounds.r_of(bounds.uniform))
    # g' is zero at 2 ln 2, where g is -1/8.
    assert fast == pytest.approx(0.2 * math.sqrt(11.0) + 2.25 * bounds.r_of(bounds.uniform))


def test_omega_without_integral_action():
    """|e| <= |e(0)| + R/lambda, and so |e'| = |r - lambda e| <= 2 R + lambda |e(0)|."""
    bounds = Bounds(2.0, ErrorFilter(4.0), 1.0, 3.0, 5.0)
    largest = math.sqrt(2.0 * 8.0 / 2.0)
    assert bounds.omega(-0.5) == pytest.approx((0.5 + largest / 4.0, 2.0 + 2.0 * largest))


def test_check_counts_and_names_the_first_violation():
    found = check('x', 'um', np.array([0.5, 2.0, 1.5, 0.9]), np.array([1.0, 1.0, 1.0, 1.0]), first_tick=10)
    assert (found.tick, found.value, found.limit, found.violations) == (11, 2.0, 1.0, 2)
    assert found.first_violation == (11, 2.0, 1.0)
    assert found.margin == -1.0
    assert found.tightness == 0.5
    kept = check('x', 'um', np.array([0.5, 0.25]), 1.0)
    assert (kept.tick, kept.violations, kept.first_violation, kept.tightness) == (0, 0, None, 2.0)
    assert check('x', 'um', np.zeros(3), 0.0).violations == 0
    assert check('x', 'um', np.array([1e-6]), 0.0).violations == 1


def test_monitor_gives_the_bounds_margin():
    monitor = CertificateMonitor(P, IDEAL)
    with pytest.raises(RuntimeError):
        monitor.limit(0.0)
    first = monitor.margin(0.3, -2.0)
    estimates = {'sigma_hat': np.array([0.25]), 'm_hat': np.array([0.0]), 'phi_hat': np.array([0.1])}
    energy = weight_energy(P, IDEAL, WEIGHTS, np.zeros((1, 49)))
    bounds = theorem_bounds(P, IDEAL, float(lyapunov(P, IDEAL, np.array([-2.0]), estimates, energy)[0]))
    assert first == pytest.approx(bounds.r_of(bounds.initial) - 2.0)
    later = np.array([0.0, 5.0])
    assert monitor.margin(5.3, 1.0) == pytest.approx(bounds.r_over(later)[1] - 1.0)
    assert monitor.margin(5.3, 1e6) < 0.0
