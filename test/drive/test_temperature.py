"""Resonances over temperature: factors on frequencies and damping ratios, and a drift during a run."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.drive.temperature import TemperatureParameters, resonance_at
from hdd_servo_ros.parameters import ParameterError, from_mapping

FREQUENCIES = (4000.0, 5100.0, 7300.0)
DAMPINGS = (0.01, 0.02, 0.05)
LISTS: dict[str, Any] = {
    'two_parameter': {'frequencies': FREQUENCIES, 'damping_ratios': DAMPINGS},
    'parallel': {'frequencies': FREQUENCIES, 'damping_ratios': DAMPINGS, 'residues': (-1.0, 0.3, -0.2)},
    'modes': {'frequencies': FREQUENCIES, 'damping_ratios': DAMPINGS, 'residues': (1.0, 0.3, -0.2)},
    'sections': {},
}


def poles(parameters: PlantParameters) -> list[tuple[float, float]]:
    """Return frequency [Hz] and damping ratio of each mode of the drive's state space, ordered."""
    found = np.linalg.eigvals(transfer.head_state_space(parameters)[0])
    found = found[found.imag > 0.0]
    return sorted((abs(p) / (2.0 * math.pi), -p.real / abs(p)) for p in found)


def drive(form: str, **temperature: float) -> PlantParameters:
    friction = {'friction.model': 'none'}
    given = {f'resonance.{name}': value for name, value in {'form': form, **LISTS[form]}.items()}
    scales = {f'temperature.{name}': value for name, value in temperature.items()}
    return from_mapping(PlantParameters, {**friction, **given, **scales})


@pytest.mark.parametrize('form', LISTS)
def test_frequencies_and_damping_ratios_of_all_forms_are_scaled(form: str) -> None:
    nominal, cold = poles(drive(form)), poles(drive(form, frequency_scale=1.04, damping_scale=0.8))
    np.testing.assert_allclose(cold, np.array(nominal) * (1.04, 0.8), rtol=1e-9)


@pytest.mark.parametrize('form', LISTS)
@pytest.mark.parametrize('scale', [0.96, 1.04])
def test_a_frequency_scale_alone_moves_the_response_along_the_frequency_axis(form: str, scale: float) -> None:
    """R(s/f) at f times a frequency is R at this frequency, zeros included; 1/s^2 falls by f^2."""
    frequencies = np.array([50.0, 3900.0, 5200.0, 7300.0, 20_000.0])
    moved = transfer.frequency_response(drive(form, frequency_scale=scale), scale * frequencies)
    nominal = transfer.frequency_response(drive(form), frequencies)
    np.testing.assert_allclose(moved * scale**2, nominal, rtol=1e-9)


def test_antiresonances_are_scaled_too() -> None:
    hot = resonance_at(ResonanceParameters(), TemperatureParameters(frequency_scale=0.96, damping_scale=1.2))
    for nominal, scaled in (
        (ResonanceParameters().numerators[:3], hot.numerators[:3]),
        (ResonanceParameters().denominators[:3], hot.denominators[:3]),
    ):
        before, after = np.roots(nominal)[0], np.roots(scaled)[0]
        assert abs(after) == pytest.approx(0.96 * abs(before), rel=1e-12)
        assert after.real / abs(after) == pytest.approx(1.2 * before.real / abs(before), rel=1e-12)


def test_the_default_temperature_changes_nothing() -> None:
    parameters = PlantParameters()
    assert parameters.resonance_at_temperature is parameters.resonance


def test_lists_of_other_forms_are_not_scaled() -> None:
    resonance = ResonanceParameters(frequencies=(1000.0,), damping_ratios=(0.9,))
    hot = resonance_at(resonance, TemperatureParameters(damping_scale=1.2))
    assert hot.damping_ratios == (0.9,)


@pytest.mark.parametrize(('form', 'named'), [('modes', 'damping_ratios'), ('sections', 'denominators')])
def test_too_large_a_damping_scale_is_rejected_with_its_reason(form: str, named: str) -> None:
    with pytest.raises(ParameterError, match=f'leaves resonance.{named}') as caught:
        drive(form, damping_scale=50.0)
    assert caught.value.name == 'temperature.damping_scale'


def test_a_change_during_a_run_keeps_the_head_in_place() -> None:
    """The head position is continuous, and then oscillates with the new frequencies."""
    parameters = drive('modes')
    plant = Plant(parameters, 1e-5)
    for tick in range(1, 200):
        plant.step(tick, 0.1)
    before = plant.output()[0]
    hot = dataclasses.replace(parameters, temperature=TemperatureParameters(frequency_scale=0.9))
    plant.update(hot)
    assert plant.output()[0] == before
    reference = Plant(hot, 1e-5)
    reference.motion[:] = plant.motion
    found = [plant.step(tick, 0.1) for tick in range(200, 300)]
    assert found == [reference.step(tick, 0.1) for tick in range(200, 300)]
