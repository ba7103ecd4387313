"""
Transfer functions and state-space matrices of the drive, as arrays and as ``scipy.signal`` systems.

A transfer function is a pair (numerator, denominator) of coefficient arrays, highest power of s first; a state space
is (A, B, C, D). :func:`system` makes a ``scipy.signal`` system of either. Friction is left out: this is the linear
drive.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import signal

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters, Section, modal_form, sections_of

Array = npt.NDArray[np.float64]
TransferFunction = tuple[Array, Array]
StateSpace = tuple[Array, Array, Array, Array]


def system(matrices: TransferFunction | StateSpace) -> signal.lti:
    """Return a transfer function or a state space as a ``scipy.signal`` system."""
    if len(matrices) == 2:
        return signal.TransferFunction(*matrices)
    return signal.StateSpace(*matrices)


def _multiply(first: Sequence[float] | Array, second: Sequence[float] | Array) -> Array:
    return np.convolve(first, second)


def product(*factors: TransferFunction) -> TransferFunction:
    """Return the product of transfer functions."""
    numerator: Array = np.ones(1)
    denominator: Array = np.ones(1)
    for factor in factors:
        numerator = _multiply(numerator, factor[0])
        denominator = _multiply(denominator, factor[1])
    return numerator, denominator


def coil(parameters: ActuatorParameters) -> TransferFunction:
    """Return I_m/(e - e_b) [A/V] of the coil (3.5): 1/(L_m s + R_m)."""
    return np.ones(1), np.array([parameters.coil_inductance, parameters.coil_resistance])


def current_driven_exact(parameters: ActuatorParameters) -> TransferFunction:
    """Return theta/I_s [rad/A] of the coil on a current source, exact (3.10)."""
    p = parameters
    scale = p.inertia / (p.torque_constant * p.source_resistance)
    denominator = [
        p.coil_inductance * scale,
        (p.coil_resistance + p.source_resistance) * scale,
        p.back_emf_constant / p.source_resistance,
        0.0,
    ]
    return np.ones(1), np.trim_zeros(np.array(denominator), 'f')


def current_driven_approximate(parameters: ActuatorParameters) -> TransferFunction:
    """
    Return theta/I_s [rad/A] by (3.11), which holds for R_s much larger than R_m.

    The exact denominator with (R_m + R_s)/R_s taken as 1: the gain at high frequency is off by R_m/R_s.
    """
    p = parameters
    scale = p.back_emf_constant / p.coil_resistance
    total = p.coil_resistance + p.source_resistance
    denominator = [
        scale * p.coil_inductance * p.inertia * p.coil_resistance / (p.torque_constant * p.back_emf_constant * total),
        scale * p.coil_resistance * p.inertia / (p.torque_constant * p.back_emf_constant),
        scale * p.coil_resistance / total,
        0.0,
    ]
    return np.ones(1), np.trim_zeros(np.array(denominator), 'f')


def current_driven_factored(parameters: ActuatorParameters) -> TransferFunction:
    """Return theta/I_s [rad/A] by (3.12), which holds further for tau_e much smaller than tau_m."""
    p = parameters
    ratio = p.coil_resistance / (p.coil_resistance + p.source_resistance)
    electrical = np.trim_zeros(np.array([p.electrical_time_constant, 1.0]), 'f')
    denominator = _multiply([1.0, 0.0], _multiply(electrical, [p.mechanical_time_constant, ratio]))
    return np.array([p.coil_resistance / p.back_emf_constant]), denominator


def amplifier(parameters: ActuatorParameters) -> TransferFunction:
    """Return I_s/u [A/V] (or e/u [V/V]) of the amplifier (3.14): k_a/(tau_a s + 1)."""
    denominator = np.trim_zeros(np.array([parameters.amplifier_time_constant, 1.0]), 'f')
    return np.array([parameters.amplifier_gain]), denominator


def driven_actuator(parameters: ActuatorParameters, approximate: bool = False) -> TransferFunction:
    """
    Return theta/u [rad/V] of the actuator with its driver's dynamics.

    A current driver gives (3.14) times (3.10), or (3.15), corrected to the product of its four factors, when
    ``approximate``; a voltage driver the amplifier and (3.5), (3.6), (3.8); the reduced driver (3.16).
    """
    p = parameters
    if p.driver == 'reduced':
        return np.array([p.acceleration_constant]), np.array([1.0, 0.0, 0.0])
    if p.driver == 'current':
        return product(amplifier(p), current_driven_factored(p) if approximate else current_driven_exact(p))
    # e = R_m I + L_m I' + k_b theta' with I = J theta''/k_t
    scale = p.inertia / p.torque_constant
    denominator = np.array([p.coil_inductance * scale, p.coil_resistance * scale, p.back_emf_constant, 0.0])
    return product(amplifier(p), (np.ones(1), np.trim_zeros(denominator, 'f')))


def tracks(parameters: ActuatorParameters, tracks_per_inch: float) -> TransferFunction:
    """Return y/u [tracks/V] of the reduced model (3.17): k_v k_y/s^2."""
    k_y = parameters.position_gain(tracks_per_inch)
    return np.array([parameters.acceleration_constant * k_y]), np.array([1.0, 0.0, 0.0])


def tracks_state_space(parameters: ActuatorParameters, tracks_per_inch: float) -> StateSpace:
    """Return the state space (3.18) of (y [tracks], v [rad/s]), with y as the output."""
    k_y = parameters.position_gain(tracks_per_inch)
    a = np.array([[0.0, k_y], [0.0, 0.0]])
    b = np.array([[0.0], [parameters.acceleration_constant]])
    return a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))


def section(values: Section) -> TransferFunction:
    """Return a resonance section, (3.19) or (5.2)-(5.5), as a transfer function."""
    return np.trim_zeros(np.array([values.b2, values.b1, values.b0]), 'f'), np.array([1.0, values.a1, values.a0])


def section_state_space(values: Section) -> StateSpace:
    """Return a resonance section in controllable canonical form."""
    a = np.array([[0.0, 1.0], [-values.a0, -values.a1]])
    c = np.array([[values.b0 - values.b2 * values.a0, values.b1 - values.b2 * values.a1]])
    return a, np.array([[0.0], [1.0]]), c, np.array([[values.b2]])


def resonance(parameters: ResonanceParameters) -> TransferFunction:
    """
    Return head over rigid body: the product of the sections, or 1 + s^2 times the sum of the parallel modes.

    Its coefficients span many decades; for more than some eight modes use :func:`head_state_space` or
    :func:`frequency_response`, which do not multiply them out.
    """
    if parameters.form != 'parallel':
        return product(*[section(values) for values in sections_of(parameters)])
    modal = modal_form(parameters)
    denominator: Array = np.ones(1)
    for mode in modal.modes:
        denominator = _multiply(denominator, [1.0, mode.a1, mode.a0])
    numerator = denominator
    for i, mode in enumerate(modal.modes):
        term: Array = np.array([mode.gamma, 0.0, 0.0])
        for j, other in enumerate(modal.modes):
            if j != i:
                term = _multiply(term, [1.0, other.a1, other.a0])
        numerator = np.asarray(np.polyadd(numerator, term))
    return numerator, denominator


def head(parameters: PlantParameters) -> TransferFunction:
    """Return head position over control [um/V] of the drive without friction."""
    p = parameters.actuator
    if p.driver == 'reduced':
        rigid: TransferFunction = np.array([parameters.gain]), np.array([1.0, 0.0, 0.0])
    else:
        numerator, denominator = driven_actuator(p)
        rigid = numerator * p.arm_length * p.units_per_metre, denominator
    return product(rigid, resonance(parameters.resonance))


def head_state_space(parameters: PlantParameters) -> StateSpace:
    """
    Return the state space of the drive without friction, in modal form.

    States: driver b, c (unless reduced), rigid body x, v, then q w and q' of each mode with its natural frequency w.
    Outputs: head position [um] and head velocity [um/s]. Input: control [V].
    """
    actuator = parameters.actuator
    gain = parameters.rigid_gain
    modal = modal_form(parameters.resonance)
    electrical = 0 if actuator.driver == 'reduced' else 2
    n = electrical + 2 + 2 * len(modal.modes)
    x, v = electrical, electrical + 1
    a = np.zeros((n, n))
    b = np.zeros((n, 1))
    c = np.zeros((2, n))
    a[x, v] = 1.0
    c[0, x] = modal.r0
    c[0, v] = modal.r1
    c[1, v] = modal.r0
    if electrical:
        if actuator.amplifier_time_constant == 0.0 or actuator.electrical_time_constant == 0.0:
            raise ValueError('a state space of the driver needs amplifier_time_constant and coil_inductance above 0')
        a[0, 0] = -1.0 / actuator.amplifier_time_constant
        b[0, 0] = 1.0 / actuator.amplifier_time_constant
        a[1, [0, 1, v]] = np.array([actuator.current_ratio, -1.0, -actuator.back_emf_resistance])
        a[1] /= actuator.electrical_time_constant
    driven = [v]
    for i, mode in enumerate(modal.modes):
        q = x + 2 + 2 * i
        p = q + 1
        w = np.sqrt(mode.a0)
        a[q, p] = w
        a[p, q] = -w
        a[p, p] = -mode.a1
        c[:, q] = np.array([mode.gamma, -mode.beta * mode.a0]) / w
        c[:, p] = np.array([mode.beta, mode.gamma - mode.beta * mode.a1])
        driven.append(p)
    for state in driven:
        if electrical:
            a[state, 1] = gain
        else:
            b[state, 0] = gain
    return a, b, c, np.zeros((2, 1))


def frequency_response(parameters: PlantParameters, frequencies: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Return head position over control [um/V] of the drive without friction at frequencies [Hz]."""
    s = 2.0j * np.pi * np.asarray(frequencies, dtype=np.float64)
    actuator = parameters.actuator
    if actuator.driver == 'reduced':
        response = parameters.gain / (s * s)
    else:
        numerator, denominator = driven_actuator(actuator)
        response = (
            actuator.arm_length * actuator.units_per_metre * np.polyval(numerator, s) / np.polyval(denominator, s)
        )
    if parameters.resonance.form == 'parallel':
        modal = modal_form(parameters.resonance)
        shape = 1.0 + s * s * sum((mode.gamma / (s * s + mode.a1 * s + mode.a0) for mode in modal.modes), 0.0 * s)
        return np.asarray(response * shape)
    for values in sections_of(parameters.resonance):
        numerator, denominator = section(values)
        response = response * np.polyval(numerator, s) / np.polyval(denominator, s)
    return np.asarray(response)


def sampled_frequency_response(
    parameters: PlantParameters, sample_time: float, frequencies: npt.ArrayLike
) -> npt.NDArray[np.complex128]:
    """
    Return head position over control [um/V] as a sampled system: control held over ``sample_time`` [s], friction none.

    This is the exact response that the discrete drive has; it differs from :func:`frequency_response` by the hold and,
    near half the sampling rate and beyond, by what is folded back.
    """
    a, b, c, d = head_state_space(parameters)
    discrete_a, discrete_b, _, _, _ = signal.cont2discrete((a, b, c, d), sample_time)
    z = np.exp(2.0j * np.pi * np.asarray(frequencies, dtype=np.float64) * sample_time)
    identity = np.eye(a.shape[0])
    responses = [c[0] @ np.linalg.solve(point * identity - discrete_a, discrete_b)[:, 0] for point in np.ravel(z)]
    result: npt.NDArray[np.complex128] = np.array(responses, dtype=np.complex128).reshape(np.shape(z))
    return result
