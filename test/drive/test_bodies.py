"""Every friction model on a moving body: closed forms, an independent solver, energy."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.curves import friction_curve
from hdd_servo_ros.drive.friction.dahl import dahl_slope
from hdd_servo_ros.drive.friction.parameters import FRICTION, MODELS, FrictionParameters, friction_constants
from hdd_servo_ros.drive.plant import PLANT_STATE, Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.compiled import jit
from hdd_servo_ros.numerics.records import record

Array = npt.NDArray[np.float64]
Run = Callable[..., Array]

T = 1.0e-4
GAIN = 4.0968e7
RIGID = ResonanceParameters(form='none')
NETWORK = FrictionParameters(
    model='rbf_network',
    node_positions=(0.0, 0.0, 10.0),
    node_velocities=(3000.0, -3000.0, 0.0),
    node_weights=(0.1, -0.1, 0.05),
    position_width=10.0,
    velocity_width=4000.0,
)


def plant(friction: FrictionParameters, **changes: Any) -> PlantParameters:
    return replace(PlantParameters(friction=friction, resonance=RIGID), **changes)


def test_coulomb_stops_and_holds(run: Run) -> None:
    """Closed form: v = v0 - k f_c t until it stops at v0^2/(2 k f_c), and there it stays."""
    p = plant(FrictionParameters(model='coulomb', coulomb_level=0.1), initial_velocity=5000.0)
    rows = run(p, T, np.zeros(40))
    stop = 5000.0**2 / (2.0 * GAIN * 0.1)
    time = T * np.arange(41)
    velocity = np.maximum(5000.0 - GAIN * 0.1 * time, 0.0)
    np.testing.assert_allclose(rows[:, 1], velocity, rtol=1e-12, atol=1e-9)
    assert rows[-1, 0] == pytest.approx(stop, rel=1e-12)
    assert rows[-1, 1] == 0.0
    assert rows[-1, 2] == 0.0  # nothing is applied: nothing is held


def test_coulomb_passes_through_a_reversal(run: Run) -> None:
    """Thrown against a force above f_c, the body stops and comes back, decelerated by u + f_c, then by u - f_c."""
    p = plant(FrictionParameters(model='coulomb', coulomb_level=0.1), initial_velocity=5000.0)
    rows = run(p, T, np.full(30, -0.3))
    turn = 5000.0 / (GAIN * 0.4)
    time = T * np.arange(31)
    back = np.maximum(time - turn, 0.0)
    velocity = np.where(time < turn, 5000.0 - GAIN * 0.4 * time, -GAIN * 0.2 * back)
    np.testing.assert_allclose(rows[:, 1], velocity, rtol=1e-12, atol=1e-8)


@pytest.mark.parametrize('model', ['stiction', 'gaussian', 'tustin', 'lorentzian', 'exponential'])
def test_stiction_holds_until_breakaway(model: str, run: Run) -> None:
    """(2.1): at rest F = u while |u| < f_s; a ramp breaks away within a tick of f_s."""
    p = FrictionParameters(model=model, coulomb_level=0.1, static_level=0.3)
    ramp = np.linspace(0.0, 0.6, 201)
    rows = run(plant(p), T, ramp)
    breakaway = int(np.argmax(ramp > 0.3))
    assert not rows[: breakaway + 1, 1].any()
    np.testing.assert_allclose(rows[1 : breakaway + 1, 2], ramp[:breakaway], rtol=0, atol=1e-15)
    assert np.all(rows[breakaway + 1 :, 1] > 0.0)


def test_dead_band_brings_the_body_to_rest(run: Run) -> None:
    """Karnopp: below the dead band the body is at rest, above it slides on."""
    friction = FrictionParameters(model='stiction', dead_band_velocity=10.0)
    slow = run(plant(friction, initial_velocity=9.0), T, np.zeros(2))
    fast = run(plant(friction, initial_velocity=11.0), T, np.zeros(2))
    assert slow[1, 1] == 0.0
    assert fast[2, 1] == 11.0  # stiction alone does not resist sliding


def test_spring_of_presliding(run: Run) -> None:
    """(2.2): below f_s an undamped spring: x = (u/f_t)(1 - cos w t), w^2 = k f_t."""
    p = FrictionParameters(model='tangential_stiffness', stiffness=0.02, static_level=1.0)
    rows = run(plant(p, substeps=16), T, np.full(100, 0.3))
    w = math.sqrt(GAIN * 0.02)
    reference = 0.3 / 0.02 * (1.0 - np.cos(w * T * np.arange(101)))
    np.testing.assert_allclose(rows[:, 0], reference, atol=1e-4 * 15.0)


def test_spring_slides_at_its_breakaway_level(run: Run) -> None:
    p = FrictionParameters(model='tangential_stiffness', stiffness=0.02, static_level=0.2)
    rows = run(plant(p), T, np.full(100, 0.5))
    np.testing.assert_allclose(rows[-10:, 2], 0.2, rtol=1e-12)
    np.testing.assert_allclose(np.diff(rows[-10:, 1]), GAIN * 0.3 * T, rtol=1e-9)


def reference_motion(parameters: PlantParameters, control: Array) -> Array:
    """Solve the body by scipy, restarted at each tick, with the friction's equations written here."""
    p = parameters.friction

    def rhs(_: float, y: Array, u: float) -> list[float]:
        x, v, f = y
        f_rate = 0.0
        if p.model == 'dahl':
            y_ = 1.0 - f / p.coulomb_level * math.copysign(1.0, v)
            f_rate = p.stiffness * abs(y_) ** p.dahl_exponent * math.copysign(1.0, y_) * v
            friction = f
        else:
            friction = float(friction_curve(p, v, x))
        return [v, parameters.gain * (u - friction), f_rate]

    y = np.array([parameters.initial_position, parameters.initial_velocity, 0.0])
    rows = [y]
    for u in control:
        y = solve_ivp(rhs, (0.0, T), y, method='DOP853', args=(u,), rtol=1e-9, atol=1e-9).y[:, -1]
        rows.append(y)
    return np.array(rows)


