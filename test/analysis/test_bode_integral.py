"""Bode's integral by quadrature, against Jensen's formula for the poles of the loop."""

import dataclasses

import numpy as np
import pytest

from hdd_servo_ros.analysis.bode_integral import bode_integrals
from hdd_servo_ros.analysis.sampled_drive import SampledDrive
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters

T = 1e-4
PID = LinearController(0.626, 1.39e-4, 62.0, 3160.0)


@pytest.mark.parametrize('delay', [0, 1])
@pytest.mark.parametrize('sensor', [None, LdvParameters(demodulator_delay=2e-5)])
def test_it_is_zero_for_the_drive_which_is_stable(delay, sensor):
    controller = dataclasses.replace(PID, proportional=0.2, derivative=8e-5, integral=5.0, delay=delay)
    found = bode_integrals(LoopMargins(PlantParameters(), T, sensor), controller)
    assert len(found) == 2
    for integral in found:
        assert integral.theory == pytest.approx(0.0, abs=1e-6)
        assert integral.value == pytest.approx(0.0, abs=2e-4)
        assert integral.attenuation < -0.05
        assert integral.amplification == pytest.approx(-integral.attenuation, abs=2e-4)


def test_an_unstable_drive_needs_amplification():
    """A pole at 1.2 adds ln 1.2; the loop x_{k+1} = 1.2 x + u with u = -0.9 x has S = (z - 1.2)/(z - 0.3)."""
    margins = LoopMargins(PlantParameters(friction=FrictionParameters(model='none')), T)
    drive = SampledDrive(np.array([[1.2]]), np.array([[1.0]]), np.array([[1.0], [0.0]]), T)
    margins.drives = margins._bare = (drive,)
    (found,) = bode_integrals(margins, LinearController(0.9, 0.0))
    assert found.theory == pytest.approx(np.log(1.2))
    assert found.value == pytest.approx(np.log(1.2), abs=1e-6)


def test_an_unstable_loop_is_rejected():
    with pytest.raises(ValueError, match='unstable'):
        bode_integrals(LoopMargins(PlantParameters(), T), LinearController(50.0, 0.0))
