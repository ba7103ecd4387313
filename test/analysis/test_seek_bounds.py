"""Bounds of a seek against closed forms, an integrator of differential equations, another model and weak duality."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from hdd_servo_ros.analysis.seek_bounds import PARTS, WATCHED, fastest_seek, scaled_modes, time_optimal_seek
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters

DRIVE = PlantParameters()
FREE = dataclasses.replace(DRIVE, friction=FrictionParameters(model='none'))
RIGID = dataclasses.replace(DRIVE, resonance=ResonanceParameters(form='none'))

LENGTHS = (1.0, 5.0, 10.0, 50.0, 150.0)


def drive_with(gain=4.0968e7, limit=10.0, level=0.13, viscous=4.6e-6):
    """Return a drive with sliding friction."""
    friction = FrictionParameters(
        model='coulomb_viscous', coulomb_level=level, static_level=level, viscous_coefficient=viscous
    )
    return dataclasses.replace(DRIVE, gain=gain, control_limit=limit, friction=friction)


@pytest.mark.parametrize(
    ('length', 'milliseconds', 'peak'),
    [
        (1.0, 0.099, 20.0),
        (5.0, 0.221, 45.0),
        (10.0, 0.313, 64.0),
        (50.0, 0.699, 143.0),
        (150.0, 1.21, 250.0),
        (1e3, 3.15, 625.0),
        (25e3, 18.7, 2023.0),
    ],
)
def test_the_shipped_drive(length, milliseconds, peak):
    """Values of an independent simulation of this drive; peak velocities in mm/s."""
    found = time_optimal_seek(DRIVE, length)
    assert 1e3 * found.time == pytest.approx(milliseconds, rel=0.02)
    assert 1e-3 * found.peak_velocity == pytest.approx(peak, rel=0.02)
    assert time_optimal_seek(DRIVE, -length) == found


@given(length=st.floats(1e-3, 1e5), gain=st.floats(1e3, 1e9), limit=st.floats(0.1, 100.0))
def test_without_friction_it_is_the_textbooks(length, gain, limit):
    found = time_optimal_seek(dataclasses.replace(FREE, gain=gain, control_limit=limit), length)
    assert found.time == pytest.approx(2.0 * math.sqrt(length / (gain * limit)), rel=1e-9)
    assert found.acceleration_time == pytest.approx(0.5 * found.time, rel=1e-9)
    assert found.peak_velocity == pytest.approx(math.sqrt(gain * limit * length), rel=1e-9)


@settings(max_examples=40)
@given(
    length=st.floats(1e-2, 1e5),
    limit=st.floats(0.5, 20.0),
    level=st.floats(0.001, 0.4),
    viscous=st.floats(1e-12, 1e-3),
)
def test_the_switched_voltage_ends_at_rest_on_the_target(length, limit, level, viscous):
    plant = drive_with(limit=limit, level=level, viscous=viscous)
    found = time_optimal_seek(plant, length)
    state = np.zeros(2)
    for seconds, voltage in (
        (found.acceleration_time, limit),
        (found.time - found.acceleration_time, -limit),
    ):

        def change(_, x, voltage=voltage):
            return [x[1], plant.gain * (voltage - level - viscous * x[1])]

        state = solve_ivp(change, (0.0, seconds), state, method='LSODA', rtol=1e-10, atol=1e-12 * length).y[:, -1]
        if voltage > 0.0:
            assert state[1] == pytest.approx(found.peak_velocity, rel=1e-6)
    assert state[0] == pytest.approx(length, rel=1e-5)
    assert abs(state[1]) < 1e-5 * found.peak_velocity


def test_no_other_voltage_is_faster():
    """The shortest time in which a discretized body reaches the target at rest, any voltage allowed."""
    plant, length, samples = drive_with(), 150.0, 400
    bound = time_optimal_seek(plant, length).time

    def farthest(duration):
        """Return how far the body comes from rest to rest in a time."""
        step = duration / samples
        damping = plant.gain * plant.friction.viscous_coefficient
        a, b, *_ = signal.cont2discrete(
            (np.array([[0.0, 1.0], [0.0, -damping]]), np.array([[0.0], [plant.gain]]), np.eye(2), np.zeros((2, 1))),
            step,
        )
        columns = [b]
        for _ in range(samples - 1):
            columns.append(a @ columns[-1])
        reach = np.hstack(columns[::-1])
        level = plant.friction.coulomb_level
        found = linprog(
            -reach[0], A_eq=reach[1:], b_eq=[0.0], bounds=(-plant.control_limit - level, plant.control_limit - level)
        )
        return -found.fun

    assert farthest(0.998 * bound) < length < farthest(1.002 * bound)


@pytest.mark.parametrize(('limit', 'level'), [(0.1, 0.13), (0.13, 0.13)])
def test_a_drive_that_friction_holds_has_no_seek(limit, level):
    with pytest.raises(ValueError, match='control_limit'):
        time_optimal_seek(drive_with(limit=limit, level=level), 1.0)


def test_bad_lengths_and_tolerances():
    assert time_optimal_seek(DRIVE, 0.0).time == 0.0
    for length in (math.nan, math.inf):
        with pytest.raises(ValueError, match='finite'):
            time_optimal_seek(DRIVE, length)
    with pytest.raises(ValueError, match='tolerance'):
        fastest_seek(DRIVE, 1e-4, 1.0, tolerance=0.0)


@pytest.mark.parametrize(
    ('sample_time', 'milliseconds'),
    [(1e-4, (0.16, 0.28, 0.40, 0.80, 1.22)), (1.0 / 26400.0, (0.10, 0.20, 0.29, 0.68, 1.20))],
)
def test_the_fastest_seek_of_the_shipped_drive(sample_time, milliseconds):
    """Values of an independent computation with two decimals, to which 2 % of the short ones are less than rounding."""
    for length, expected in zip(LENGTHS, milliseconds, strict=True):
        found = 1e3 * fastest_seek(DRIVE, sample_time, length).time
        assert found == pytest.approx(expected, rel=0.02, abs=0.005)


def drives_with_modes_off(factor):
    """Return continuous transfer functions in series of the shipped drive, written down by hand."""
    sections = (
        ((0.9321, 678.3, 1.184e9), (1.0, 2053.0, 1.184e9)),
        ((0.8249, 2251.0, 1.665e9), (1.0, 3276.0, 1.665e9)),
        ((0.0, 0.0, 2.431e9), (1.0, 2703.0, 2.431e9)),
        ((0.0, 0.0, 8.383e9), (1.0, 5655.0, 8.383e9)),
    )
    scale = np.array([1.0, factor, factor**2])
    numerator, denominator = np.array([4.0968e7]), np.array([1.0, 4.0968e7 * 4.6e-6, 0.0])
    for above, below in sections:
        numerator, denominator = np.polymul(numerator, scale * above), np.polymul(denominator, scale * below)
    return numerator, denominator


def pulse_response(factor, sample_time, instants):
    """Return the head's position after a pulse of one sample, by scipy's step response [um/V]."""
    # In milliseconds, so that the coefficients stay near one another.
    numerator, denominator = drives_with_modes_off(factor)
    order = len(denominator) - 1
    powers = 1e-3 ** np.arange(order, -1, -1)
    scaled = (numerator / powers[-len(numerator) :] / 1e3**order, denominator / powers / 1e3**order)
    time = 1e3 * sample_time / PARTS * np.arange(instants)
    step = signal.step(signal.TransferFunction(*scaled), T=time)[1]
    return step - np.concatenate([np.zeros(PARTS), step[:-PARTS]])


def head_at_instants(control, factor, sample_time):
    """Return the head's position at the instants, from a command less the friction's level [um]."""
    pulse = pulse_response(factor, sample_time, PARTS * (len(control) + 1))
    drive = np.zeros(len(pulse))
    drive[: PARTS * len(control) : PARTS] = control - 0.13
    return np.convolve(drive, pulse)[: PARTS * len(control) + 1]


@pytest.mark.parametrize('length', [1.0, 10.0, 50.0])
def test_the_command_of_the_fastest_seek_arrives_with_an_independent_model(length):
    found = fastest_seek(DRIVE, 1e-4, length)
    assert np.abs(found.control).max() <= 10.0 + 1e-9
    arrival = round(found.time / 1e-4 * PARTS)
    worst = 0.0
    for factor in (0.95, 1.0, 1.05):
        head = head_at_instants(found.control, factor, 1e-4)
        error = np.abs(head[arrival : arrival + round(WATCHED / 1e-4) * PARTS + 1] - length)
        assert error.max() <= 0.1 + 1e-3
        worst = max(worst, error.max())
    # The plant integrates in substeps.
    assert worst == pytest.approx(found.error, abs=2e-3)


@pytest.mark.parametrize('length', [5.0, 50.0])
def test_no_command_arrives_an_instant_earlier(length):
    """Weak duality: weights w with P'w bounded prove that the largest error exceeds the tolerance."""
    sample_time = 1e-4
    arrival = round(fastest_seek(DRIVE, sample_time, length).time / sample_time * PARTS) - 1
    watched = round(WATCHED / sample_time)
    samples = -(-arrival // PARTS) + watched
    instants = arrival + np.arange(watched * PARTS + 1)
    rows = []
    for factor in (0.95, 1.0, 1.05):
        pulse = pulse_response(factor, sample_time, PARTS * (samples + 1))
        since = instants[:, None] - PARTS * np.arange(samples)
        rows.append(np.where(since >= 0, pulse[np.maximum(since, 0)], 0.0))
    positions = np.vstack(rows)
    low, high = -10.0 - 0.13, 10.0 - 0.13

    # For weights of total magnitude 1: max|L - P u| >= w'(L - P u) >= L sum w - max over u of (P'w)'u.
    # The least error is the largest of these; with w = p - q, and s >= low g, high g where g = P'w.
    count, none = len(positions), np.zeros
    cost = np.concatenate([np.full(count, -length), np.full(count, length), np.ones(samples)])
    above = np.hstack([positions.T, -positions.T])
    limits = np.vstack(
        [
            np.hstack([high * above, -np.eye(samples)]),
            np.hstack([low * above, -np.eye(samples)]),
            np.concatenate([np.ones(2 * count), none(samples)]),
        ]
    )
    found = linprog(
        cost,
        A_ub=limits,
        b_ub=np.append(none(2 * samples), 1.0),
        bounds=[(0.0, None)] * (2 * count) + [(None, None)] * samples,
    )
    weights = found.x[:count] - found.x[count : 2 * count]
    weights /= np.abs(weights).sum()
    gradient = positions.T @ weights
    assert length * weights.sum() - np.maximum(low * gradient, high * gradient).sum() > 0.1


@pytest.mark.parametrize('length', [1.0, 10.0, 150.0])
def test_a_rigid_body_enters_the_tolerance_at_the_speed_at_which_it_can_still_stop_in_it(length):
    """It takes the time-optimal seek to the far edge, less the braking along the whole tolerance at the end."""
    braking = math.sqrt(2.0 * 0.2 / (DRIVE.gain * (10.0 + 0.13)))
    bound = time_optimal_seek(RIGID, length + 0.1).time - braking
    # Up to a sample more, as u is held.
    assert bound - 1e-6 < fastest_seek(RIGID, 1e-5, length).time < bound + 1e-5


def test_a_longer_watch_changes_nothing(monkeypatch):
    times = [fastest_seek(DRIVE, 1e-4, length).time for length in LENGTHS]
    monkeypatch.setattr('hdd_servo_ros.analysis.seek_bounds.WATCHED', 2.0 * WATCHED)
    assert [fastest_seek(DRIVE, 1e-4, length).time for length in LENGTHS] == times


def test_modes_cost_time_and_robustness_costs_more():
    certain = fastest_seek(DRIVE, 1e-4, 5.0, spread=0.0).time
    assert fastest_seek(RIGID, 1e-4, 5.0).time <= certain <= fastest_seek(DRIVE, 1e-4, 5.0).time
    assert certain < fastest_seek(DRIVE, 1e-4, 5.0, spread=0.1).time


def test_a_seek_within_the_tolerance_takes_no_time():
    found = fastest_seek(DRIVE, 1e-4, 0.1)
    assert (found.time, found.error, len(found.control)) == (0.0, 0.1, 0)


@pytest.mark.parametrize(
    'resonance',
    [
        ResonanceParameters(),
        ResonanceParameters(form='two_parameter', frequencies=(5000.0, 9000.0), damping_ratios=(0.02, 0.03)),
        ResonanceParameters(form='parallel', frequencies=(5000.0,), damping_ratios=(0.02,), residues=(-1.0,)),
    ],
)
def test_scaled_modes_have_scaled_poles(resonance):
    scaled = scaled_modes(resonance, 1.05)

    def poles(r):
        if r.form == 'sections':
            return np.array([np.roots(r.denominators[i : i + 3]) for i in range(0, len(r.denominators), 3)]).ravel()
        w, z = 2.0 * np.pi * np.array(r.frequencies), np.array(r.damping_ratios)
        return w * (-z + 1j * np.sqrt(1.0 - z**2))

    assert np.abs(poles(scaled)) == pytest.approx(1.05 * np.abs(poles(resonance)))
    assert np.angle(poles(scaled)) == pytest.approx(np.angle(poles(resonance)))
    if resonance.form == 'sections':
        assert drives_with_modes_off(1.05)[0] == pytest.approx(
            4.0968e7 * np.polymul(np.polymul(*np.reshape(scaled.numerators, (-1, 3))[:2]), 1.05**4 * 2.431e9 * 8.383e9)
        )
