"""Plots of the drive studies match the models."""

from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.studies import drive_response, friction_curves

PNG = b'\x89PNG\r\n\x1a\n'


def test_friction_curves(tmp_path: Path) -> None:
    paths = friction_curves.write_plots(tmp_path / 'plots')
    assert [path.name[:7] for path in paths] == ['fig_2_1', 'fig_2_2', 'fig_5_5']
    assert all(path.read_bytes().startswith(PNG) for path in paths)


def test_curves_of_fig_2_1_and_2_2() -> None:
    coulomb, viscous, _ = friction_curves.draw_static_friction().axes
    x, y = coulomb.lines[0].get_data()
    np.testing.assert_array_equal(y, np.sign(np.asarray(x)))
    x, y = viscous.lines[0].get_data()
    np.testing.assert_allclose(np.asarray(y), np.sign(np.asarray(x)) + 0.3 * np.asarray(x))
    any_exponent, _ = friction_curves.draw_dahl().axes
    x, y = any_exponent.lines[1].get_data()
    # alpha = 1, first loading: F/f_c = 1 - exp(-sigma x/f_c)
    np.testing.assert_allclose(np.asarray(y)[:401], 1.0 - np.exp(-np.asarray(x)[:401]), atol=1e-12)


def test_drive_response(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive_response, 'FREQUENCIES', (50, 100))
    monkeypatch.setattr(drive_response, 'HIGH', (500, 1000))
    paths = drive_response.write_plots(tmp_path)
    assert all(path.read_bytes().startswith(PNG) for path in paths)


def test_stepped_sine_is_the_linear_response_without_friction() -> None:
    # A pivot of springs alone: linear, and it holds the body in place.
    friction = FrictionParameters(
        stiffness=0.02, bristle_damping=2.0e-5, viscous_coefficient=0.0, coulomb_level=1.0e3, static_level=1.0e3
    )
    parameters = PlantParameters(friction=friction, resonance=ResonanceParameters(form='none'), substeps=16)
    f = np.array([50, 100, 400])
    s = 2j * np.pi * f
    expected = 1.0 / (s * s / parameters.gain + 2.0e-5 * s + 0.02) * np.sinc(f * 1e-4) * np.exp(-1j * np.pi * f * 1e-4)
    measured = drive_response.stepped_sine(parameters, 0.01, f.tolist())
    np.testing.assert_allclose(measured, expected, rtol=2e-3)


def test_convergence_table() -> None:
    control = 0.2 * np.sin(2.0 * np.pi * 100.0 * 1.0e-4 * np.arange(100))
    errors = drive_response.convergence(PlantParameters(), control)
    assert list(errors) == list(drive_response.SUBSTEPS)
    assert errors[1][0] > 50.0 * errors[32][0]


def test_resonances_show_in_the_response_at_the_fast_sample_time() -> None:
    f = [5500, 6500, 7875, 14_500]
    measured = drive_response.stepped_sine(PlantParameters(), 0.5, f, drive_response.FAST)
    model = transfer.sampled_frequency_response(PlantParameters(), drive_response.FAST, f)
    assert np.abs(20.0 * np.log10(np.abs(measured / model))).max() < 0.05
