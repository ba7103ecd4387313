"""Crash stops: closed forms of a bouncing body, SciPy's event solver, and properties of all friction models."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.drive.friction.parameters import MODELS
from hdd_servo_ros.drive.plant import PLANT_STATE, Plant, PlantParameters
from hdd_servo_ros.drive.resonance import modal_form
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError, from_mapping

Array = npt.NDArray[np.float64]

T = 1e-4
RIGID: dict[str, Any] = {'friction__model': 'none', 'resonance__form': 'none'}


def drive(lower: float = -5.0, upper: float = 5.0, restitution: float = 0.4, **values: Any) -> PlantParameters:
    named = {name.replace('__', '.'): value for name, value in values.items()}
    stops = {'travel.lower': lower, 'travel.upper': upper, 'travel.restitution': restitution}
    return from_mapping(PlantParameters, {**stops, **named})


def rigid(**values: Any) -> PlantParameters:
    return drive(**RIGID, **values)


def motion(parameters: PlantParameters, control: Any) -> tuple[Array, Array, Plant]:
    """Return position and velocity of the rigid body, and of the head, by tick, and the plant."""
    plant = Plant(parameters, T)
    state = record(plant.state, PLANT_STATE)
    body, head = [(state.position, state.velocity)], [plant.output()[:2]]
    for tick, u in enumerate(np.asarray(control, dtype=np.float64).tolist(), start=1):
        head.append(plant.step(tick, u)[:2])
        body.append((state.position, state.velocity))
    return np.array(body), np.array(head), plant


def ballistic(
    acceleration: float, start: float, velocity: float, stop: float, restitution: float, time: npt.NDArray[Any]
) -> tuple[Array, Array, list[tuple[float, float]]]:
    """Return position and velocity under a constant acceleration toward a stop, and the impacts: time and speed."""
    begun, x, v = 0.0, start, velocity
    impacts: list[tuple[float, float]] = []
    parts = []
    while begun <= time[-1] and len(impacts) < 50:
        # x + v t + a t^2/2 = stop, the later of both instants.
        flight = (-v + math.sqrt(max(v * v + 2.0 * acceleration * (stop - x), 0.0))) / acceleration
        parts.append((begun, x, v))
        if flight < 1e-9:
            parts.append((begun, stop, math.nan))
            break
        begun += flight
        speed = v + acceleration * flight
        impacts.append((begun, speed))
        x, v = stop, -restitution * speed
    found = np.array([next(part for part in reversed(parts) if part[0] <= t) for t in time])
    after = time - found[:, 0]
    rows = found[:, 1] + found[:, 2] * after + 0.5 * acceleration * after**2
    speeds = found[:, 2] + acceleration * after
    rests = np.isnan(found[:, 2])
    return np.where(rests, stop, rows), np.where(rests, 0.0, speeds), impacts


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('substeps', [1, 4, 7])
@pytest.mark.parametrize('restitution', [0.3, 0.7, 1.0])
def test_a_bouncing_body_against_its_closed_form(sign: float, substeps: int, restitution: float) -> None:
    u = 0.05
    acceleration = 4.0968e7 * u
    parameters = rigid(
        lower=-3.0, upper=3.0, restitution=restitution, substeps=substeps, initial_velocity=sign * -1000.0
    )
    count = 120
    body, head, plant = motion(parameters, np.full(count, sign * u))
    x, v, impacts = ballistic(acceleration, 0.0, -1000.0, 3.0, restitution, T * np.arange(count + 1))
    # Up to the first bounce that is over within a substep: from there on the body rests.
    flights = np.diff([time for time, _ in impacts])
    short = np.flatnonzero(flights < 1.5 * T / substeps)
    end = int(impacts[short[0]][0] / T) if len(short) else count
    assert end > 35
    np.testing.assert_allclose(sign * body[:end, 0], x[:end], atol=1e-10)
    np.testing.assert_allclose(sign * body[:end, 1], v[:end], atol=1e-4)
    np.testing.assert_array_equal(head, body)
    (name,) = plant.impacts
    found = plant.impacts[name]
    assert name == ('upper' if sign > 0.0 else 'lower')
    assert found.largest_speed == pytest.approx(max(speed for _, speed in impacts), rel=1e-9)
    assert found.first_tick == math.ceil(impacts[0][0] / T)
    if not len(short):
        assert found.count == sum(time < count * T for time, _ in impacts)


def test_between_two_stops_without_loss() -> None:
    """A triangle wave: 6 µm at 4000 µm/s takes 15 ticks."""
    body, _, plant = motion(rigid(lower=-3.0, upper=3.0, restitution=1.0, initial_velocity=4000.0), np.zeros(300))
    ticks = np.arange(301)
    phase = (ticks * 0.4 + 3.0) % 12.0
    np.testing.assert_allclose(body[:, 0], np.minimum(phase, 12.0 - phase) - 3.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(body[:, 1]), 4000.0, rtol=1e-12)
    assert {name: found.count for name, found in plant.impacts.items()} == {'upper': 10, 'lower': 10}


def test_without_restitution_it_stays_and_leaves_when_it_is_pulled() -> None:
    u = np.array([0.5] * 40 + [-0.2] * 10)
    body, _, plant = motion(rigid(restitution=0.0), u)
    landed = math.ceil(math.sqrt(2.0 * 5.0 / (0.5 * 4.0968e7)) / T)
    np.testing.assert_array_equal(body[landed:41], np.tile([5.0, 0.0], (41 - landed, 1)))
    after = T * np.arange(11)
    np.testing.assert_allclose(body[40:, 0], 5.0 - 0.5 * 0.2 * 4.0968e7 * after**2, rtol=1e-12)
    assert plant.impacts['upper'].count == 1


def test_a_turn_beyond_the_stop_within_a_substep_is_seen() -> None:
    """The body would turn 4 nm beyond the stop, and be back before the end of the substep."""
    a = 4.0968e7 * 1.0
    beyond, before = 0.004, 0.07
    velocity = math.sqrt(2.0 * a * (before + beyond))
    turn = velocity / a
    assert turn < T < 2.0 * turn
    contact = turn - math.sqrt(2.0 * beyond / a)
    arriving = velocity - a * contact
    parameters = rigid(substeps=1, upper=5.0, restitution=0.5, initial_position=5.0 - before, initial_velocity=velocity)
    body, _, plant = motion(parameters, [-1.0])
    left = T - contact
    assert plant.impacts['upper'].largest_speed == pytest.approx(arriving, rel=1e-9)
    assert body[1, 0] == pytest.approx(5.0 - 0.5 * arriving * left - 0.5 * a * left**2, abs=1e-10)
    assert body[1, 1] == pytest.approx(-0.5 * arriving - a * left, rel=1e-9)


def test_a_velocity_step_excites_the_modes() -> None:
    """Rigid body and modes by SciPy's event solver; the step is exact where the body's acceleration is constant."""
    parameters = drive(lower=-2.0, upper=2.0, restitution=0.8, friction__model='none')
    u, count = 0.3, 35
    acceleration = parameters.gain * u
    modal = modal_form(parameters.resonance)
    modes = len(modal.modes)

    def rate(t: float, y: Array) -> Array:
        q, dq = y[2 : 2 + modes], y[2 + modes :]
        swing = [acceleration - mode.a1 * dq[i] - mode.a0 * q[i] for i, mode in enumerate(modal.modes)]
        return np.array([y[1], acceleration, *dq, *swing])

    def hit(t: float, y: Array) -> float:
        return float(y[0] - 2.0)

    hit.terminal, hit.direction = True, 1.0  # type: ignore[attr-defined]
    times = T * np.arange(count + 1)
    begun, y = 0.0, np.zeros(2 + 2 * modes)
    rows = np.zeros((count + 1, len(y)))
    impacts = 0
    while begun < times[-1]:
        solution = solve_ivp(
            rate, (begun, times[-1]), y, method='DOP853', rtol=1e-12, atol=1e-12, events=hit, dense_output=True
        )
        inside = (times >= begun) & (times <= solution.t[-1])
        if inside.any():
            rows[inside] = solution.sol(times[inside]).T
        begun, y = solution.t[-1], solution.y[:, -1].copy()
        if solution.status == 1:
            jump = -1.8 * y[1]
            y[1] += jump
            y[2 + modes :] += jump
            y[0] = 2.0 - 1e-13
            impacts += 1
    position = modal.r0 * rows[:, 0] + modal.r1 * rows[:, 1]
    for i, mode in enumerate(modal.modes):
        position += mode.gamma * rows[:, 2 + i] + mode.beta * rows[:, 2 + modes + i]
    body, head, plant = motion(parameters, np.full(count, u))
    assert plant.impacts['upper'].count == impacts >= 4
    np.testing.assert_allclose(body[:, 0], rows[:, 0], atol=1e-10)
    np.testing.assert_allclose(head[:, 0], position, atol=1e-10)
    assert head[:, 0].max() > 2.01  # the head swings beyond, the body does not


def lugre_run(parameters: PlantParameters, u: float, count: int) -> tuple[Array, list[float]]:
    """Return position, velocity and bristle by tick from SciPy's event solver, and the speeds of impact."""
    f, travel = parameters.friction, parameters.travel

    def rate(t: float, y: Array) -> list[float]:
        _, v, z = y
        level = f.coulomb_level + (f.static_level - f.coulomb_level) * math.exp(-((v / f.stribeck_velocity) ** 2))
        dz = v - f.stiffness * abs(v) / level * z
        friction = f.stiffness * z + f.bristle_damping * dz + f.viscous_coefficient * v
        return [v, parameters.gain * (u - friction), dz]

    def hit(t: float, y: Array) -> float:
        return float(y[0] - travel.upper)

    hit.terminal, hit.direction = True, 1.0  # type: ignore[attr-defined]
    times = T * np.arange(count + 1)
    begun, y, speeds = 0.0, np.zeros(3), []
    rows = np.zeros((count + 1, 3))
    while begun < times[-1]:
        solution = solve_ivp(
            rate, (begun, times[-1]), y, method='Radau', rtol=1e-9, atol=1e-11, events=hit, dense_output=True
        )
        inside = (times >= begun) & (times <= solution.t[-1])
        if inside.any():
            rows[inside] = solution.sol(times[inside]).T
        begun, y = solution.t[-1], solution.y[:, -1].copy()
        if solution.status == 1:
            speeds.append(float(y[1]))
            y[:2] = travel.upper - 1e-12, -travel.restitution * y[1]
    return rows, speeds


