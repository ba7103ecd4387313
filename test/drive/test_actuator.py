"""Actuator and drivers (3.1)-(3.18): the data against each other, the transfer functions against the equations."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.drive import actuator as act
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters, Section, sections_of
from hdd_servo_ros.parameters import ParameterError

CURRENT = ActuatorParameters(driver='current')
NO_RESONANCE = ResonanceParameters(form='none')
VOLTAGE = ActuatorParameters(driver='voltage', amplifier_gain=2.0)


def at(function: transfer.TransferFunction, frequency: float) -> complex:
    s = 2j * math.pi * frequency
    return complex(np.polyval(function[0], s) / np.polyval(function[1], s))


def test_torque_and_coil() -> None:
    k_t = act.torque_constant(0.8, 4.0, 0.025)  # (3.2)
    assert k_t == pytest.approx(0.08)
    assert CURRENT.torque_constant == k_t
    assert act.torque(k_t, 0.5) == pytest.approx(0.8 * 4.0 * 0.5 * 0.025)  # (3.1)
    assert act.angular_acceleration(0.04, 5.0e-6) == pytest.approx(8000.0)  # (3.4)
    # (3.5), (3.6): 8 ohm at 0.5 A, 1 mH at 100 A/s, 0.08 V s/rad at 10 rad/s
    assert act.coil_voltage(8.0, 1.0e-3, 0.08, 0.5, 100.0, 10.0) == pytest.approx(4.0 + 0.1 + 0.8)


def test_default_actuator_has_the_gain_of_5_1() -> None:
    assert ActuatorParameters().gain == pytest.approx(4.0968e7, rel=1e-8)
    # k_v = k_t k_a/J (3.17)
    assert CURRENT.acceleration_constant == pytest.approx(0.08 * 0.05 / CURRENT.inertia)


def test_time_constants_are_3_13() -> None:
    assert CURRENT.mechanical_time_constant == pytest.approx(8.0 * CURRENT.inertia / (0.08 * 0.08))
    assert CURRENT.electrical_time_constant == pytest.approx(1.0e-3 / 2008.0)
    assert VOLTAGE.electrical_time_constant == pytest.approx(1.0e-3 / 8.0)


@pytest.mark.parametrize('frequency', [1.0, 100.0, 5.0e3, 5.0e4])
def test_exact_current_drive_is_the_solution_of_3_7_and_3_8(frequency: float) -> None:
    """(I_s - I_m) R_s = R_m I_m + L_m s I_m + k_b s theta with I_m = J s^2 theta / k_t, solved for theta."""
    s = 2j * math.pi * frequency
    p = CURRENT
    current = p.inertia * s**2 / p.torque_constant
    source = (
        (p.coil_resistance + p.coil_inductance * s + p.source_resistance) * current + p.back_emf_constant * s
    ) / p.source_resistance
    assert at(transfer.current_driven_exact(p), frequency) == pytest.approx(1.0 / source, rel=1e-12)


@pytest.mark.parametrize('frequency', [1.0, 100.0, 5.0e3, 5.0e4])
def test_approximations_hold_where_they_say(frequency: float) -> None:
    exact = at(transfer.current_driven_exact(CURRENT), frequency)
    approximate = at(transfer.current_driven_approximate(CURRENT), frequency)
    factored = at(transfer.current_driven_factored(CURRENT), frequency)
    # (3.11) neglects R_m/R_s = 0.4 %; (3.12) neglects tau_e R_m/(R_m + R_s) against tau_m.
    assert approximate / exact == pytest.approx(1.0, abs=5e-3)
    assert factored / approximate == pytest.approx(1.0, abs=1e-5)
    coarse = replace(CURRENT, source_resistance=40.0)
    exact = at(transfer.current_driven_exact(coarse), frequency)
    assert abs(at(transfer.current_driven_approximate(coarse), frequency) / exact - 1.0) > 0.1


def test_factored_form_is_3_15_with_the_amplifier() -> None:
    """The product of four factors, where the print has a sum."""
    p = CURRENT
    s = 2j * math.pi * 3000.0
    ratio = p.coil_resistance / (p.coil_resistance + p.source_resistance)
    value = (p.coil_resistance * p.amplifier_gain / p.back_emf_constant) / (
        s
        * (s * p.electrical_time_constant + 1.0)
        * (s * p.amplifier_time_constant + 1.0)
        * (s * p.mechanical_time_constant + ratio)
    )
    assert at(transfer.driven_actuator(p, approximate=True), 3000.0) == pytest.approx(value, rel=1e-12)


def test_reduced_model_is_the_limit_of_the_driven_ones() -> None:
    """(3.16): instant amplifier and coil, R_s without end, between the pole of the back-EMF and those of the driver."""
    ideal = replace(CURRENT, amplifier_time_constant=0.0, coil_inductance=0.0, source_resistance=1.0e9)
    reduced = transfer.driven_actuator(replace(ideal, driver='reduced'))
    assert at(transfer.driven_actuator(ideal), 500.0) == pytest.approx(at(reduced, 500.0), rel=1e-6)


def test_voltage_drive_is_the_solution_of_3_5_and_3_8() -> None:
    s = 2j * math.pi * 800.0
    p = VOLTAGE
    current = p.inertia * s**2 / p.torque_constant
    voltage = (p.coil_resistance + p.coil_inductance * s) * current + p.back_emf_constant * s
    value = p.amplifier_gain / (p.amplifier_time_constant * s + 1.0) / voltage
    assert at(transfer.driven_actuator(p), 800.0) == pytest.approx(value, rel=1e-12)
    assert at(transfer.coil(p), 800.0) == pytest.approx(1.0 / (8.0 + 1.0e-3 * s))


def test_tracks_are_3_17_and_3_18() -> None:
    # 25 kTPI: about 1 µm per track; k_y = 0.05 m * 25e3/0.0254 m
    assert ActuatorParameters().position_gain(25.0e3) == pytest.approx(49212.598, rel=1e-6)
    function = transfer.tracks(ActuatorParameters(), 25.0e3)
    space = transfer.tracks_state_space(ActuatorParameters(), 25.0e3)
    w = 2.0 * np.pi * np.array([10.0, 1000.0])
    _, one = signal.freqresp(transfer.system(function), w)
    a, b, c, _ = space
    other = [(c @ np.linalg.solve(1j * point * np.eye(2) - a, b))[0, 0] for point in w]
    np.testing.assert_allclose(one, other, rtol=1e-12)
    # 1 m of tracks is TPI/0.0254 of them
    meters = ActuatorParameters().gain / 1.0e6
    assert one[0].real == pytest.approx(-meters * 25.0e3 / 0.0254 / w[0] ** 2, rel=1e-8)


@pytest.mark.parametrize('driver', ['reduced', 'rigid', 'current', 'voltage'])
@pytest.mark.parametrize(
    'resonance',
    [
        ResonanceParameters(),
        ResonanceParameters(form='none'),
        ResonanceParameters(form='two_parameter', frequencies=(4e3, 9e3), damping_ratios=(0.01, 0.02)),
        ResonanceParameters(form='parallel', frequencies=(4e3, 9e3), damping_ratios=(0.01, 0.02), residues=(-0.7, 0.2)),
    ],
)
def test_transfer_function_state_space_and_response_agree(driver: str, resonance: ResonanceParameters) -> None:
    parameters = PlantParameters(actuator=ActuatorParameters(driver=driver), resonance=resonance)
    f = np.array([20.0, 900.0, 4000.0, 5470.0, 9000.0, 2.0e4])
    numerator, denominator = transfer.head(parameters)
    s = 2j * np.pi * f
    response = transfer.frequency_response(parameters, f)
    np.testing.assert_allclose(np.polyval(numerator, s) / np.polyval(denominator, s), response, rtol=1e-7)
    a, b, c, d = transfer.head_state_space(parameters)
    modal = np.array([(c @ np.linalg.solve(point * np.eye(a.shape[0]) - a, b) + d)[:, 0] for point in s])
    np.testing.assert_allclose(modal[:, 0], response, rtol=1e-7)
    np.testing.assert_allclose(modal[:, 1], s * response, rtol=1e-6)  # head velocity
    assert isinstance(transfer.system((a, b, c, d)), signal.StateSpace)


def test_section_forms_agree() -> None:
    values = sections_of(ResonanceParameters())[0]
    assert values == Section(0.9321, 678.3, 1.184e9, 2053.0, 1.184e9)
    w = 2.0 * np.pi * np.array([100.0, 5476.0, 2.0e4])
    _, one = signal.freqresp(transfer.system(transfer.section(values)), w)
    _, other = signal.freqresp(transfer.system(transfer.section_state_space(values)), w)
    np.testing.assert_allclose(one, other, rtol=1e-10)


def test_back_emf_cannot_exceed_the_torque_constant() -> None:
    # k_b > k_t would give back more electrical power than the motion takes.
    with pytest.raises(ParameterError, match='back_emf_constant'):
        ActuatorParameters(driver='current', back_emf_constant=0.1)


def response(space: transfer.StateSpace, s: complex) -> complex:
    a, b, c, d = space
    return complex((c @ np.linalg.solve(s * np.eye(a.shape[0]) - a, b) + d)[0, 0])


INSTANT = [
    {},
    {'amplifier_time_constant': 0.0},
    {'coil_inductance': 0.0},
    {'amplifier_time_constant': 0.0, 'coil_inductance': 0.0},
    {'back_emf_constant': 0.0},
]


@pytest.mark.parametrize('driver', ['reduced', 'rigid', 'current', 'voltage'])
@pytest.mark.parametrize('changes', INSTANT)
def test_state_spaces_are_the_transfer_functions(driver: str, changes: dict[str, Any]) -> None:
    """An instant amplifier or coil has no state."""
    p = ActuatorParameters(driver=driver, **changes)
    states = 2 + 2 * (driver in ('current', 'voltage'))
    states -= sum(name != 'back_emf_constant' for name in changes) * (driver in ('current', 'voltage'))
    assert transfer.driven_actuator_state_space(p)[0].shape == (states, states)
    parameters = PlantParameters(actuator=p)
    for f in (2.0, 90.0, 3000.0, 2.0e4):
        s = 2j * math.pi * f
        for space, function in (
            (transfer.coil_state_space(p), transfer.coil(p)),
            (transfer.amplifier_state_space(p), transfer.amplifier(p)),
            (transfer.driven_actuator_state_space(p), transfer.driven_actuator(p)),
            (transfer.resonance_state_space(parameters.resonance), transfer.resonance(parameters.resonance)),
            (transfer.head_state_space(parameters), transfer.head(parameters)),
        ):
            assert response(space, s) == pytest.approx(at(function, f), rel=1e-9)


@pytest.mark.parametrize('changes', INSTANT)
def test_approximations_hold_without_back_emf_or_inductance(changes: dict[str, Any]) -> None:
    p = replace(CURRENT, **changes)
    exact = at(transfer.current_driven_exact(p), 700.0)
    for function in (transfer.current_driven_approximate(p), transfer.current_driven_factored(p)):
        assert at(function, 700.0) / exact == pytest.approx(1.0, abs=5e-3)
    if p.back_emf_constant == 0.0:
        assert p.mechanical_time_constant == math.inf


@pytest.mark.parametrize('changes', INSTANT)
@pytest.mark.parametrize('driver', ['rigid', 'current', 'voltage'])
def test_sampled_response_of_instant_drivers_is_the_blocks(driver: str, changes: dict[str, Any]) -> None:
    actuator = ActuatorParameters(driver=driver, **changes)
    parameters = PlantParameters(
        actuator=actuator, friction=FrictionParameters(model='viscous', viscous_coefficient=0.0), substeps=64
    )
    plant = Plant(parameters, 1.0e-4)
    a, b, c, d = transfer.head_state_space(parameters)
    discrete = signal.cont2discrete((a, b, c, d), 1.0e-4)
    state = np.zeros((a.shape[0], 1))
    control = np.random.default_rng(4).normal(size=200)
    expected, measured = [], []
    for tick, u in enumerate(control.tolist(), start=1):
        state = discrete[0] @ state + discrete[1] * u
        expected.append((c @ state)[:, 0])
        measured.append(plant.step(tick, u)[:2])
    error = np.abs(np.array(measured) - expected).max(axis=0) / np.abs(expected).max(axis=0)
    assert np.all(error < 1e-4)
    # The frequency response is that of these matrices.
    z = np.exp(2j * np.pi * 900.0 * 1.0e-4)
    value = (c[0] @ np.linalg.solve(z * np.eye(a.shape[0]) - discrete[0], discrete[1]))[0]
    assert transfer.sampled_frequency_response(parameters, 1.0e-4, [900.0])[0] == pytest.approx(value, rel=1e-9)


def test_rigid_driver_runs_3_16_and_reduced_its_own_gain() -> None:
    heavy = ActuatorParameters(driver='rigid', inertia=2.0 * ActuatorParameters().inertia)
    rigid = PlantParameters(actuator=heavy)
    assert rigid.rigid_gain == pytest.approx(0.5 * 4.0968e7, rel=1e-8)
    assert replace(rigid, actuator=replace(heavy, driver='reduced')).rigid_gain == 4.0968e7
    plant = Plant(replace(rigid, friction=FrictionParameters(model='none'), resonance=NO_RESONANCE), 1.0e-4)
    assert plant.step(1, 1.0)[1] == pytest.approx(rigid.rigid_gain * 1.0e-4)
    # (3.17): k_y tracks a radian, of l_arm meters a radian
    tracks = at(transfer.tracks(heavy, 25.0e3), 50.0) / heavy.position_gain(25.0e3) * heavy.arm_length * 1.0e6
    assert tracks == pytest.approx(complex(transfer.frequency_response(replace(rigid, resonance=NO_RESONANCE), 50.0)))


@pytest.mark.parametrize(
    'parameters',
    [
        ResonanceParameters(form='none'),
        ResonanceParameters(form='two_parameter', frequencies=(4e3, 9e3), damping_ratios=(0.01, 0.02)),
        ResonanceParameters(form='parallel', frequencies=(4e3, 9e3), damping_ratios=(0.01, 0.02), residues=(-0.7, 0.2)),
    ],
)
def test_state_space_of_all_resonances(parameters: ResonanceParameters) -> None:
    space = transfer.resonance_state_space(parameters)
    assert isinstance(transfer.system(space), signal.StateSpace)
    for f in (50.0, 3990.0, 9000.0, 3.0e4):
        expected = at(transfer.resonance(parameters), f)
        assert response(space, 2j * math.pi * f) == pytest.approx(expected, rel=1e-9)
