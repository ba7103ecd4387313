"""The drives of public benchmarks against SciPy: poles, gains and sampled responses of every perturbed drive."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.campaign.planning import Plan
from hdd_servo_ros.campaign.spec import read_spec
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.experiment import Experiment

Numbers = tuple[float, ...]
Array = npt.NDArray[np.float64]

PARAMS = Path(__file__).parents[2] / 'params'
CAMPAIGNS = PARAMS / 'campaigns'
TRACK = 2.54e-7
"""Track pitch of the NSS benchmark [m]."""
T = 60.0 / 7200.0 / 220.0
FREQUENCIES = np.array([20.0, 90.0, 300.0, 1000.0, 2000.0, 2990.0, 4100.0, 5005.0, 7000.0, 8200.0, 10_000.0])


def percent(values: Numbers, changes: Numbers) -> Array:
    return np.array(values) * (1.0 + np.array(changes) / 100.0)


def nss_v1() -> list[tuple[float, Array, Array, Array]]:
    """Return force constant over mass [m/s^2/A], frequencies [Hz], damping ratios and residues of the 30 drives."""
    frequencies = (90.0, 4100.0, 8200.0, 12300.0, 16400.0, 3000.0, 5000.0)
    zetas = np.array((0.5, 0.02, 0.02, 0.02, 0.02, 0.005, 0.001))
    residues = (1.0, -1.0, 1.0, -1.0, 1.0, 0.01, 0.03)
    shifts = (
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 15.0, 15.0, 10.0, 10.0, 5.0, 5.0),
        (0.0, -15.0, -15.0, -10.0, -10.0, -5.0, -5.0),
        (0.0, 15.0, -15.0, -10.0, 10.0, 5.0, 5.0),
        (0.0, -15.0, 15.0, 10.0, -10.0, -5.0, -5.0),
    )
    signs = ((0.0,) * 7, (0.0, 0.0, 0.0, 0.0, 0.0, -200.0, -200.0))
    return [
        (0.9512 / 1e-3 * (1.0 + gain / 100.0), percent(frequencies, shift), zetas, percent(residues, sign))
        for gain in (0.0, 10.0, -10.0)
        for shift in shifts
        for sign in signs
    ]


def nss_v2() -> list[tuple[float, Array, Array, Array]]:
    """Return the same of the 18 drives of version 2."""
    frequencies = (90.0, 3000.0, 4100.0, 5000.0, 7000.0, 12300.0, 16400.0)
    zetas = (0.5, 0.01, 0.03, 0.01, 0.01, 0.005, 0.005)
    residues = (1.0, -0.01, -1.0, 0.3, -1.0, 1.0, -1.0)
    return [
        (1.0 / 1e-3, percent(frequencies, shift), percent(zetas, damping), percent(residues, sign))
        for shift in ((0.0,) * 7, (0.0, 1.0, 2.5, 0.5, 0.5, 0.5, 0.5), (0.0, -2.0, -5.0, -2.0, -2.0, -2.0, -2.0))
        for damping in ((0.0,) * 7, (0.0,) * 4 + (-50.0,) * 3, (0.0,) * 4 + (100.0,) * 3)
        for sign in ((0.0,) * 7, (0.0, -200.0, 20.0, -200.0, 0.0, 0.0, 0.0))
    ]


def nss_v2_seek() -> list[tuple[float, Array, Array, Array]]:
    """Return the same with the first mode at 0 Hz, without damping."""
    keep = np.array([0.0] + [1.0] * 6)
    return [(gain, f * keep, z * keep, c) for gain, f, z, c in nss_v2()]


def atsumi() -> list[tuple[float, Array, Array, Array]]:
    """Return the same of the voice-coil motor of Atsumi's benchmark at low, room and high temperature, in um."""
    frequencies = np.array(
        (0, 5300, 6100, 6500, 8050, 9600, 14800, 17400, 21000, 26000, 26600, 29000, 32200, 38300, 43300, 44800), float
    )
    zetas = np.array((0, 0.02, 0.04, 0.02, 0.01, 0.03, 0.01, 0.02, 0.02, 0.012, 0.007, 0.01, 0.03, 0.01, 0.01, 0.01))
    residues = np.array((1, -1, 0.1, -0.1, 0.04, -0.7, -0.2, -1, 3, -3.2, 2.1, -1.5, 2, -0.2, 0.3, -0.5))
    return [(37.976, f * frequencies, z * zetas, residues) for f, z in ((1.04, 0.8), (1.0, 1.0), (0.96, 1.2))]