def test_with_lugre_friction_against_an_event_solver_and_of_second_order() -> None:
    """The bristle keeps its deflection through the impact, and the friction then turns round."""
    errors = []
    for substeps in (4, 16):
        parameters = drive(upper=5.0, restitution=0.8, resonance__form='none', substeps=substeps)
        rows, speeds = lugre_run(parameters, 0.4, 30)
        body, _, plant = motion(parameters, np.full(30, 0.4))
        assert plant.impacts['upper'].count == len(speeds) >= 3
        assert plant.impacts['upper'].largest_speed == pytest.approx(max(speeds), rel=1e-3)
        errors.append(np.abs(body[:, 0] - rows[:, 0]).max())
    # Measured: 1.3e-3 and 7.9e-5, a factor of 16.
    assert errors[0] < 2e-3
    assert errors[1] < errors[0] / 12.0


NETWORK = {
    'friction__node_positions': (-2.0, 0.0, 2.0),
    'friction__node_velocities': (-1e4, 0.0, 1e4),
    'friction__node_weights': (-0.1, 0.0, 0.1),
}


@pytest.mark.parametrize('model', MODELS)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_the_body_is_never_beyond_a_stop(model: str, data: st.DataObject) -> None:
    upper = data.draw(st.floats(0.01, 20.0))
    lower = -data.draw(st.floats(0.01, 20.0))
    control = data.draw(st.lists(st.floats(-10.0, 10.0), min_size=5, max_size=40))
    parameters = drive(
        lower=lower,
        upper=upper,
        restitution=data.draw(st.floats(0.0, 1.0)),
        friction__model=model,
        substeps=data.draw(st.integers(1, 6)),
        initial_velocity=data.draw(st.floats(-1e5, 1e5)),
        resonance__form=data.draw(st.sampled_from(['none', 'sections'])),
        actuator__driver=data.draw(st.sampled_from(['reduced', 'current', 'voltage'])),
        **(NETWORK if model == 'rbf_network' else {}),
    )
    body, head, _ = motion(parameters, control)
    assert np.isfinite(head).all()
    assert lower <= body[:, 0].min()
    assert body[:, 0].max() <= upper
    # A stop gives nothing back beyond the restitution: no speed exceeds what the force could have given it.
    gained = parameters.rigid_gain * 10.0 * T * len(control)
    assert np.abs(body[:, 1]).max() <= abs(parameters.initial_velocity) + gained * (1.0 + 1e-9)


