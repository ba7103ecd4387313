"""The path of the feedforward against scipy's closed loop of the same drive and controller."""

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.feedforward_path import feedforward_path
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.feedforward_parameters import FeedforwardModelParameters
from hdd_servo_ros.control.pid import Pid, PidParameters

T = 1e-4
MODEL = FeedforwardModelParameters()


@pytest.mark.parametrize('delay', [0, 1])
def test_equals_the_closed_loop_of_transfer_functions(delay):
    gains = PidParameters(
        proportional_gain=0.3, derivative_gain=5e-5, derivative_bandwidth=0.0, velocity_source='difference'
    )
    found = feedforward_path(Pid(gains, T), DspParameters(computation_delay=delay), MODEL, T, 200)
    g, k, c = MODEL.gain, MODEL.stiffness, MODEL.viscous_coefficient
    numerator, denominator, _ = signal.cont2discrete(([g], [1.0, g * c, g * k]), T, 'zoh')
    numerator = np.concatenate([np.zeros(delay), numerator[0]])
    denominator = np.concatenate([denominator, np.zeros(delay)])
    # u = -(k_p + k_i T z/(z - 1) + k_d (z - 1)/(T z)) e, over z (z - 1).
    law = np.array(
        [
            gains.proportional_gain + gains.integral_gain * T + gains.derivative_gain / T,
            -gains.proportional_gain - 2.0 * gains.derivative_gain / T,
            gains.derivative_gain / T,
        ]
    )
    over = np.array([1.0, -1.0, 0.0])
    loop = np.convolve(denominator, over) + np.convolve(numerator, law)
    pulse = np.zeros(200)
    pulse[0] = 1.0
    # The first difference of a law at rest is 0, which costs what follows nothing: the error starts at 0 as well.
    wanted = signal.lfilter(np.convolve(numerator, over), loop, pulse)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_is_that_of_the_loop_and_fades():
    for controller in (Pid(PidParameters(), T), AdaptiveNn(AdaptiveNnParameters(), T)):
        path = feedforward_path(controller, DspParameters(), MODEL, T, 256)
        assert path[0] == 0.0
        assert 0.15 < path[1] < 0.25
        assert np.abs(path[200:]).max() < 0.02 * np.abs(path).max()
