"""Plans of final-state control, against the drive that they are made for."""

import dataclasses
import itertools

import numpy as np
import pytest

from hdd_servo_ros.analysis.seek_plans import SHORTEST, model_drive, plan_lengths, seek_plans
from hdd_servo_ros.control.seek_parameters import SeekModelParameters, SeekParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters

T = 1e-4
PARAMETERS = SeekParameters(method='final_state')


def frictionless(factor=1.0):
    """Return the default drive without friction, its modes' frequencies times a factor."""
    default = PlantParameters()
    powers = np.array([1.0, factor, factor**2])
    resonance = ResonanceParameters(
        numerators=tuple((np.reshape(default.resonance.numerators, (-1, 3)) * powers).ravel().tolist()),
        denominators=tuple((np.reshape(default.resonance.denominators, (-1, 3)) * powers).ravel().tolist()),
    )
    friction = dataclasses.replace(default.friction, model='none')
    return dataclasses.replace(default, friction=friction, resonance=resonance)


def positions(drive, plan, length, sample_time, tail):
    plant = Plant(drive, sample_time)
    voltages = np.concatenate([length * plan, np.zeros(tail)])
    return np.array([plant.step(tick + 1, u)[0] for tick, u in enumerate(voltages)])[len(plan) - 1 :]


def without_viscous_friction(**other):
    model = SeekModelParameters(viscous_coefficient=0.0, **other)
    return dataclasses.replace(PARAMETERS, model=model)


@pytest.mark.parametrize('sample_time', [1e-4, 3.7879e-5])
def test_a_plan_brings_the_drive_to_rest_on_the_target(sample_time):
    found = seek_plans(without_viscous_friction(), sample_time)
    for row in (0, 4, 12, len(found.plans) - 1):
        samples, vibration = int(found.durations[row, 0]), found.durations[row, 1]
        plan = found.plans[row, :samples]
        length = 9.0 / np.abs(plan).max()
        head = positions(frictionless(), plan, length, sample_time, found.vibration_samples)
        # The largest vibration afterward is what the plan says, and it decays to nothing.
        assert np.abs(head[: found.vibration_samples] - length).max() == pytest.approx(vibration * length, abs=2e-4)
        later = positions(frictionless(), plan, length, sample_time, 40 * found.vibration_samples)
        assert abs(later[-1] - length) < 2e-4 + 1e-6 * length
    assert np.all(np.diff(found.durations[:, 0]) > 0)


def test_long_plans_leave_less_vibration_and_take_less_voltage():
    found = seek_plans(PARAMETERS, T)
    samples, vibration = found.durations.T
    assert samples[0] == SHORTEST
    assert vibration[0] > 100.0 * vibration[samples == 12][0]
    peaks = np.abs(found.plans).max(axis=1)
    assert np.all(np.diff(peaks) < 0.0)
    # As a minimum-jerk move: 5.77/(a T^2), and not more than a fifth above it once there is time for the modes.
    long = samples >= 20
    assert np.all(peaks[long] < 1.2 * 5.7735 / (4.0968e7 * (samples[long] * T) ** 2))


def test_it_also_calms_drives_with_other_modes():
    spread = seek_plans(without_viscous_friction(), T)
    nominal = seek_plans(without_viscous_friction(mode_spread=0.0), T)
    row = 7  # ten samples
    for factor in (0.95, 1.05):
        left = []
        for plans in (spread, nominal):
            plan = plans.plans[row, :10]
            length = 9.0 / np.abs(plan).max()
            left.append(np.abs(positions(frictionless(factor), plan, length, T, 12) / length - 1.0).max())
        assert left[0] < left[1]


def test_the_model_is_the_drive_in_sliding():
    drive = model_drive(SeekModelParameters(), T)
    plant = Plant(dataclasses.replace(frictionless()), T)
    model = model_drive(SeekModelParameters(viscous_coefficient=0.0), T)
    state = np.zeros(len(model.a))
    for tick, u in enumerate(np.random.default_rng(1).normal(size=30)):
        state = model.a @ state + model.b[:, 0] * u
        assert model.c @ state == pytest.approx(plant.step(tick + 1, u)[:2], rel=1e-6, abs=1e-6)
    assert drive.a.shape == model.a.shape


def test_a_drive_of_the_rigid_body_alone_has_plans():
    found = seek_plans(without_viscous_friction(numerators=(), denominators=()), T)
    assert found.plans.shape[1] == 64
    assert found.durations[:, 1].max() < 1e-9
    # The smoothest plan of a free body is antisymmetric.
    plan = found.plans[5, : int(found.durations[5, 0])]
    assert plan == pytest.approx(-plan[::-1], abs=1e-9)


def test_plans_grow_by_a_sixteenth():
    lengths = plan_lengths(200)
    assert lengths[:3] == [3, 4, 5]
    assert lengths[-1] == 200
    assert all(b - a <= max(1, a // 16) for a, b in itertools.pairwise(lengths))
    assert plan_lengths(5) == [3, 4, 5]
