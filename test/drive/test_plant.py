"""The plant as a block: parameters, disturbances, updates, bits."""

import hashlib
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.parameters import MODELS, FrictionParameters
from hdd_servo_ros.drive.plant import PLANT_STATE, DisturbanceParameters, Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError, from_mapping, to_mapping

T = 1.0e-4
RIGID = PlantParameters(friction=FrictionParameters(model='none'), resonance=ResonanceParameters(form='none'))


@pytest.mark.parametrize(
    ('values', 'allowed'),
    [
        ({'gain': -1.0}, 'above 0'),
        ({'gain': math.nan}, 'finite'),
        ({'substeps': -1}, 'at least 0'),
        ({'control_limit': 0.0}, 'above 0'),
        ({'friction.stiffness': -1.0}, 'above 0'),
        ({'friction.static_level': 0.1}, 'at least coulomb_level, which is 0.13'),
        ({'friction.stribeck_velocity': 0.0}, 'above 0'),
        ({'friction.stribeck_velocity': math.nan}, 'finite'),
        ({'friction.coulomb_level': math.inf}, 'finite'),
        ({'friction.bristle_damping': -1.0e-9}, 'at least 0'),
        ({'friction.position_ripple': 1.0}, 'at most 0.99'),
        ({'friction.model': 'sticky'}, 'one of none, stiction'),
        ({'friction.square_root_coefficient': -1.0, 'friction.model': 'square_root'}, 'friction dissipates'),
        (
            {'friction.node_positions': (1.0,), 'friction.node_weights': (1.0, 2.0), 'friction.model': 'rbf_network'},
            'a list of 2 numbers',
        ),
        ({'resonance.denominators': (1.0, 2053.0)}, 'a list of 12 numbers'),
        ({'resonance.damping_ratios': (0.5, 2.0)}, 'at most'),
        ({'disturbance.angular_frequency': -1.0}, 'at least 0'),
        ({'actuator.inertia': 0.0}, 'above 0'),
        ({'friction.mass': 1.0}, 'unknown parameter friction.mass; known: '),
    ],
)
def test_bad_parameters_are_named(values: dict[str, object], allowed: str) -> None:
    with pytest.raises(ParameterError, match=allowed) as error:
        from_mapping(PlantParameters, values)
    assert error.value.name == next(iter(values))


def test_parameters_of_other_models_do_not_matter() -> None:
    # A Coulomb model with f_c above the default f_s is a Coulomb model.
    assert FrictionParameters(model='coulomb', coulomb_level=1.0).coulomb_level == 1.0


def test_mapping_round_trip() -> None:
    parameters = replace(PlantParameters(), substeps=7, friction=FrictionParameters(model='dahl'))
    assert from_mapping(PlantParameters, to_mapping(parameters)) == parameters


@pytest.mark.parametrize('sample_time', [0.0, -1.0, math.nan, math.inf])
def test_sample_time_is_checked(sample_time: float) -> None:
    with pytest.raises(ParameterError, match='sample_time'):
        Plant(PlantParameters(), sample_time)


def test_disturbance_acts_against_the_control() -> None:
    """M x'' + h + d = u (4.1): d = u leaves the body at rest."""
    plant = Plant(RIGID, T)
    assert plant.step(1, 0.7, 0.7) == (0.0, 0.0, 0.0)


def test_sinusoidal_disturbance_is_exact() -> None:
    """D = d0 sin(w t) from t = 0: v = (k d0/w) (cos(w t) - 1), at any substeps; the mean of each is exact."""
    for substeps in (1, 5):
        p = replace(RIGID, substeps=substeps, disturbance=DisturbanceParameters(amplitude=0.1, angular_frequency=900.0))
        plant = Plant(p, T)
        velocity = [plant.step(tick, 0.0)[1] for tick in range(1, 401)]
        expected = RIGID.gain * 0.1 / 900.0 * (np.cos(900.0 * T * np.arange(1, 401)) - 1.0)
        np.testing.assert_allclose(velocity, expected, atol=1e-11 * np.abs(expected).max())


def test_constant_disturbance_of_zero_frequency() -> None:
    plant = Plant(replace(RIGID, disturbance=DisturbanceParameters(amplitude=0.1, angular_frequency=0.0)), T)
    assert plant.step(1, 0.0) == (0.0, 0.0, 0.0)  # sin 0


def test_update_keeps_the_state() -> None:
    plant, twin = Plant(PlantParameters(), T), Plant(PlantParameters(), T)
    for tick in range(1, 50):
        plant.step(tick, 0.2)
        twin.step(tick, 0.2)
    before = plant.output()
    plant.update(PlantParameters())
    assert plant.output() == before
    assert plant.step(50, 0.2) == twin.step(50, 0.2)
    # Another gain changes the motion to come and not the one that was.
    changed = replace(PlantParameters(), gain=2.0e7, substeps=8)
    plant.update(changed)
    assert plant.output() == twin.output()
    assert plant.step(51, 0.2) != twin.step(51, 0.2)