def state_space(gain: float, f: Array, z: Array, c: Array, length: float) -> tuple[Array, Array, Array, Array]:
    """Return the drive as a state space (y, y'/2 pi 1 kHz) of each mode; head in units of ``length`` [m]."""
    n = len(f)
    w, unit = 2.0 * math.pi * f, 2.0 * math.pi * 1000.0
    a = np.zeros((2 * n, 2 * n))
    b, out = np.zeros((2 * n, 1)), np.zeros((1, 2 * n))
    for i in range(n):
        a[2 * i, 2 * i + 1] = unit
        a[2 * i + 1, 2 * i : 2 * i + 2] = -(w[i] ** 2) / unit, -2.0 * z[i] * w[i]
        b[2 * i + 1, 0] = gain * c[i] / length / unit
        out[0, 2 * i] = 1.0
    return a, b, out, np.zeros((1, 1))


def drives(name: str) -> list[PlantParameters]:
    """Return the drives of a campaign."""
    return [from_mapping(PlantParameters, dict(case)) for case in plants_of(name)]


def plant_values(*files: Path) -> dict[str, Any]:
    """Return the parameters of the drive in parameter files, without its name."""
    values = read_parameter_files(files)['vcm_plant']
    return {name: value for name, value in values.items() if name != 'frame_id'}


def plants_of(name: str) -> list[dict[str, Any]]:
    spec = read_spec(CAMPAIGNS / f'{name}.yaml')
    base = plant_values(*spec.files)
    prefix = 'vcm_plant:'
    return [
        {**base, **{key.removeprefix(prefix): value for key, value in point.varied.items() if key.startswith(prefix)}}
        for point in Plan(spec)
        if point.controller == spec.controllers[0].name
    ]


CASES = {
    'nss_v1_drives': (nss_v1, T, FREQUENCIES, 1e-5),
    'nss_v2_drives': (nss_v2, T, FREQUENCIES, 1e-5),
    'nss_v2_seek_drives': (nss_v2_seek, T, FREQUENCIES, 1e-5),
    'atsumi_vcm_temperatures': (atsumi, 60.0 / 7200.0 / 420.0, np.append(FREQUENCIES, (17_000.0, 24_000.0)), 0.0),
}


def decibels(ratio: npt.NDArray[np.complex128]) -> float:
    """Return the largest magnitude of a ratio [dB]."""
    return float(np.abs(20.0 * np.log10(np.abs(ratio))).max())


@pytest.mark.parametrize('name', CASES)
def test_every_drive_of_a_campaign_is_that_of_the_benchmark(name: str) -> None:
    numbers, sample_time, frequencies, delay = CASES[name]
    found, given = drives(name), numbers()
    assert len(found) == len(given)
    for parameters, (gain, f, z, c) in zip(found, given, strict=True):
        # The benchmark has tracks per ampere, the drive um per ampere.
        a, b, out, d = state_space(gain, f, z, c, TRACK)
        s = 2j * np.pi * frequencies
        w = 2.0 * np.pi * f
        terms = [residue / (s * s + 2.0 * zi * wi * s + wi * wi) for residue, zi, wi in zip(c, z, w, strict=True)]
        reference = gain / TRACK * np.sum(terms, axis=0) * np.exp(-s * delay)
        in_tracks = transfer.frequency_response(parameters, frequencies) / (TRACK / 1e-6)
        assert decibels(in_tracks / reference) < 1e-6
        poles, expected = (np.linalg.eigvals(matrix) for matrix in (transfer.head_state_space(parameters)[0], a))
        for found_poles in (poles, expected):
            found_poles[:] = found_poles[np.argsort(found_poles.imag)]
        np.testing.assert_allclose(poles, expected, rtol=1e-7, atol=1e-2)
        # The step of the kernel, with the hold at the sampling rate of the benchmark.
        ad, bd, cd, *_ = signal.cont2discrete((a, b, out, d), sample_time)
        own = signal.cont2discrete((a, b, out, d), sample_time - delay)[1]
        points = np.exp(2j * np.pi * frequencies * sample_time)
        held = np.array([(cd @ np.linalg.solve(p * np.eye(len(ad)) - ad, own + (bd - own) / p))[0, 0] for p in points])
        stepped = sampled_drive(parameters, sample_time, presliding=False).response(frequencies)[:, 0] / 0.254
        # The delay of 10 us is 5.02 substeps, which costs most of this.
        assert decibels(stepped / held) < (0.01 if delay else 1e-3)
        np.testing.assert_allclose(np.angle(stepped / held, deg=True), 0.0, atol=0.1 if delay else 1e-2)


