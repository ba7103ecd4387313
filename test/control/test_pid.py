"""The PID controller against its textbook form, by hand and by a simple reference implementation."""

import math
from typing import Any, cast

import numpy as np
import pytest

from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales

T = 1e-4
UNIT = SensorScales(1.0, 1.0)
PLAIN: dict[str, Any] = {'control_limit': 1e9, 'derivative_bandwidth': 0.0}


def pid(**parameters):
    return Pid(PidParameters(**{**PLAIN, **parameters}), T)


def step(controller, tick, *signals):
    """Step with both outputs of the sensor, position and velocity at 1 um/V and 1 um/s/V, and the reference."""
    return controller.step(UNIT.inputs(tick, *signals))


def run(controller, errors, rates=None, dx_d=0.0, ddx_d=0.0):
    rates = np.zeros(len(errors)) if rates is None else rates
    return np.array(
        [step(controller, k, float(errors[k]), float(rates[k]) + dx_d, 0.0, dx_d, ddx_d) for k in range(len(errors))]
    )


def test_each_part_alone():
    u = run(pid(proportional_gain=2.0, integral_gain=0.0, derivative_gain=0.0), [0.5])
    assert u.tolist() == [[-1.0] * 3]
    u = run(pid(proportional_gain=0.0, integral_gain=3.0, derivative_gain=0.0), [1.0] * 100)
    np.testing.assert_allclose(u[:, 0], -3.0 * T * np.arange(1, 101), rtol=1e-12)
    u = run(pid(proportional_gain=0.0, integral_gain=0.0, derivative_gain=4.0), [0.0], [0.25])
    assert u[0, 0] == -1.0


def test_signs_pull_the_head_towards_the_reference():
    controller = pid(proportional_gain=1.0, integral_gain=0.0, derivative_gain=0.0)
    assert step(controller, 0, 0.0, 0.0, 1.0, 0.0, 0.0)[0] == 1.0


def test_what_counts_is_position_and_velocity_and_no_voltage():
    controller = Pid(PidParameters(proportional_gain=1.0, integral_gain=0.0, derivative_gain=1.0, control_limit=1e9), T)
    inputs = SensorScales(8.0, 5000.0).inputs(0, 0.5, 0.01, 0.0, 0.0, 0.0)
    assert controller.step(inputs)[0] == -(0.5 * 8.0 + 0.01 * 5000.0)


def test_estimates():
    controller = pid(proportional_gain=1.0, integral_gain=10.0, derivative_gain=2.0)
    run(controller, [0.5, 0.5], [0.1, 0.1])
    assert dict(zip(controller.estimate_names, controller.estimates, strict=True)) == pytest.approx(
        {'t': T, 'e': 0.5, 'integral': -2 * 10.0 * T * 0.5, 'derivative': -0.2}
    )


def test_derivative_filter_is_the_sampled_first_order_lag():
    f = 300.0
    controller = pid(proportional_gain=0.0, integral_gain=0.0, derivative_gain=1.0, derivative_bandwidth=f)
    rates = np.ones(50)
    rates[0] = 0.0
    u = run(controller, np.zeros(50), rates)
    # Step response of the lag: 1 - exp(-2 pi f t), one sample early because of the direct feedthrough.
    np.testing.assert_allclose(-u[:, 0], 1.0 - np.exp(-2.0 * math.pi * f * T * np.arange(50)), atol=1e-12)


def test_derivative_from_differences():
    controller = pid(proportional_gain=0.0, integral_gain=0.0, derivative_gain=1.0, velocity_source='difference')
    errors = np.cumsum(np.linspace(0.0, 1.0, 20))
    u = run(controller, errors, rates=np.full(20, 1e6))
    assert u[0, 0] == 0.0
    np.testing.assert_allclose(-u[1:, 0], np.diff(errors) / T)


@pytest.mark.parametrize('source', ['sensor', 'difference'])
def test_the_reference_goes_through_the_filter(source):
    """On the reference, the filtered derivative of the error is zero; without the filter it equals the lag."""
    f, w = 800.0, 2.0 * math.pi * 50.0
    t = np.arange(3000) * T
    for filter_reference in (True, False):
        controller = pid(
            proportional_gain=0.0,
            integral_gain=0.0,
            derivative_gain=1.0,
            derivative_bandwidth=f,
            velocity_source=source,
            filter_reference=filter_reference,
        )
        x, v = np.sin(w * t), w * np.cos(w * t)
        slope = -np.array([step(controller, k, x[k], v[k], x[k], v[k], 0.0)[0] for k in range(len(t))])
        if filter_reference:
            assert np.all(slope == 0.0)
        else:
            # Lag of the pole, and half a sample of the difference.
            z, pole = np.exp(1j * w * T), math.exp(-2.0 * math.pi * f * T)
            response = (1.0 - pole) / (1.0 - pole / z)
            if source == 'difference':
                response *= (1.0 - 1.0 / z) / (1j * w * T)
            expected = (w * (response - 1.0) * np.exp(1j * w * t)).real
            np.testing.assert_allclose(slope[1000:], expected[1000:], atol=1e-6 * w)


def test_the_limit_of_what_comes_behind_counts():
    """The integral is frozen at the converter's limit and leaves it at once, as at the controller's own limit."""
    told, own = (
        pid(proportional_gain=1.0, integral_gain=1000.0, derivative_gain=0.0, control_limit=limit)
        for limit in (1e9, 0.5)
    )
    told.limit_output(0.5)
    errors = np.concatenate([np.full(500, -5.0), np.full(50, 0.5)])
    np.testing.assert_array_equal(run(told, errors), run(own, errors))