SLIDING = ['viscous', 'coulomb_viscous', 'drag', 'gaussian_two_breaks_offsets', 'tustin', 'square_root', 'lorentzian']


@pytest.mark.parametrize('model', SLIDING)
def test_sliding_in_one_direction_against_an_integrator(model: str, run: Run) -> None:
    control = 0.15 + 0.1 * np.sin(2.0 * np.pi * 300.0 * T * np.arange(60))
    errors = []
    for substeps in (4, 16):
        parameters = plant(FrictionParameters(model=model), initial_velocity=500.0, substeps=substeps)
        rows = run(parameters, T, control)
        reference = reference_motion(parameters, control)
        assert rows[:, 1].min() > 100.0
        errors.append(np.abs(rows[:, :2] - reference[:, :2]).max(axis=0) / np.abs(reference[:, :2]).max(axis=0))
    assert np.all(errors[0] < 2e-4)
    assert np.all((errors[0] > 8.0 * errors[1]) | (errors[0] < 1e-9))  # second order


@pytest.mark.parametrize('exponent', [0.5, 1.0, 2.0, 3.0])
def test_dahl_body_against_an_integrator(exponent: float, run: Run) -> None:
    control = 0.12 * np.sin(2.0 * np.pi * 80.0 * T * np.arange(150))
    friction = FrictionParameters(model='dahl', dahl_exponent=exponent)
    reference = reference_motion(plant(friction), control)
    errors = []
    counts = [4, 8, 16, 32]
    for substeps in counts:
        rows = run(plant(friction, substeps=substeps), T, control)
        errors.append(np.abs(rows[:, :2] - reference[:, :2]).max(axis=0) / np.abs(reference[:, :2]).max(axis=0))
        assert np.abs(rows[:, 2]).max() <= friction.coulomb_level
    assert np.all(errors[0] < 2e-3)
    # Reversals fall anywhere in a substep: the order is the slope over many.
    assert np.all(np.polyfit(np.log(counts), np.log(errors), 1)[0] < -1.5)


def test_dahl_of_exponent_one_is_lugre_without_its_damping(run: Run) -> None:
    """(2.18), (2.19) are (2.20)-(2.22) with f_s = f_c and sigma_1 = sigma_2 = 0."""
    control = 0.12 * np.sin(2.0 * np.pi * 80.0 * T * np.arange(300))
    p = FrictionParameters(model='dahl', coulomb_level=0.13, static_level=0.13)
    lugre = replace(p, model='lugre', bristle_damping=0.0, viscous_coefficient=0.0)
    a = run(plant(p, substeps=64), T, control)
    b = run(plant(lugre, substeps=64), T, control)
    np.testing.assert_allclose(a[:, 0], b[:, 0], atol=1e-5 * np.abs(b[:, 0]).max())