@pytest.mark.parametrize('model', ['lugre', 'none', 'coulomb_viscous', 'dahl', 'complete'])
def test_stops_out_of_reach_leave_every_bit(model: str) -> None:
    control = np.random.default_rng(1).normal(0.0, 1.0, 500)
    free = from_mapping(PlantParameters, {'friction.model': model})
    far = drive(lower=-1e9, upper=1e9, friction__model=model)
    _, expected, _ = motion(free, control)
    _, found, plant = motion(far, control)
    np.testing.assert_array_equal(found, expected)
    assert plant.impacts == {}
    assert plant.impact_warnings() == {}


def test_pressed_on_a_stop_the_contact_keeps_its_deflection() -> None:
    parameters = drive(resonance__form='none', restitution=0.0)
    plant = Plant(parameters, T)
    state = record(plant.state, PLANT_STATE)
    deflections = []
    for tick in range(1, 101):
        plant.step(tick, 0.5)
        deflections.append(float(state.deflection))
    assert state.position == 5.0
    assert deflections[50] == deflections[-1] > 0.0
    assert state.friction == pytest.approx(parameters.friction.stiffness * deflections[-1])


def test_static_friction_on_a_stop_balances_the_force_up_to_its_limit() -> None:
    values: dict[str, Any] = {'friction__model': 'coulomb', 'friction__coulomb_level': 0.1, 'resonance__form': 'none'}
    plant = Plant(drive(restitution=0.0, **values), T)
    for tick in range(1, 101):
        plant.step(tick, 0.5)
    assert record(plant.state, PLANT_STATE).friction == 0.1
    for tick in range(101, 111):
        plant.step(tick, -0.05)  # too little to leave
    assert plant.output() == (5.0, 0.0, -0.05)


