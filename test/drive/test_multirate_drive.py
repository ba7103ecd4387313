"""The drive with a command that changes within the sample, against scipy's model at the rate of the updates."""

from typing import Any

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
TICKS = 2000
VISCOUS = 4e-5
DRIVES: dict[str, dict[str, Any]] = {
    'free': {'friction.model': 'none'},
    'viscous': {'friction.model': 'viscous', 'friction.viscous_coefficient': VISCOUS, 'substeps': 32},
    'six substeps': {'friction.model': 'none', 'substeps': 6},
}


def parameters(values):
    return from_mapping(PlantParameters, {'control_limit': 1e6, **values})


def lifted_pulse_response(values, count):
    """Return position [um] and velocity [um/s] at the rate of the updates after 1 V over one update, by lifting."""
    found = np.zeros((count * (TICKS - 1) + 1, 2))
    for update in range(count):
        voltages = np.zeros(count)
        voltages[update] = 1.0
        plant = Plant(parameters(values), T, is_multirate=True)
        quarters = np.repeat(voltages, 4 // count).tolist()
        for tick in range(1, TICKS):
            first, *later = quarters if tick == 1 else (0.0, 0.0, 0.0, 0.0)
            x, v, _ = plant.step(tick, first, 0.0, (later[0], later[1], later[2]))
            # The update is the one of number ``update``, so the tick is this many updates later.
            found[count * tick - update] = x, v
    return found


def continuous(values):
    """Return a cascade of the body and the sections, from u to head position and velocity."""
    p = parameters(values)
    resonance = ResonanceParameters()
    a, b = np.zeros((10, 10)), np.zeros((10, 1))
    a[0, 1] = 1.0
    a[1, 1] = -p.gain * VISCOUS if p.friction.model == 'viscous' else 0.0
    b[1] = p.gain
    shown = np.eye(1, 10)[0]
    for section in range(4):
        b2, b1, b0 = resonance.numerators[3 * section : 3 * section + 3]
        _, a1, a0 = resonance.denominators[3 * section : 3 * section + 3]
        q, rate = 2 + 2 * section, 3 + 2 * section
        a[q, rate] = 1.0
        a[rate] += shown
        a[rate, [q, rate]] -= a0, a1
        shown = b2 * shown
        shown[[q, rate]] += b0 - b2 * a0, b1 - b2 * a1
    return a, b, np.array([shown, shown @ a]), np.zeros((2, 1))


@pytest.mark.parametrize('count', [2, 4])
@pytest.mark.parametrize('drive', DRIVES)
def test_response_up_to_the_nyquist_frequency_of_the_updates(drive, count):
    """Within 0.1 dB and 1 degree; exact without friction, where the error is below 1e-6 dB."""
    values, fast = DRIVES[drive], T / count
    a, b, c, _, _ = signal.cont2discrete(continuous(values), fast, 'zoh')
    # The change of the velocity per update has a response without the pole of a free body.
    pulse = np.diff(lifted_pulse_response(values, count)[:, 1], prepend=0.0)
    frequencies = np.geomspace(100.0, 0.5 / fast, 400)
    z = np.exp(2j * np.pi * frequencies * fast)
    found = np.array([np.sum(pulse * point ** -np.arange(len(pulse))) for point in z])
    expected = np.array([(c @ np.linalg.solve(point * np.eye(len(a)) - a, b))[1, 0] for point in z])
    ratio = found / (expected * (1.0 - 1.0 / z))
    decibels, degrees = np.abs(20.0 * np.log10(np.abs(ratio))), np.abs(np.angle(ratio, deg=True))
    assert decibels.max() < 0.1
    assert degrees.max() < 1.0
    if drive != 'viscous':
        assert decibels.max() < 1e-6


def test_equal_voltages_are_one_update():
    """To the bit, with friction, with crash stops, and with any multiple of four substeps."""
    for values in ({}, {'travel.lower': -1.0, 'travel.upper': 1.0}, {'actuator.driver': 'current', 'substeps': 8}):
        once, often = Plant(parameters(values), T), Plant(parameters(values), T, is_multirate=True)
        for tick, u in enumerate(np.random.default_rng(2).normal(scale=0.2, size=300).tolist(), 1):
            assert often.step(tick, u, 0.01, (u, u, u)) == once.step(tick, u, 0.01)


def test_each_voltage_is_limited():
    limited = Plant(from_mapping(PlantParameters, {'control_limit': 1.0}), T, is_multirate=True)
    exact = Plant(parameters({}), T, is_multirate=True)
    assert limited.step(1, 5.0, 0.0, (-5.0, 0.5, 2.0)) == exact.step(1, 1.0, 0.0, (-1.0, 0.5, 1.0))


def test_later_voltages_need_a_multirate_drive():
    with pytest.raises(ValueError, match='later_voltages'):
        Plant(PlantParameters(), T).step(1, 0.0, 0.0, (0.0, 0.0, 0.0))


def test_parameters_changed_during_a_run_keep_the_substeps_of_each_quarter():
    plant = Plant(parameters({'substeps': 6}), T, is_multirate=True)
    plant.update(parameters({'substeps': 1}))
    assert plant.responses.shape[0] == 4
