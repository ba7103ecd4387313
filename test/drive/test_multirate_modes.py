"""A drive of modes alone whose voltage changes within a sample, with and without an input delay."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.parameters import from_mapping

T = 4e-5


@pytest.mark.parametrize('form', ['modes', 'parallel'])
@pytest.mark.parametrize('quarters', [0, 1, 3, 4])
def test_four_voltages_a_sample_are_a_drive_with_four_samples(form: str, quarters: int) -> None:
    given: dict[str, Any] = {
        'friction.model': 'none',
        'resonance.form': form,
        'resonance.frequencies': (90.0, 4100.0),
        'resonance.damping_ratios': (0.5, 0.02),
        'resonance.residues': (1.0, -0.5),
    }
    voltages = np.random.default_rng(4).normal(0.0, 1.0, (100, 4))
    slow = from_mapping(PlantParameters, {**given, 'input_delay': quarters * T / 4, 'substeps': 4})
    multirate = Plant(slow, T, is_multirate=True)
    fast = Plant(from_mapping(PlantParameters, {**given, 'substeps': 1}), T / 4)
    delayed = np.concatenate([np.zeros(quarters), voltages.ravel()])
    for tick, (first, *later) in enumerate(voltages.tolist(), start=1):
        found = multirate.step(tick, first, 0.0, (later[0], later[1], later[2]))
        for part in range(4):
            number = 4 * (tick - 1) + part
            expected = fast.step(number + 1, float(delayed[number]))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