def test_feedforward_is_no_feedback():
    controller = pid(proportional_gain=1.0, integral_gain=0.0, velocity_feedforward=2.0, acceleration_feedforward=0.5)
    u, unsaturated, feedback = step(controller, 0, 0.25, 3.0, 0.0, 3.0, 8.0)
    assert (u, unsaturated, feedback) == (-0.25 + 6.0 + 4.0, -0.25 + 6.0 + 4.0, -0.25)


@pytest.mark.parametrize('anti_windup', ['clamping', 'back_calculation'])
def test_anti_windup_recovers_at_once(anti_windup):
    """After a long saturation the command leaves its limit within a few tracking times; without, it does not."""

    def samples_to_recover(mode):
        controller = pid(
            proportional_gain=1.0, integral_gain=1000.0, derivative_gain=0.0, control_limit=1.0, anti_windup=mode
        )
        run(controller, np.full(2000, -5.0))
        u = run(controller, np.full(2000, 0.5))
        return int(np.count_nonzero(u[:, 0] > 0.9))

    assert samples_to_recover(anti_windup) < 15
    assert samples_to_recover('none') > 1000


def test_clamping_lets_the_integral_come_back():
    controller = pid(proportional_gain=0.0, integral_gain=100.0, derivative_gain=0.0, control_limit=1.0)
    u = run(controller, np.full(300, -1.0))
    assert u[-1, 0] == pytest.approx(1.0)
    assert u[-1, 1] <= 1.0 + 0.01
    u = run(controller, np.full(10, 1.0))
    assert u[-1, 0] == pytest.approx(1.0 - 0.1, abs=0.011)


def test_limits_both_ways():
    controller = pid(proportional_gain=1.0, integral_gain=0.0, derivative_gain=0.0, control_limit=0.3)
    assert step(controller, 0, 5.0, 0.0, 0.0, 0.0, 0.0) == (-0.3, -5.0, -5.0)
    assert step(controller, 1, -5.0, 0.0, 0.0, 0.0, 0.0) == (0.3, 5.0, 5.0)


def test_update_makes_no_bump():
    controller = pid(proportional_gain=1.0, integral_gain=10.0, derivative_gain=0.5)
    before = run(controller, np.full(200, 0.3), np.full(200, 0.1))[-1, 0]
    controller.update(PidParameters(**PLAIN, proportional_gain=7.0, integral_gain=4.0, derivative_gain=0.1))
    after = step(controller, 200, 0.3, 0.1, 0.0, 0.0, 0.0)[0]
    assert after == pytest.approx(before - 4.0 * T * 0.3, rel=1e-12)


@pytest.mark.parametrize('integral', [10.0, 0.0])
def test_update_to_no_integral_fades(integral):
    gains: dict[str, Any] = {'integral_gain': 0.0, 'derivative_gain': 0.2, 'transfer_time': 0.05}
    controller = pid(proportional_gain=1.0, **{**gains, 'integral_gain': integral})
    before = run(controller, np.full(200, 0.3), np.full(200, 0.1))[-1, 0]
    controller.update(PidParameters(**PLAIN, proportional_gain=3.0, **gains))
    u = run(controller, np.full(2000, 0.3), np.full(2000, 0.1))[:, 0]
    settled = -3.0 * 0.3 - 0.2 * 0.1
    assert u[0] == pytest.approx(before, rel=1e-12)
    np.testing.assert_allclose(u, settled + (before - settled) * np.exp(-np.arange(2000) * T / 0.05), rtol=1e-9)


def test_a_new_feedforward_fades_in():
    gains: dict[str, Any] = {
        'proportional_gain': 1.0,
        'integral_gain': 4.0,
        'derivative_gain': 0.0,
        'transfer_time': 0.05,
    }
    controller = pid(**gains)
    before = step(controller, 0, 0.0, 0.0, 0.0, 2.0, -3.0)[0]
    controller.update(PidParameters(**PLAIN, **gains, velocity_feedforward=0.5, acceleration_feedforward=0.1))
    u = [step(controller, k, 0.0, 0.0, 0.0, 2.0, -3.0)[0] for k in range(1, 4000)]
    assert u[0] == pytest.approx(before, abs=1e-12)
    assert u[-1] == pytest.approx(0.5 * 2.0 - 0.1 * 3.0, rel=1e-3)


@pytest.mark.parametrize('offset', range(5))
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_not_hidden(offset, value):
    inputs = [0.1, 0.1, 0.1, 0.1, 0.1]
    inputs[offset] = value
    assert not math.isfinite(step(pid(), 0, *inputs)[0])


def test_compiling_changes_no_bit():
    from hdd_servo_ros.control.pid import pid_step

    parameters = PidParameters(derivative_bandwidth=900.0, anti_windup='back_calculation', control_limit=0.2)
    compiled, plain = Pid(parameters, T), Pid(parameters, T)
    rng = np.random.default_rng(2)
    for k in range(500):
        inputs = rng.normal(size=5).tolist()
        expected = cast(Any, pid_step).py_func(*plain.arrays, *UNIT.inputs(k, *inputs))
        assert step(compiled, k, *inputs) == tuple(float(value) for value in expected)
    assert compiled.state.tolist() == plain.state.tolist()