@pytest.mark.parametrize(
    ('file', 'gain', 'first'), [('nss_v1', 951.2, 'nss_v1_drives'), ('nss_v2', 1000.0, 'nss_v2_drives')]
)
def test_the_nominal_drive_is_the_first_of_its_campaign(file: str, gain: float, first: str) -> None:
    nominal = from_mapping(PlantParameters, plant_values(PARAMS / f'{file}.yaml'))
    assert nominal == drives(first)[0]
    # At rest the first mode is a spring: 90 Hz.
    assert abs(transfer.frequency_response(nominal, 0.1)) == pytest.approx(
        1e6 * gain / (2.0 * math.pi * 90.0) ** 2, rel=0.01
    )


@pytest.mark.parametrize('file', ['nss_v1', 'nss_v2'])
def test_the_disturbances_have_the_variances_of_the_benchmark(file: str) -> None:
    """Flutter: white noise of variance 1 per sample, held, through A 2 z w^2/(s^2 + 2 z w s + w^2)."""
    sections: Any = read_parameter_files([PARAMS / f'{file}.yaml'])
    given = sections['disturbance_generator']
    amplitudes = (0.09, 0.17, 0.20, 0.17, 0.06, 0.09, 0.06, 0.06, 0.12)
    lists = zip(given['flutter.frequencies'], given['flutter.damping_ratios'], given['flutter.sigmas'], strict=True)
    for (f, z, sigma), amplitude in zip(lists, amplitudes, strict=True):
        w = 2.0 * math.pi * f
        system = (np.array([[0.0, w], [-w, -2.0 * z * w]]), np.array([[0.0], [2.0 * z * w]]))
        ad, bd, *_ = signal.cont2discrete((*system, np.eye(2), np.zeros((2, 1))), T)
        impulse, state = [], bd[:, 0]
        for _ in range(round(20.0 / (z * w * T))):
            impulse.append(state[0])
            state = ad @ state
        assert sigma / 0.254 == pytest.approx(amplitude * math.sqrt(np.square(impulse).sum()), rel=1e-3)
    assert np.array(given['runout.repeatable.amplitudes']) / 0.254 == pytest.approx([0.15, 0.03, 0.006])
    assert given['force_noise.sigma'] == 1e-4
    assert sections['servo_sensor']['noise'] / 0.254 == pytest.approx(0.015)
    assert sections['servo_sensor']['track_pitch'] == pytest.approx(TRACK * 1e6)
    assert sections['deterministic_timer']['sample_time'] == pytest.approx(T, abs=0.5e-9)


@pytest.mark.parametrize(
    ('name', 'runs'),
    [
        ('nss_v1_drives', 30),
        ('nss_v2_drives', 18),
        ('nss_v2_seek_drives', 18),
        ('atsumi_vcm_temperatures', 3),
        ('sixteen_modes_temperatures', 6),
    ],
)
def test_every_shipped_campaign_has_its_runs(name: str, runs: int) -> None:
    assert {path.stem for path in CAMPAIGNS.glob('*.yaml')} >= {name}
    assert len(Plan(read_spec(CAMPAIGNS / f'{name}.yaml'))) == runs


@pytest.mark.parametrize('file', ['nss_v1', 'nss_v2'])
def test_the_shipped_controller_follows_the_track_of_the_benchmark(file: str) -> None:
    """The measured error stays within a fifth of the track pitch from the fourth revolution on."""
    sections: Any = read_parameter_files([PARAMS / f'{file}.yaml'])
    sample_time = sections['deterministic_timer']['sample_time']
    run = Experiment(sample_time, 'pid', sections, sensor='servo').run(0, 220 * 12)
    error = np.asarray(run['pes'])[220 * 4 :, 0]
    assert 0.01 < np.abs(error).max() / 0.254 < 0.2
