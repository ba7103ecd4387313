"""Delay between the control voltage and the driver, against SciPy's matrix exponential."""

from typing import Any

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 60.0 / (7200.0 * 220.0)
FREQUENCIES = np.array([20.0, 300.0, 1000.0, 3000.0, 6000.0, 10_000.0])
MODES: dict[str, Any] = {
    'resonance.form': 'modes',
    'resonance.frequencies': (90.0, 4100.0),
    'resonance.damping_ratios': (0.5, 0.02),
    'resonance.residues': (1.0, -0.5),
}


def drive(delay: float, **values: Any) -> PlantParameters:
    return from_mapping(PlantParameters, {'friction.model': 'none', 'input_delay': delay, **values})


@pytest.mark.parametrize('form', [MODES, {}], ids=['modes', 'sections'])
@pytest.mark.parametrize('delay', [0.0, 0.25 * T, 0.7 * T, T])
def test_the_sampled_response_is_that_of_the_delayed_hold(form: dict[str, Any], delay: float) -> None:
    """Delay and hold together: the state after T is that of the old voltage for the delay, then of the new one."""
    nominal = drive(0.0, **form)
    a, b, c, d = transfer.head_state_space(nominal)
    before = signal.cont2discrete((a, b, c, d), delay)[:2] if delay > 0.0 else (np.eye(len(a)), np.zeros_like(b))
    after = signal.cont2discrete((a, b, c, d), T - delay)[:2] if delay < T else (np.eye(len(a)), np.zeros_like(b))
    points = np.exp(2j * np.pi * FREQUENCIES * T)
    expected = []
    for z in points:
        forced = after[0] @ before[1] / z + after[1]
        expected.append((c @ np.linalg.solve(z * np.eye(len(a)) - after[0] @ before[0], forced))[0, 0])
    found = transfer.sampled_frequency_response(drive(delay, **form), T, FREQUENCIES)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    # A delay of whole substeps is exact.
    substeps = {0.0: 4, 0.25 * T: 4, 0.7 * T: 10, T: 3}[delay]
    stepped = sampled_drive(drive(delay, substeps=substeps, **form), T, presliding=False)
    np.testing.assert_allclose(stepped.response(FREQUENCIES)[:, 0], expected, rtol=1e-4)


@pytest.mark.parametrize('form', [MODES, {}], ids=['modes', 'sections'])
def test_a_delay_within_a_substep_is_accurate_to_a_tenth_of_a_decibel(form: dict[str, Any]) -> None:
    parameters = drive(1e-5, **form)
    expected = transfer.sampled_frequency_response(parameters, T, FREQUENCIES)
    ratio = sampled_drive(parameters, T, presliding=False).response(FREQUENCIES)[:, 0] / expected
    assert np.abs(20.0 * np.log10(np.abs(ratio))).max() < 0.1
    assert np.abs(np.rad2deg(np.angle(ratio))).max() < 1.0


def test_the_continuous_response_has_the_phase_of_the_delay() -> None:
    ratio = transfer.frequency_response(drive(1e-5), FREQUENCIES) / transfer.frequency_response(drive(0.0), FREQUENCIES)
    np.testing.assert_allclose(ratio, np.exp(-2j * np.pi * FREQUENCIES * 1e-5))


def test_a_delay_of_one_sample_is_a_voltage_of_the_last_sample() -> None:
    voltages = np.random.default_rng(3).normal(0.0, 0.5, 200).tolist()
    late, early = Plant(drive(T, **{'friction.model': 'lugre'}), T), Plant(drive(0.0, **{'friction.model': 'lugre'}), T)
    found = [late.step(tick, u) for tick, u in enumerate(voltages, start=1)]
    expected = [early.step(tick, u) for tick, u in enumerate([0.0, *voltages[:-1]], start=1)]
    assert found == expected


def test_a_longer_delay_is_rejected() -> None:
    with pytest.raises(ParameterError, match='at most sample_time'):
        Plant(drive(1.1 * T), T)