def test_update_to_other_modes_and_another_friction_starts_those_anew() -> None:
    plant = Plant(PlantParameters(), T)
    for tick in range(1, 50):
        plant.step(tick, 0.1)
    state = record(plant.state, PLANT_STATE)
    position, velocity = state.position, state.velocity
    plant.update(replace(PlantParameters(), resonance=ResonanceParameters(form='none'), friction=RIGID.friction))
    assert plant.output() == (position, velocity, 0.0)


@pytest.mark.parametrize(
    ('model', 'level'),
    [('dahl', 'coulomb_level'), ('complete', 'coulomb_level'), ('tangential_stiffness', 'static_level')],
)
def test_a_lowered_level_holds_from_the_update_on(model: str, level: str) -> None:
    """The contact keeps its deflection, but none that the new level does not bear."""
    friction = FrictionParameters(model=model, viscous_coefficient=0.0, drag_coefficient=0.0, coulomb_level=0.13)
    friction = replace(friction, square_root_coefficient=0.0)
    plant = Plant(replace(RIGID, friction=friction), T)
    for tick in range(1, 60):
        plant.step(tick, 0.12)
    assert abs(plant.output()[2]) > 0.06
    position, velocity, _ = plant.output()
    lowered: dict[str, Any] = {level: 0.05}
    plant.update(replace(RIGID, friction=replace(friction, **lowered)))
    assert plant.output()[:2] == (position, velocity)
    assert abs(plant.output()[2]) == pytest.approx(0.05, rel=1e-12)
    for tick in range(60, 400):
        assert abs(plant.step(tick, 0.12)[2]) <= 0.05 * (1.0 + 1e-12)


def test_an_update_keeps_the_lugre_bristle_within_lemma_4_1() -> None:
    plant = Plant(replace(RIGID, friction=FrictionParameters()), T)
    for tick in range(1, 60):
        plant.step(tick, 0.15)
    changed = FrictionParameters(stiffness=0.1)
    assert record(plant.state, PLANT_STATE).deflection > changed.static_level / changed.stiffness
    plant.update(replace(RIGID, friction=changed))
    assert record(plant.state, PLANT_STATE).deflection == changed.static_level / changed.stiffness


def test_friction_at_the_pivot_does_not_see_the_resonances() -> None:
    """The friction is that of the rigid body, whatever the head does."""
    one, other = Plant(PlantParameters(), T), Plant(replace(PlantParameters(), resonance=RIGID.resonance), T)
    for tick in range(1, 200):
        control = 0.3 * math.sin(0.9 * tick)
        assert one.step(tick, control)[2] == other.step(tick, control)[2]


SCRIPT = """
import hashlib, struct, sys
from hdd_servo_ros.drive.plant import Plant
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.drive.plant import PlantParameters

for values in {values!r}:
    plant = Plant(from_mapping(PlantParameters, values), 1.0e-4)
    digest = hashlib.sha256(b"".join(array.tobytes() for array in plant.arrays))
    for tick in range(1, 60):
        digest.update(struct.pack('<3d', *plant.step(tick, 0.001 * ((tick * 7919) % 601 - 300), 0.002)))
    print(digest.hexdigest())
"""
NETWORK = {
    'friction.node_positions': (0.0, 2.0),
    'friction.node_velocities': (100.0, -900.0),
    'friction.node_weights': (0.1, -0.2),
}


def test_compiled_and_interpreted_steps_give_the_same_bits() -> None:
    """No operation is reordered, fused or taken from the system's mathematics library by the compiler."""
    cases = [{'friction.model': model, **NETWORK, 'disturbance.amplitude': 0.01} for model in MODELS]
    cases += [{'actuator.driver': 'current'}, {'actuator.driver': 'voltage', 'actuator.amplifier_gain': 1.0}]
    script = SCRIPT.format(values=cases)
    root = Path(__file__).parents[2]
    outputs = [
        subprocess.run(
            [sys.executable, '-c', script],
            env={**os.environ, 'NUMBA_DISABLE_JIT': disable, 'PYTHONPATH': str(root)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for disable in ('0', '1')
    ]
    assert len(outputs[0]) == len(cases)
    assert outputs[0] == outputs[1]
    assert len(set(outputs[0])) == len(cases)
    assert hashlib.sha256(b'').hexdigest() not in outputs[0]


def test_initial_driver_currents_are_zero() -> None:
    plant = Plant(replace(RIGID, actuator=ActuatorParameters(driver='current')), T)
    assert plant.output() == (0.0, 0.0, 0.0)
    # The current needs time: less velocity after a tick than an instant driver gives.
    instant = Plant(RIGID, T)
    assert 0.0 < plant.step(1, 1.0)[1] < instant.step(1, 1.0)[1]