def test_the_first_impact_gives_a_warning() -> None:
    _, _, plant = motion(rigid(), np.full(60, 0.5))
    (warning,) = plant.impact_warnings().values()
    first = plant.impacts['upper'].first_tick
    assert warning.startswith(f'the actuator hits the upper crash stop at 5 um by tick {first};')
    plant.update(rigid(restitution=0.1))
    assert plant.impacts['upper'].first_tick == first


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('travel.lower', {'travel.lower': 5.0, 'travel.upper': 1.0}),
        ('travel.lower', {'travel.lower': 5.0, 'travel.upper': 5.0}),
        ('travel.lower', {'travel.lower': 5.0}),
        ('travel.restitution', {'travel.restitution': 1.1}),
        ('travel.restitution', {'travel.restitution': -0.1}),
        ('initial_position', {'travel.upper': 5.0, 'initial_position': 6.0}),
    ],
)
def test_invalid_parameters_are_rejected(name: str, values: dict[str, object]) -> None:
    with pytest.raises(ParameterError) as rejected:
        from_mapping(PlantParameters, values)
    assert rejected.value.name == name


def test_one_limit_may_be_zero() -> None:
    body, _, plant = motion(rigid(lower=0.0, upper=100.0, restitution=0.5, initial_position=1.0), np.full(15, -0.05))
    assert plant.impacts['lower'].count == 1
    assert body[:, 0].min() >= 0.0