def test_network_body_against_an_integrator(run: Run) -> None:
    control = 0.12 * np.sin(2.0 * np.pi * 80.0 * T * np.arange(200))
    reference = reference_motion(plant(NETWORK), control)
    errors = []
    for substeps in (4, 16):
        rows = run(plant(NETWORK, substeps=substeps), T, control)
        errors.append(np.abs(rows[:, :2] - reference[:, :2]).max(axis=0) / np.abs(reference[:, :2]).max(axis=0))
    assert np.all(errors[0] < 3e-3)
    assert np.all(errors[0] > 8.0 * errors[1])


@pytest.mark.parametrize(
    ('driver', 'amplifier_gain', 'limits'), [('current', 0.05, [5e-5, 5e-5]), ('voltage', 1.0, [5e-5, 2e-4])]
)
def test_lugre_body_on_its_driver_against_radau(
    driver: str, amplifier_gain: float, limits: list[float], run: Run
) -> None:
    """(3.5)-(3.8), (3.14) and (4.1)-(4.4) together: a back-EMF that matters, amplifier, coil and bristle."""
    actuator = ActuatorParameters(driver=driver, amplifier_gain=amplifier_gain, source_resistance=40.0)
    p = FrictionParameters()
    a = actuator
    meter = a.units_per_meter
    control = 0.5 * np.sin(2.0 * np.pi * 80.0 * T * np.arange(100))

    def rhs(_: float, y: Array, u: float) -> list[float]:
        _, speed, z, output, current = y
        v = speed * a.arm_length * meter
        g = p.coulomb_level + (p.static_level - p.coulomb_level) * math.exp(-((v / p.stribeck_velocity) ** 2))
        z_rate = v - p.stiffness * abs(v) / g * z
        h = p.stiffness * z + p.bristle_damping * z_rate + p.viscous_coefficient * v
        # h is in volts of the control: a torque of k_t k_a h, over R_m on a voltage driver.
        volt = a.torque_constant * a.amplifier_gain / (a.coil_resistance if driver == 'voltage' else 1.0)
        acceleration = (a.torque_constant * current - volt * h) / a.inertia
        output_rate = (a.amplifier_gain * u - output) / a.amplifier_time_constant
        drop = a.coil_resistance * current + a.back_emf_constant * speed
        source = output if driver == 'voltage' else (output - current) * a.source_resistance
        return [speed, acceleration, z_rate, output_rate, (source - drop) / a.coil_inductance]

    y = np.zeros(5)
    rows = [y]
    for u in control:
        atol = [1e-13, 1e-11, 1e-10, 1e-11, 1e-11]
        y = solve_ivp(rhs, (0.0, T), y, method='Radau', args=(u,), rtol=1e-9, atol=atol).y[:, -1]
        rows.append(y)
    reference = np.array(rows)[:, [0, 1, 2]] * [a.arm_length * meter, a.arm_length * meter, 1.0]
    peaks = np.abs(reference).max(axis=0)
    assert peaks[2] > 5.0  # it slides
    counts = [4, 8, 16, 32]
    errors = []
    for substeps in counts:
        parameters = replace(plant(p, substeps=substeps), actuator=actuator)
        errors.append(np.abs(run(parameters, T, control)[:, [3, 4, 7]] - reference).max(axis=0) / peaks)
    assert np.all(errors[0][:2] < limits)
    assert np.all(np.polyfit(np.log(counts), np.log(errors), 1)[0] < -1.7)


@pytest.mark.parametrize('model', [model for model in MODELS if model not in ('rbf_network', 'lugre_position')])
@given(control=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=30))
def test_mirrored_control_gives_the_mirrored_motion(model: str, control: list[float]) -> None:
    parameters = PlantParameters(friction=FrictionParameters(model=model))
    one, other = Plant(parameters, T), Plant(parameters, T)
    for tick, u in enumerate(control, start=1):
        assert other.step(tick, -u) == tuple(-value for value in one.step(tick, u))


