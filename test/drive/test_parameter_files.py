"""The drives of params/: each runs, and its measured response is its analytic one."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import modal_form
from hdd_servo_ros.parameters import declarations, from_mapping

PARAMS = Path(__file__).parents[2] / 'params'
FILES = ['seagate_7200_10', 'simulation_study', 'frictionless', 'small_form_factor', 'sixteen_modes']


def flatten(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= flatten(value, f'{prefix}{name}.') if isinstance(value, dict) else {prefix + name: value}
    return flat


def drive(name: str) -> PlantParameters:
    """Return the drive of a parameter file, without the parameters that the node itself declares (frame_id, ...)."""
    content = yaml.safe_load((PARAMS / f'{name}.yaml').read_text())
    known = {declaration.name for declaration in declarations(PlantParameters)}
    values = flatten(content['/**/vcm_plant']['ros__parameters'])
    return from_mapping(PlantParameters, {key: value for key, value in values.items() if key in known})


@pytest.mark.parametrize('name', FILES)
@pytest.mark.parametrize('sample_time', [1.0e-4, 2.0e-5])
def test_it_runs(name: str, sample_time: float) -> None:
    parameters = drive(name)
    plant = Plant(parameters, sample_time)
    amplitude = 0.05 * parameters.control_limit
    for tick in range(1, 2001):
        output = plant.step(tick, amplitude * math.sin(0.01 * tick))
    assert all(math.isfinite(value) for value in output)
    assert output[0] != 0.0


def test_the_default_file_is_the_default_of_the_block() -> None:
    assert drive('seagate_7200_10') == PlantParameters()


def test_section_4_4() -> None:
    p = drive('simulation_study')
    f = p.friction
    assert (p.gain, p.resonance.form) == (1.0, 'none')
    assert (f.stiffness, f.viscous_coefficient, f.coulomb_level, f.static_level) == (1.0e5, 0.4, 1.0, 1.5)
    assert f.bristle_damping == pytest.approx(math.sqrt(1.0e5), rel=1e-5)
    assert f.stribeck_velocity == 0.001
    assert (p.disturbance.amplitude, p.disturbance.angular_frequency) == (0.1, 20.0)


def test_presliding_mode_of_the_small_drive() -> None:
    p = drive('small_form_factor')
    assert math.sqrt(p.gain * p.friction.stiffness) / (2.0 * math.pi) == pytest.approx(200.0, rel=0.01)


@pytest.mark.parametrize('name', ['frictionless', 'sixteen_modes'])
@pytest.mark.parametrize('sample_time', [1.0e-4, 2.0e-5])
def test_measured_response_is_the_analytic_one(name: str, sample_time: float) -> None:
    parameters = drive(name)
    slowest = min(mode.a1 for mode in modal_form(parameters.resonance).modes)
    count = math.ceil(50.0 / slowest / sample_time)
    plant = Plant(parameters, sample_time)
    # [1, -2, 1] leaves the rigid body at rest: the record is complete once the modes have decayed.
    pulse = [1.0, -2.0, 1.0]
    head = np.array([plant.step(tick, (pulse + [0.0] * count)[tick - 1])[0] for tick in range(1, count)])
    frequencies = np.geomspace(100.0, 0.49 / sample_time, 200)
    z = np.exp(-2j * np.pi * frequencies * sample_time)
    measured = (z[:, np.newaxis] ** np.arange(1, count)) @ head / np.polyval(pulse, z)
    analytic = transfer.sampled_frequency_response(parameters, sample_time, frequencies)
    np.testing.assert_allclose(measured, analytic, rtol=1e-6)


def test_sixteen_modes_peak_where_they_are_given() -> None:
    """At T = 20 µs the sampled response has the peaks of the continuous response up to 15 kHz within 0.5 dB."""
    parameters = drive('sixteen_modes')
    assert len(modal_form(parameters.resonance).modes) == 16
    peaks = np.array([f for f in parameters.resonance.frequencies if f < 15_000.0])
    sampled = transfer.sampled_frequency_response(parameters, 2.0e-5, peaks)
    hold = np.sinc(peaks * 2.0e-5) * np.exp(-1j * np.pi * peaks * 2.0e-5)
    ratio = sampled / (transfer.frequency_response(parameters, peaks) * hold)
    assert np.abs(20.0 * np.log10(np.abs(ratio))).max() < 0.5
