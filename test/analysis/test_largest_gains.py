"""The largest gains and the largest lambda that keep the peak sensitivity: against scans and at their edges."""

import dataclasses

import numpy as np
import pytest

from hdd_servo_ros.analysis.largest_gains import (
    largest,
    largest_gain_on_r,
    largest_lambda,
    largest_proportional_gain,
    round_down,
    round_up,
    scaled_integral_gain,
)
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 1e-4
LOW_RESONANCE = {
    'resonance.form': 'two_parameter',
    'resonance.frequencies': [1500.0],
    'resonance.damping_ratios': [0.05],
}


def test_rounding():
    assert round_down(0.0012399) == 0.00123
    assert round_down(5.0e-5) == 5.0e-5
    assert round_up(0.0012301) == 0.00124
    assert round_up(163000.0) == 163000.0


def test_largest():
    assert largest(lambda x: x <= 7.0, 1.0) == pytest.approx(7.0, rel=2e-4)
    assert largest(lambda x: x <= 7.0, 8.0) == 0.0


@pytest.mark.parametrize(
    ('derivative', 'integral', 'bandwidth', 'delay'),
    [(9.7e-5, 30.0, 0.0, 0), (1.39e-4, 62.0, 3160.0, 0), (6e-5, 20.0, 2000.0, 0), (8.6e-5, 8.0, 0.0, 1)],
)
def test_the_largest_proportional_gain_against_a_scan(derivative, integral, bandwidth, delay):
    margins = LoopMargins(PlantParameters(), T)
    law = LinearController(0.0, derivative, integral, bandwidth, delay)
    scanned = [
        k_p
        for k_p in np.arange(1e-3, 2.0, 1e-3)
        if margins.peak_sensitivity(dataclasses.replace(law, proportional=float(k_p))) <= 2.0
    ]
    assert 0.0 <= largest_proportional_gain(margins, law) - scanned[-1] < 1e-3


def test_no_proportional_gain_saves_too_large_a_derivative_gain():
    law = LinearController(0.0, 3e-4)
    assert largest_proportional_gain(LoopMargins(PlantParameters(), T), law) == 0.0


def allowed(margins, error_filter_lambda, integral_gain=0.0, delay=0):
    """Say whether any gain of a fine scan above 2 lambda m keeps the rule."""
    least = 2.0 * error_filter_lambda / margins.rigid_gain
    laws = (
        LinearController.on_r(least * factor, error_filter_lambda, integral_gain, delay)
        for factor in np.geomspace(1.0, 100.0, 200)
    )
    return any(margins.peak_sensitivity(law) <= 2.0 for law in laws)


@pytest.mark.parametrize(
    ('values', 'sample_time', 'given', 'integral', 'delay'),
    [
        (LOW_RESONANCE, T, 595.0, 0.0, 0),
        (LOW_RESONANCE, T, 595.0, 3e4, 0),
        ({}, 1e-3, 595.0, 0.0, 0),
        ({}, T, 50000.0, 0.0, 1),
        ({'actuator.driver': 'current', 'actuator.amplifier_time_constant': 1e-3}, T, 595.0, 0.0, 0),
    ],
)
def test_the_largest_lambda_against_a_scan(values, sample_time, given, integral, delay):
    margins = LoopMargins(from_mapping(PlantParameters, values), sample_time)
    found = largest_lambda(margins, given, integral, delay)
    assert found < given
    assert allowed(margins, found, scaled_integral_gain(integral, given, found), delay)
    for larger in (1.02 * found, 1.3 * found, given):
        assert not allowed(margins, larger, scaled_integral_gain(integral, given, larger), delay)
    assert largest_gain_on_r(margins, found, scaled_integral_gain(integral, given, found), delay) > 0.0


def test_a_lambda_that_the_rule_allows_stays():
    assert largest_lambda(LoopMargins(PlantParameters(), T), 595.3) == 595.3


def test_the_error_of_too_large_a_lambda_names_the_largest():
    with pytest.raises(ParameterError, match=r'error_filter_lambda: 50000.0; expected at most 2070'):
        largest_gain_on_r(LoopMargins(PlantParameters(), T), 50000.0)


def test_a_drive_on_which_no_lambda_will_do():
    values = {'resonance.frequencies': [150.0], 'resonance.damping_ratios': [0.001]}
    margins = LoopMargins(from_mapping(PlantParameters, {**LOW_RESONANCE, **values}), T)
    with pytest.raises(ParameterError, match=r'sample_time: 0.0001; .* no error_filter_lambda has a gain with Ms <= 2'):
        largest_lambda(margins, 595.0)