@pytest.mark.parametrize('model', MODELS)
def test_mean_friction_is_the_impulse_of_the_substep(model: str, run: Run) -> None:
    """V1 - v0 = k D (u - mean friction), whatever the scheme."""
    friction = NETWORK if model == 'rbf_network' else FrictionParameters(model=model)
    control = 0.4 * np.sin(2.0 * np.pi * 90.0 * T * np.arange(200))
    rows = run(plant(friction, substeps=1), T, control)
    np.testing.assert_allclose(control - np.diff(rows[:, 4]) / (GAIN * T), rows[1:, 8], atol=1e-12)


def test_complete_model_slides_by_2_13(run: Run) -> None:
    """With the contact stretched to its level, the body obeys (2.13) by itself."""
    # Stiff, so that the level never rises faster than the contact is stretched.
    friction = FrictionParameters(model='complete', square_root_coefficient=5.0e-4, stiffness=1.0)
    level = 0.13 + 5.0e-4 * math.sqrt(500.0)
    control = 0.25 + 0.1 * np.sin(2.0 * np.pi * 300.0 * T * np.arange(60))
    errors = []
    for substeps in (4, 16):
        parameters = plant(friction, initial_velocity=500.0, substeps=substeps)
        rows = run(parameters, T, control, {'deflection': level / friction.stiffness})
        reference = reference_motion(parameters, control)
        errors.append(np.abs(rows[:, :2] - reference[:, :2]).max(axis=0) / np.abs(reference[:, :2]).max(axis=0))
    assert np.all(errors[0] < 1e-3)
    assert np.all(errors[0] > 3.5 * errors[1])


@jit
def fill_elastoplastic(
    control: Array,
    steps: int,
    stiffness: float,
    level: float,
    root: float,
    viscous: float,
    drag: float,
    result: Array,
) -> None:
    """(2.13) and its contact as printed, with many small symplectic Euler steps and the contact limited to slip."""
    x = v = z = 0.0
    step = T / steps
    for tick in range(control.size):
        for _ in range(steps):
            before = v
            v += step * GAIN * (control[tick] - stiffness * z - viscous * v - drag * v * abs(v))
            x += step * v
            # Where the velocity passes zero, the level has been down to that of v = 0.
            limit = (level + root * math.sqrt(abs(v) if v * before > 0.0 else 0.0)) / stiffness
            z = min(max(z + step * v, -limit), limit)
        result[tick + 1, 0] = x
        result[tick + 1, 1] = v


def richardson(control: Array, steps: int, *parameters: float) -> Array:
    coarse, fine = np.zeros((2, control.size + 1, 2))
    fill_elastoplastic(control, steps, *parameters, coarse)
    fill_elastoplastic(control, 2 * steps, *parameters, fine)
    return 2.0 * fine - coarse


@pytest.mark.parametrize(
    ('model', 'root', 'drag'), [('tangential_stiffness', 0.0, 0.0), ('complete', 0.0, 1e-9), ('complete', 1e-4, 1e-9)]
)
def test_elastoplastic_body_through_reversals_and_the_order_of_the_step(
    model: str, root: float, drag: float, run: Run
) -> None:
    control = 0.3 * np.sin(2.0 * np.pi * 70.0 * T * np.arange(600))
    friction = FrictionParameters(model=model, square_root_coefficient=root, drag_coefficient=drag)
    viscous = friction.viscous_coefficient if model == 'complete' else 0.0
    level = friction.coulomb_level if model == 'complete' else friction.static_level
    reference = richardson(control, 4000, friction.stiffness, level, root, viscous, drag)
    peaks = np.abs(reference).max(axis=0)
    assert np.count_nonzero(np.diff(np.sign(reference[1:, 1]))) >= 8
    counts = [1, 2, 4, 8, 16]
    errors = []
    for substeps in counts:
        rows = run(plant(friction, substeps=substeps), T, control)
        errors.append(np.abs(rows[:, :2] - reference).max(axis=0) / peaks)
    # Measured at the default four: up to 1.2e-4.
    assert np.all(errors[2] < 2e-4)
    assert np.all(np.polyfit(np.log(counts), np.log(errors), 1)[0] < -1.4)


