"""A contact that the substeps do not resolve is warnings, and resolved with `substeps: 0`."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from hdd_servo_ros.drive.friction.parameters import MODELS, FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.substeps import CHOSEN_ANGLE, LARGEST_ANGLE, MODELS_WITH_CONTACT, needed_substeps
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.simulation.simulate import main as simulate
from test.conftest import ROOT

T = 1e-4
STIFFNESSES = (0.02168, 0.2168, 2.168, 21.68, 216.8)


def drive(model, stiffness, substeps):
    friction = replace(FrictionParameters(), model=model, stiffness=stiffness)
    return PlantParameters(substeps=substeps, friction=friction)


def positions(parameters):
    plant = Plant(parameters, T)
    control = 0.1 * np.sin(2.0 * np.pi * 100.0 * T * np.arange(500))
    return np.array([plant.step(tick, u)[0] for tick, u in enumerate(control.tolist(), start=1)])


def angle(parameters):
    """Return the angle of the contact's mode in a substep [rad], by the issue's own formula."""
    return math.sqrt(parameters.gain * parameters.friction.stiffness) * T / parameters.substeps_at(T)


@pytest.mark.parametrize('model', ['lugre', 'lugre_position', 'complete'])
@pytest.mark.parametrize('stiffness', STIFFNESSES)
def test_no_substeps_choose_enough(model, stiffness):
    chosen = drive(model, stiffness, 0)
    assert Plant(chosen, T).warnings() == ()
    assert angle(chosen) <= CHOSEN_ANGLE * (1.0 + 1e-12)
    exact = positions(drive(model, stiffness, 1024))
    assert np.abs(positions(chosen) - exact).max() <= 0.05 * np.abs(exact).max()


def test_errors_of_a_tenth_give_a_warning_and_smaller_errors_do_not():
    for model in ('lugre', 'lugre_position'):
        for stiffness in STIFFNESSES:
            given = drive(model, stiffness, 4)
            exact = positions(drive(model, stiffness, 1024))
            error = np.abs(positions(given) - exact).max() / np.abs(exact).max()
            is_warnings = bool(Plant(given, T).warnings())
            assert is_warnings == (angle(given) > LARGEST_ANGLE)
            assert is_warnings == (error > 0.1), (model, stiffness, error)


@pytest.mark.parametrize('model', [model for model in MODELS if model not in (*MODELS_WITH_CONTACT, 'rbf_network')])
def test_models_without_a_contact_do_not_depend_on_the_stiffness(model):
    """Without a contact nothing needs resolving: the results are bit-identical for any value."""
    soft, stiff = (positions(drive(model, stiffness, 4)) for stiffness in (0.02168, 216.8))
    np.testing.assert_array_equal(soft, stiff)
    assert Plant(drive(model, 216.8, 4), T).warnings() == ()
    assert drive(model, 216.8, 0).substeps_at(T) == 4


@pytest.mark.parametrize('model', MODELS_WITH_CONTACT)
def test_models_with_a_contact_depend_on_it(model):
    soft, stiff = (positions(drive(model, stiffness, 4)) for stiffness in (0.02168, 2.168))
    assert np.abs(soft - stiff).max() > 0.0


def test_the_bits_of_a_given_number_stay():
    assert PlantParameters().substeps == 4
    np.testing.assert_array_equal(positions(PlantParameters(substeps=4)), positions(PlantParameters(substeps=0)))
    with pytest.raises(ParameterError, match='substeps: -1;'):
        PlantParameters(substeps=-1)


def test_the_bounds_of_the_choice():
    assert needed_substeps(0.0, T) == 4
    assert needed_substeps(1e300, T) == 1024
    assert needed_substeps(math.inf, T) == 1024
    warning = Plant(drive('lugre', 1e9, 0), T).warnings()[0]
    assert 'even 1024 substeps do not resolve it' in warning


@pytest.mark.parametrize('file', sorted((ROOT / 'params').glob('*.yaml')), ids=lambda path: path.stem)
def test_the_shipped_drives_are_resolved(file):
    sections = yaml.safe_load(file.read_text()) or {}
    own = {
        name: value
        for node, section in sections.items()
        if node.rsplit('/', 1)[-1] == 'vcm_plant'
        for name, value in flat(section['ros__parameters']).items()
    }
    friction = {name.removeprefix('friction.'): value for name, value in own.items() if name.startswith('friction.')}
    known = {name: value for name, value in friction.items() if not isinstance(value, list)}
    plant = PlantParameters(
        gain=float(own.get('gain', PlantParameters().gain)),
        substeps=own.get('substeps', 4),
        friction=replace(FrictionParameters(), **known),
    )
    assert Plant(plant, T).warnings() == ()


def flat(section, prefix=''):
    found: dict[str, object] = {}
    for name, value in section.items():
        found |= flat(value, f'{prefix}{name}.') if isinstance(value, dict) else {f'{prefix}{name}': value}
    return found


def test_simulate_warns_before_the_run(capsys):
    given = ('record:=false', 'duration:=0.01', 'controller:=open_loop', 'friction.stiffness:=216.8')
    words = [word for argument in given for word in ('-p', argument)]
    assert simulate(['--ros-args', *words]) == 0
    warnings = [line for line in capsys.readouterr().err.splitlines() if 'contact not resolved' in line]
    assert len(warnings) == 1
    assert 'sqrt(gain * friction.stiffness) = 1.5e+04 Hz turns by 2.36 rad per substep (limit 0.3)' in warnings[0]
    assert 'set substeps to 315, or to 0 for an automatic choice' in warnings[0]
    assert simulate(['--ros-args', *words, '-p', 'substeps:=0']) == 0
    assert 'contact not resolved' not in capsys.readouterr().err
