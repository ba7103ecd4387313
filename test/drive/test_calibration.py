"""
Low-frequency behavior of the default drive against thesis figs. 2.3 and 5.4 and their text.

Stepped sine through the block at T = 0.1 ms, fundamental of the head position over that of the control as sampled.
"""

import math

import numpy as np
import numpy.typing as npt
import pytest

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import Plant, PlantParameters

T = 1.0e-4
AMPLITUDES = (0.01, 0.03, 0.05, 0.1)
FREQUENCIES = (10, 15, 20, 30, 40, 50, 60, 80, 100, 110, 120, 130, 140, 150, 200, 400, 600, 800, 1000, 1250, 1500)


def fundamental(amplitude: float, frequency: int) -> complex:
    """Return head position over control [um/V], after a settling time, over whole periods."""
    plant = Plant(PlantParameters(), T)
    cycles = frequency // math.gcd(frequency, 10_000)
    block = cycles * 10_000 // frequency  # samples of so many whole cycles
    settle = block * math.ceil(2500 / block)
    measure = block * math.ceil(1000 / block)
    phase = np.exp(-2j * np.pi * frequency * T * np.arange(settle + measure))
    control = (amplitude * -phase.imag).tolist()
    head = [plant.output()[0]]
    head += [plant.step(tick, u)[0] for tick, u in enumerate(control[:-1], start=1)]
    chosen = slice(settle, None)
    return complex(np.dot(head[chosen], phase[chosen]) / np.dot(control[chosen], phase[chosen]))


@pytest.fixture(scope='module')
def responses() -> npt.NDArray[np.complex128]:
    """One row per amplitude, one column per frequency."""
    return np.array([[fundamental(a, f) for f in FREQUENCIES] for a in AMPLITUDES])


@pytest.fixture(scope='module')
def gains(responses: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    return 20.0 * np.log10(np.abs(responses))


def columns(lowest: int, highest: int) -> list[int]:
    return [i for i, f in enumerate(FREQUENCIES) if lowest <= f <= highest]


def test_plateau_and_phase_up_to_50_mv(gains: npt.NDArray[np.float64], responses: npt.NDArray[np.complex128]) -> None:
    """0 dB per decade and about 0 degrees at low frequency (sections 2.3 and 5.4)."""
    low = columns(10, 60)
    plateau = gains[:3][:, low]
    assert np.all(np.ptp(plateau, axis=1) < 2 * 1.5)
    assert np.degrees(np.angle(responses[:3][:, low])).min() > -35.0


def test_gain_at_low_frequency_rises_with_the_amplitude(gains: npt.NDArray[np.float64]) -> None:
    low = columns(10, 40)
    assert np.all(gains[3, low] - gains[0, low] > 2.0)
    assert np.all(np.diff(gains[:, low], axis=0) > 0.0)


def test_peak_falls_with_the_amplitude(gains: npt.NDArray[np.float64]) -> None:
    peak = gains[:, columns(100, 150)].max(axis=1)
    assert np.all(np.diff(peak) < -0.1)
    assert np.all(gains.max(axis=1) == peak)  # it is the response's peak


def test_double_integrator_above(gains: npt.NDArray[np.float64]) -> None:
    """Within 1.5 dB of (5.1) at 400 Hz, 1 dB from 600 Hz to 1.5 kHz; with the resonances, within 0.2 dB above."""
    f = np.array(FREQUENCIES, dtype=float)
    rigid = 20.0 * np.log10(4.0968e7 / (2.0 * np.pi * f) ** 2)
    at_400 = columns(400, 400)
    above = columns(600, 1500)
    assert np.abs(gains[:, at_400] - rigid[at_400]).max() < 1.5
    assert np.abs(gains[:, above] - rigid[above]).max() < 1.0
    linear = 20.0 * np.log10(np.abs(transfer.sampled_frequency_response(PlantParameters(), T, f)))
    high = columns(1000, 1500)
    assert np.abs(gains[:, high] - linear[high]).max() < 0.2


@pytest.mark.parametrize('frequency', [2000, 3000, 4000, 4800])
def test_resonances_are_the_linear_drives(frequency: int) -> None:
    linear = transfer.sampled_frequency_response(PlantParameters(), T, [frequency])[0]
    assert abs(20.0 * math.log10(abs(fundamental(0.5, frequency) / linear))) < 0.2