def energy(parameters: PlantParameters, state: Array) -> float:
    """Return kinetic energy and stored energy of the contact [V um]."""
    s = record(state, PLANT_STATE)
    stored = 0.0
    if parameters.friction.model in ('lugre', 'lugre_position', 'tangential_stiffness', 'complete', 'dahl'):
        stored = 0.5 * parameters.friction.stiffness * s.deflection**2
    return float(0.5 * s.velocity**2 / parameters.gain + stored)


@pytest.mark.parametrize('model', [model for model in MODELS if model not in ('none', 'rbf_network')])
@given(
    velocity=st.floats(-5.0e4, 5.0e4),
    deflection=st.floats(-1.0, 1.0),
    coulomb=st.floats(0.02, 1.0),
    ratio=st.floats(1.0, 2.0),
    viscous=st.floats(0.0, 1.0e-4),
    damping=st.one_of(st.just(0.0), st.floats(-8.0, -0.7).map(lambda exponent: 10.0**exponent)),
    frequency=st.floats(30.0, 8000.0),
    exponent=st.floats(0.0, 4.0),
    substeps=st.sampled_from([1, 4]),
)
def test_energy_never_increases_without_input(
    model: str,
    velocity: float,
    deflection: float,
    coulomb: float,
    ratio: float,
    viscous: float,
    damping: float,
    frequency: float,
    exponent: float,
    substeps: int,
) -> None:
    """
    Kinetic and stored energy, for contact modes up to 8 kHz: 1.3 rad a substep at the default four, 5 rad with one.

    The bristle's damping is up to some hundred times the critical one of that mode. lugre_position at its default
    ripple of 0.1, and where sigma_1 |v| is at most f_c: see the test below for deep ripples, and
    docs/friction/lugre.md.
    """
    if model == 'lugre_position' and velocity != 0.0:
        damping = min(damping, coulomb / abs(velocity))
    stiffness = (2.0 * math.pi * frequency) ** 2 / GAIN
    friction = FrictionParameters(
        model=model,
        stiffness=stiffness,
        coulomb_level=coulomb,
        static_level=coulomb * ratio,
        viscous_coefficient=viscous,
        bristle_damping=damping,
        dahl_exponent=exponent,
        square_root_coefficient=-2.0 * math.sqrt(coulomb * viscous),
    )
    parameters = plant(friction, substeps=substeps)
    body = Plant(parameters, T)
    state = record(body.state, PLANT_STATE)
    state.velocity = velocity
    # Beyond f_c/sigma_0 a bristle with constant sigma_1 is not passive (Barabanov and Ortega, IEEE TAC 45, 2000).
    state.deflection = deflection * coulomb / stiffness * (1.0 - friction.position_ripple)
    before = first = energy(parameters, body.state)
    rounding = 1.0e-14 * coulomb * coulomb / stiffness
    for tick in range(1, 120):
        body.step(tick, 0.0)
        after = energy(parameters, body.state)
        assert after <= before + 1.0e-9 * first + rounding
        before = after


@pytest.mark.parametrize(
    ('substeps', 'frequency', 'damping', 'coulomb', 'ratio', 'velocity', 'deflection'),
    [
        (1, 458.1, 0.01599, 0.09233, 1.468, 2785.2, -0.8824),
        (1, 4763.6, 0.1690, 0.2041, 1.0, -235.1, 0.8934),
        (4, 707.8, 0.02985, 0.3173, 1.0, -2426.9, 0.9749),
        (4, 2762.1, 0.1545, 0.8720, 1.905, -1181.2, 0.8418),
    ],
)
def test_a_contact_damped_far_beyond_critical_gives_back_no_more_than_it_holds(
    substeps: int, frequency: float, damping: float, coulomb: float, ratio: float, velocity: float, deflection: float
) -> None:
    """With a rate predicted from the friction before, the energy grew by 22 to 34 times its first value in a sample."""
    stiffness = (2.0 * math.pi * frequency) ** 2 / GAIN
    friction = FrictionParameters(
        stiffness=stiffness,
        bristle_damping=damping,
        coulomb_level=coulomb,
        static_level=coulomb * ratio,
        viscous_coefficient=0.0,
    )
    parameters = plant(friction, substeps=substeps)
    body = Plant(parameters, T)
    state = record(body.state, PLANT_STATE)
    state.velocity, state.deflection = velocity, deflection * coulomb / stiffness
    energies = [energy(parameters, body.state)]
    for tick in range(1, 60):
        body.step(tick, 0.0)
        energies.append(energy(parameters, body.state))
    assert np.diff(energies).max() <= 1e-12 * energies[0]
    assert energies[-1] < 0.999 * energies[0]


