"""The observer as a linear filter, against the steps of the blocks themselves."""

import numpy as np
import pytest

from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.linear_laws import pid_law
from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.analysis.sampled_observer import SampledObserver
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.control.observer import Observer, ObserverParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs

T = 1e-4
LAW = LinearController(0.15, 1.2e-4, 10.0, bandwidth=4000.0)


@pytest.mark.parametrize('parameters', [ObserverParameters(), ObserverParameters(method='difference')])
def test_responses_are_those_of_the_block(parameters):
    observer = Observer(parameters, T)
    observer.step(0.0, 0.0)
    frequency, count = 1230.0, 4000
    z = np.exp(2j * np.pi * frequency * T)
    positions, commands = (z ** np.arange(1, count)).real, (z ** np.arange(count - 1)).real
    of_position, of_command = SampledObserver(parameters, T).responses([frequency])
    for driven, response in ((True, of_position[0]), (False, of_command[0])):
        block = Observer(parameters, T)
        block.step(0.0, 0.0)
        for y, u in zip(positions, commands, strict=True):
            _, velocity = block.step(y if driven else 0.0, 0.0 if driven else u)
        # A command that is held from a tick on is given at the next one.
        assert velocity == pytest.approx((response * z ** (count - 1)).real, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize('delay', [0, 1])
@pytest.mark.parametrize('parameters', [ObserverParameters(), ObserverParameters(method='difference', bandwidth=3e3)])
def test_peak_sensitivity_is_that_of_a_loop_stepped_from_tick_to_tick(parameters, delay):
    """|S| is the spectrum of the position over that of a disturbance of the position, of the stepped loop."""
    law = LinearController(0.08, 6e-5, 5.0, bandwidth=4000.0, delay=delay)
    margins = LoopMargins(PlantParameters(), T, observer=parameters)
    drive = sampled_drive(PlantParameters(), T, presliding=False)
    pid = Pid(
        PidParameters(
            proportional_gain=law.proportional,
            derivative_gain=law.derivative,
            integral_gain=law.integral,
            derivative_bandwidth=law.bandwidth,
            control_limit=1e9,
        ),
        T,
    )
    # Stepped before, so that the first sample starts nothing.
    observer = Observer(parameters, T)
    observer.step(0.0, 0.0)
    pid.step(ControllerInputs(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    count = 2**14
    state, held, late = np.zeros(len(drive.a)), 0.0, 0.0
    seen = np.zeros(count)
    for tick in range(count):
        seen[tick] = (drive.c @ state)[0] + (tick == 0)
        _, velocity = observer.step(seen[tick], held)
        u, _, _ = pid.step(ControllerInputs(tick, seen[tick], velocity, 0.0, 0.0, 0.0, 0.0, 0.0))
        held, late = (late, u) if delay else (u, u)
        state = drive.a @ state + drive.b[:, 0] * held
    wanted = np.abs(np.fft.rfft(seen)).max()
    sliding = LoopMargins(PlantParameters(), T, observer=parameters)
    sliding.drives, sliding._bare = margins.drives[-1:], margins._bare[-1:]
    sliding.responses = margins.responses[-1:]
    assert sliding.peak_sensitivity(law) == pytest.approx(wanted, rel=2e-3)
    assert sliding.peak_sensitivities([law, law])[1] == pytest.approx(wanted, rel=1e-2)


def test_an_unstable_loop_has_no_peak():
    margins = LoopMargins(PlantParameters(), T, observer=ObserverParameters())
    assert margins.peak_sensitivity(LinearController(50.0, 1e-4)) == np.inf


def test_differences_of_the_law_itself_do_not_ask_the_observer():
    law = pid_law(PidParameters(velocity_source='difference'))
    plant = PlantParameters()
    with_observer = LoopSurroundings(plant, T, observer=ObserverParameters()).margins.peak_sensitivity(law)
    assert with_observer == pytest.approx(LoopSurroundings(plant, T).margins.peak_sensitivity(law), rel=1e-9)
