"""The estimated error on sines, against simulated runs."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.analysis.sensitivity import LinearController
from hdd_servo_ros.analysis.sine_error import HARMONICS, SineErrors, command_harmonics
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.pid_search import pid_gains
from hdd_servo_ros.studies.tuning_runs import run_sine, track

T = 1e-4
GUIDE = LinearController(0.52, 9.5e-5, 30.0)
"""Any controller that tracks."""


@pytest.fixture(scope='module')
def estimate():
    ldv = LdvParameters()
    commands = {}
    for frequency in (100.0, 200.0):
        command = run_sine('pid', pid_gains(GUIDE), {}, T, frequency, 1.0).control[-5000:, 0]
        commands[frequency] = command_harmonics(command, frequency, T)
    return SineErrors(PlantParameters(), T, commands, ldv.displacement_noise, ldv.velocity_noise)


@pytest.mark.parametrize(
    ('law', 'tolerance'),
    [
        (LinearController(0.626, 1.39e-4, 62.0, 3160.0), 0.03),
        (LinearController(0.16, 2.332e-4, 2240.0, 1491.0), 0.03),
        (LinearController(0.45, 1.87e-4, 837.0, 2000.0), 0.03),
        # An error of 7 % of the amplitude: the head goes another way, and so does the command.
        (LinearController(0.12, 9.0e-5, 10.0, 0.0), 0.1),
    ],
    ids=lambda value: f'k_i = {value.integral:g}' if isinstance(value, LinearController) else f'{value:g}',
)
def test_the_estimate_is_nearly_the_simulated_error(estimate, law, tolerance):
    for frequency, square in estimate.mean_squares(law).items():
        simulated = track('pid', pid_gains(law), {}, T, frequency, 2.0, 0.5).rms_error
        assert 1e3 * np.sqrt(square) == pytest.approx(simulated, rel=tolerance)


def test_the_noise_alone():
    """Without a command the noise is left: what it moves the head of a drive that is to stand still."""
    law = LinearController(0.626, 1.39e-4, 62.0, 3160.0)
    drive, still = {'friction.model': 'none'}, {'waveform': 'constant', 'amplitude': 0.0}
    sections: dict[str, Any] = {'vcm_plant': drive, 'pid_controller': pid_gains(law), 'reference_generator': still}
    head = Experiment(T, 'pid', sections).run(0, 100001).head[5000:, 0]
    ldv = LdvParameters()
    plant = from_mapping(PlantParameters, drive)
    estimate = SineErrors(plant, T, {100.0: np.zeros(1)}, ldv.displacement_noise, ldv.velocity_noise)
    assert np.sqrt(estimate.mean_squares(law)[100.0]) == pytest.approx(np.std(head), rel=0.03)


def test_command_harmonics():
    t = np.arange(2000) * T
    u = 0.3 * np.sin(2 * np.pi * 100.0 * t + 0.4) + 0.02 * np.cos(2 * np.pi * 300.0 * t)
    found = command_harmonics(u, 100.0, T)
    assert len(found) == HARMONICS
    assert found[[0, 1, 2]] == pytest.approx([0.3, 0.0, 0.02], abs=1e-12)
    assert len(command_harmonics(u, 1000.0, T)) == 4