@pytest.mark.parametrize('critical', [20.0, 100.0])
def test_a_contact_damped_far_beyond_critical_against_an_implicit_solver(critical: float, run: Run) -> None:
    friction = FrictionParameters(bristle_damping=critical * 2.0 * math.sqrt(FrictionParameters().stiffness / GAIN))
    control = 0.3 * np.sin(2.0 * np.pi * 70.0 * T * np.arange(150))

    def rhs(_: float, y: Array, u: float) -> list[float]:
        _, v, z = y
        level = 0.13 + (0.16 - 0.13) * math.exp(-((v / 300.0) ** 2))
        rate = v - friction.stiffness * abs(v) / level * z
        h = friction.stiffness * z + friction.bristle_damping * rate + friction.viscous_coefficient * v
        return [v, GAIN * (u - h), rate]

    states = [np.zeros(3)]
    for u in control:
        solved = solve_ivp(rhs, (0.0, T), states[-1], method='Radau', args=(u,), rtol=1e-8, atol=1e-10)
        states.append(solved.y[:, -1])
    position = np.array(states)[:, 0]
    rows = run(plant(friction), T, control)
    # Measured: 5e-6 and 3e-6; 4e-4 with a predicted rate.
    assert np.abs(rows[:, 0] - position).max() < 2e-5 * np.abs(position).max()


def test_deep_ripple_is_not_passive_and_the_step_follows_the_model() -> None:
    """
    A bristle that is shortened by a falling alpha(x, v) gives energy back: lugre_position itself, not its step.

    With a ripple of 0.5 and f_s/f_c = 1.9 the energy rises in the continuous model, by as much as in the step.
    """
    p = FrictionParameters(
        model='lugre_position',
        bristle_damping=4.4388809119848354e-05,
        static_level=0.24983865863375743,
        viscous_coefficient=0.0,
        position_ripple=0.5,
    )
    start = [0.0, 23803.28715917871, 2.9678715850891315]

    def rhs(_: float, y: Array) -> list[float]:
        x, v, z = y
        g = p.coulomb_level + (p.static_level - p.coulomb_level) * math.exp(-((v / p.stribeck_velocity) ** 2))
        g *= 1.0 + p.position_ripple * math.sin(2.0 * math.pi * x / p.position_period)
        rate = v - p.stiffness * abs(v) / g * z
        return [v, -GAIN * (p.stiffness * z + p.bristle_damping * rate), rate]

    time = T * np.arange(201)
    solution = solve_ivp(rhs, (0.0, time[-1]), start, method='Radau', t_eval=time, rtol=1e-9, atol=1e-11)
    reference = 0.5 * solution.y[1] ** 2 / GAIN + 0.5 * p.stiffness * solution.y[2] ** 2
    parameters = plant(p, substeps=16)
    body = Plant(parameters, T)
    state = record(body.state, PLANT_STATE)
    state.velocity, state.deflection = start[1:]
    energies = [energy(parameters, body.state)]
    for tick in range(1, 201):
        body.step(tick, 0.0)
        energies.append(energy(parameters, body.state))
    rise = np.diff(reference).max() / reference[0]
    assert rise > 0.05
    assert np.diff(energies).max() / energies[0] == pytest.approx(rise, rel=0.05)


def test_dahl_slope_at_the_limit_is_zero() -> None:
    friction = FrictionParameters(model='dahl', stiffness=0.02, coulomb_level=0.13, dahl_exponent=1.0)
    assert dahl_slope(record(friction_constants(friction), FRICTION), 0.13, 1.0) == 0.0


@pytest.mark.parametrize('model', MODELS)
def test_initial_state(model: str) -> None:
    friction = NETWORK if model == 'rbf_network' else FrictionParameters(model=model)
    body = Plant(PlantParameters(friction=friction, initial_position=4.0, initial_velocity=100.0), T)
    state = record(body.state, PLANT_STATE)
    assert state.position == 4.0
    assert state.velocity == 100.0
    assert math.isfinite(body.output()[2])
