"""
Transfer functions and state-space matrices of the drive, as arrays and as ``scipy.signal`` systems.

A transfer function is a pair (numerator, denominator) of coefficient arrays, highest power of s first; a state-space
model is (A, B, C, D). :func:`system` converts either to a ``scipy.signal`` system. The models are linear and do not
include friction. Equation numbers are those of the thesis.
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
    """Return a transfer function or a state-space model as a ``scipy.signal`` system."""
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
    """Return the coil admittance I_m/(e - e_b) = 1/(L_m s + R_m) of eq. (3.5) [A/V]."""
    return np.ones(1), np.array([parameters.coil_inductance, parameters.coil_resistance])


def coil_state_space(parameters: ActuatorParameters) -> StateSpace:
    """Return the coil of eq. (3.5) with state and output I_m [A] and input e - e_b [V]; no state if L_m is 0."""
    resistance, inductance = parameters.coil_resistance, parameters.coil_inductance
    if inductance == 0.0:
        return _gain(1.0 / resistance)
    return np.array([[-resistance / inductance]]), np.array([[1.0 / inductance]]), np.ones((1, 1)), np.zeros((1, 1))


def current_driven_exact(parameters: ActuatorParameters) -> TransferFunction:
    """Return theta/I_s of the coil on a current source, exact, eq. (3.10) [rad/A]."""
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
    Return the approximation of theta/I_s for R_s much larger than R_m, eq. (3.11) [rad/A].

    The denominator is the exact one with (R_m + R_s)/R_s replaced by 1. The gain at high frequency has a relative error
    of R_m/R_s.
    """
    p = parameters
    total = p.coil_resistance + p.source_resistance
    # k_b/R_m times the printed factors, multiplied out, so that k_b = 0 (no back-EMF) does not divide by zero.
    denominator = [
        p.coil_inductance * p.inertia / (p.torque_constant * total),
        p.inertia / p.torque_constant,
        p.back_emf_constant / total,
        0.0,
    ]
    return np.ones(1), np.trim_zeros(np.array(denominator), 'f')


def current_driven_factored(parameters: ActuatorParameters) -> TransferFunction:
    """
    Return the factored approximation of theta/I_s, eq. (3.12) [rad/A].

    It requires R_s much larger than R_m and tau_e much smaller than tau_m. Numerator and denominator are the printed
    ones times k_b/R_m, so that k_b = 0 does not divide by zero.
    """
    p = parameters
    total = p.coil_resistance + p.source_resistance
    electrical = np.trim_zeros(np.array([p.electrical_time_constant, 1.0]), 'f')
    mechanical = [p.inertia / p.torque_constant, p.back_emf_constant / total]
    return np.ones(1), _multiply([1.0, 0.0], _multiply(electrical, mechanical))


def amplifier(parameters: ActuatorParameters) -> TransferFunction:
    """Return the amplifier k_a/(tau_a s + 1) of eq. (3.14): I_s/u [A/V], or e/u [V/V] with a voltage driver."""
    denominator = np.trim_zeros(np.array([parameters.amplifier_time_constant, 1.0]), 'f')
    return np.array([parameters.amplifier_gain]), denominator


def amplifier_state_space(parameters: ActuatorParameters) -> StateSpace:
    """Return the amplifier of eq. (3.14), whose state is its output I_s [A] or e [V]; no state if tau_a is 0."""
    gain, tau = parameters.amplifier_gain, parameters.amplifier_time_constant
    if tau == 0.0:
        return _gain(gain)
    return np.array([[-1.0 / tau]]), np.array([[gain / tau]]), np.ones((1, 1)), np.zeros((1, 1))


def _gain(value: float) -> StateSpace:
    return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[value]])


def driven_actuator(parameters: ActuatorParameters, approximate: bool = False) -> TransferFunction:
    """
    Return theta/u of the actuator, including the driver dynamics [rad/V].

    With a current driver the result is eq. (3.14) times eq. (3.10); with ``approximate`` it is eq. (3.15), corrected to
    the product of its four factors. With a voltage driver it is the amplifier with eqs. (3.5), (3.6) and (3.8). The
    other drivers give eq. (3.16). All values come from ``parameters``. A plant with the reduced driver ignores them and
    uses its own ``gain``.
    """
    p = parameters
    if not p.is_electrical:
        return np.array([p.acceleration_constant]), np.array([1.0, 0.0, 0.0])
    if p.driver == 'current':
        return product(amplifier(p), current_driven_factored(p) if approximate else current_driven_exact(p))
    # e = R_m I + L_m I' + k_b theta' with I = J theta''/k_t
    scale = p.inertia / p.torque_constant
    denominator = np.array([p.coil_inductance * scale, p.coil_resistance * scale, p.back_emf_constant, 0.0])
    return product(amplifier(p), (np.ones(1), np.trim_zeros(denominator, 'f')))


def driven_actuator_state_space(parameters: ActuatorParameters) -> StateSpace:
    """
    Return the state-space model of theta/u [rad/V]; see :func:`driven_actuator`.

    States: amplifier b and coil c of :mod:`~hdd_servo_ros.drive.electrical` [V], each only if the driver has it and its
    time constant is not 0; theta [rad]; theta' [rad/s].
    """
    radian = parameters.arm_length * parameters.units_per_meter
    a, b, driven = _driver(parameters, parameters.back_emf_resistance * radian, 2)
    n = a.shape[0]
    a[n - 2, n - 1] = 1.0
    a[n - 1] += parameters.acceleration_constant * driven[:n]
    b[n - 1, 0] += parameters.acceleration_constant * driven[n]
    c = np.zeros((1, n))
    c[0, n - 2] = 1.0
    return a, b, c, np.zeros((1, 1))


def _driver(parameters: ActuatorParameters, back_emf: float, rest: int) -> tuple[Array, Array, Array]:
    """
    Return A and B of a state space that begins with the driver states, and the coil current as a row of (states, u).

    Parameters
    ----------
    parameters
        Parameters of the actuator.
    back_emf
        Back-EMF coefficient: decrease of the coil current, referred to the control signal, per velocity unit [V].
    rest
        Number of the remaining states; the second of them is the velocity.
    """
    electrical = parameters.is_electrical
    has_amplifier = electrical and parameters.amplifier_time_constant > 0.0
    has_coil = electrical and parameters.electrical_time_constant > 0.0
    n = int(has_amplifier) + int(has_coil) + rest
    velocity = n - rest + 1
    a = np.zeros((n, n))
    b = np.zeros((n, 1))
    output = np.zeros(n + 1)  # coefficients of the states and u
    if has_amplifier:
        a[0, 0] = -1.0 / parameters.amplifier_time_constant
        b[0, 0] = 1.0 / parameters.amplifier_time_constant
        output[0] = 1.0
    else:
        output[n] = 1.0
    if electrical:
        output *= parameters.current_ratio
        output[velocity] -= back_emf
    if has_coil:
        # tau_e c' = r b - c - kappa v
        coil = n - rest - 1
        a[coil] = output[:n] / parameters.electrical_time_constant
        b[coil, 0] = output[n] / parameters.electrical_time_constant
        a[coil, coil] -= 1.0 / parameters.electrical_time_constant
        output = np.zeros(n + 1)
        output[coil] = 1.0
    return a, b, output


def tracks(parameters: ActuatorParameters, tracks_per_inch: float) -> TransferFunction:
    """
    Return y/u = k_v k_y/s^2 of the reduced model, eq. (3.17) [tracks/V].

    k_v follows from the actuator data, as in a plant with the driver ``rigid``. A plant with the driver ``reduced``
    uses its own ``gain`` instead.
    """
    k_y = parameters.position_gain(tracks_per_inch)
    return np.array([parameters.acceleration_constant * k_y]), np.array([1.0, 0.0, 0.0])


def tracks_state_space(parameters: ActuatorParameters, tracks_per_inch: float) -> StateSpace:
    """
    Return the state-space model of eq. (3.18) with states y [tracks] and v [rad/s], and output y.

    See :func:`tracks` for k_v.
    """
    k_y = parameters.position_gain(tracks_per_inch)
    a = np.array([[0.0, k_y], [0.0, 0.0]])
    b = np.array([[0.0], [parameters.acceleration_constant]])
    return a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))


def section(values: Section) -> TransferFunction:
    """Return a resonance section, eq. (3.19) or (5.2)-(5.5), as a transfer function."""
    return np.trim_zeros(np.array([values.b2, values.b1, values.b0]), 'f'), np.array([1.0, values.a1, values.a0])


def section_state_space(values: Section) -> StateSpace:
    """Return a resonance section in controllable canonical form."""
    a = np.array([[0.0, 1.0], [-values.a0, -values.a1]])
    c = np.array([[values.b0 - values.b2 * values.a0, values.b1 - values.b2 * values.a1]])
    return a, np.array([[0.0], [1.0]]), c, np.array([[values.b2]])


def resonance(parameters: ResonanceParameters) -> TransferFunction:
    """
    Return the transfer function from rigid body position to head position.

    It is the product of the sections, or 1 + s^2 times the sum of the parallel modes. For the form ``modes`` it is s^2
    times the sum of the modes, which with k/s^2 gives the head over the force. Its coefficients span many
    decades. For more than about eight modes use :func:`head_state_space` or :func:`frequency_response`, which do not
    multiply the factors out.
    """
    if parameters.form not in ('parallel', 'modes'):
        return product(*[section(values) for values in sections_of(parameters)])
    modal = modal_form(parameters)
    denominator: Array = np.ones(1)
    for mode in modal.modes:
        denominator = _multiply(denominator, [1.0, mode.a1, mode.a0])
    numerator = modal.r0 * denominator
    for i, mode in enumerate(modal.modes):
        term: Array = np.array([mode.gamma, 0.0, 0.0])
        for j, other in enumerate(modal.modes):
            if j != i:
                term = _multiply(term, [1.0, other.a1, other.a0])
        numerator = np.asarray(np.polyadd(numerator, term))
    return numerator, denominator


def resonance_state_space(parameters: ResonanceParameters) -> StateSpace:
    """
    Return the state-space model from rigid body position to head position [um], in modal form.

    States: w^2 q and w q' of each mode, where w is its natural frequency and q is driven by the rigid body position.
    """
    modal = modal_form(parameters)
    n = 2 * len(modal.modes)
    a = np.zeros((n, n))
    b = np.zeros((n, 1))
    c = np.zeros((1, n))
    d = modal.r0
    for i, mode in enumerate(modal.modes):
        q = 2 * i
        # s^2 (beta s + gamma)/(s^2 + a1 s + a0) = beta s + direct + (first s - direct a0)/(s^2 + a1 s + a0); the
        # terms in s cancel with r1 s in the sum.
        direct = mode.gamma - mode.beta * mode.a1
        first = -direct * mode.a1 - mode.beta * mode.a0
        w = np.sqrt(mode.a0)
        a[q, q + 1] = w
        a[q + 1, q] = -w
        a[q + 1, q + 1] = -mode.a1
        b[q + 1, 0] = w
        c[0, q] = -direct
        c[0, q + 1] = first / w
        d += direct
    return a, b, c, np.array([[d]])


def head(parameters: PlantParameters) -> TransferFunction:
    """Return the transfer function from control voltage to head position, without friction and delay [um/V]."""
    p = parameters.actuator
    if not p.is_electrical:
        rigid: TransferFunction = np.array([parameters.rigid_gain]), np.array([1.0, 0.0, 0.0])
    else:
        numerator, denominator = driven_actuator(p)
        rigid = numerator * p.arm_length * p.units_per_meter, denominator
    numerator, denominator = product(rigid, resonance(parameters.resonance_at_temperature))
    if not parameters.resonance.has_rigid_body:
        # s^2 of the modes cancels 1/s^2 of the rigid body, exactly.
        numerator, denominator = np.trim_zeros(numerator[:-2], 'f'), denominator[:-2]
    return numerator, denominator


def head_state_space(parameters: PlantParameters) -> StateSpace:
    """
    Return the state-space model of the drive without friction, in modal form.

    States: driver b and c, each only if the driver has it and its time constant is not 0; x and v of the rigid body,
    only if the drive has one; q w and q' of each mode, where w is its natural frequency. Outputs: head position [um]
    and head velocity [um/s]. Input: control voltage [V].

    Parameters
    ----------
    parameters
        Parameters of the drive; the friction and the input delay are ignored.

    Returns
    -------
    a, b, c, d
        Matrices of shapes (n, n), (n, 1), (2, n) and (2, 1).

    Notes
    -----
    Source: thesis eqs. (3.10) to (3.19), (5.1) to (5.5), in modal form.

    Examples
    --------
    >>> from hdd_servo_ros.drive import PlantParameters, head_state_space
    >>> a, b, c, d = head_state_space(PlantParameters())  # two states of the rigid body, two of each of four modes
    >>> a.shape, b.shape, c.shape, d.shape
    ((10, 10), (10, 1), (2, 10), (2, 1))
    """
    modal = modal_form(parameters.resonance_at_temperature)
    a, b, current = _driver(parameters.actuator, parameters.actuator.back_emf_resistance, 2 + 2 * len(modal.modes))
    n = a.shape[0]
    x = n - 2 - 2 * len(modal.modes)
    v = x + 1
    c = np.zeros((2, n))
    a[x, v] = 1.0
    c[0, x] = modal.r0
    c[0, v] = modal.r1
    c[1, v] = modal.r0
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
        a[state] += parameters.rigid_gain * current[:n]
        b[state, 0] += parameters.rigid_gain * current[n]
    if not parameters.resonance.has_rigid_body:
        kept = np.delete(np.arange(n), (x, v))
        a, b, c = a[np.ix_(kept, kept)], b[kept], c[:, kept]
    return a, b, c, np.zeros((2, 1))


def frequency_response(parameters: PlantParameters, frequencies: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """
    Return the frequency response from control voltage to head position, without friction [um/V].

    Parameters
    ----------
    parameters
        Parameters of the drive; the friction is ignored.
    frequencies
        Frequencies above 0 [Hz], an array of any shape.

    Returns
    -------
    ndarray
        Complex response [um/V], with the shape of ``frequencies``.

    Notes
    -----
    Source: thesis eqs. (3.10) to (3.19), (5.1) to (5.5).

    Examples
    --------
    The gain of the rigid body is 4.0968e7/(2 pi f)^2; at 100 Hz the resonances hardly matter:

    >>> from hdd_servo_ros.drive import PlantParameters, frequency_response
    >>> [f'{abs(value):.4g} um/V' for value in frequency_response(PlantParameters(), [100.0, 4000.0])]
    ['103.8 um/V', '0.1123 um/V']
    """
    s = 2.0j * np.pi * np.asarray(frequencies, dtype=np.float64)
    actuator = parameters.actuator
    if not actuator.is_electrical:
        response = parameters.rigid_gain / (s * s)
    else:
        numerator, denominator = driven_actuator(actuator)
        response = (
            actuator.arm_length * actuator.units_per_meter * np.polyval(numerator, s) / np.polyval(denominator, s)
        )
    if parameters.resonance.form in ('parallel', 'modes'):
        modal = modal_form(parameters.resonance_at_temperature)
        shape = modal.r0 + s * s * sum((mode.gamma / (s * s + mode.a1 * s + mode.a0) for mode in modal.modes), 0.0 * s)
        response = response * shape
    else:
        for values in sections_of(parameters.resonance_at_temperature):
            numerator, denominator = section(values)
            response = response * np.polyval(numerator, s) / np.polyval(denominator, s)
    if parameters.input_delay > 0.0:
        response = response * np.exp(-s * parameters.input_delay)
    return np.asarray(response)


def sampled_frequency_response(
    parameters: PlantParameters, sample_time: float, frequencies: npt.ArrayLike
) -> npt.NDArray[np.complex128]:
    """
    Return the frequency response of the sampled drive with a zero-order hold, without friction [um/V].

    This is the exact response of the discrete drive. It differs from :func:`frequency_response` by the hold and, near
    half the sampling rate and above, by aliasing.

    Parameters
    ----------
    parameters
        Parameters of the drive; the friction is ignored.
    sample_time
        T [s].
    frequencies
        Frequencies above 0 [Hz], an array of any shape.

    Returns
    -------
    ndarray
        Complex response [um/V], with the shape of ``frequencies``.

    Notes
    -----
    Source: exact zero-order hold discretization of :func:`head_state_space`.

    Examples
    --------
    Near half the sampling rate, aliasing and the hold change the response:

    >>> from hdd_servo_ros.drive import PlantParameters, frequency_response, sampled_frequency_response
    >>> drive, frequencies = PlantParameters(), [100.0, 4500.0]
    >>> ratio = abs(sampled_frequency_response(drive, 1e-4, frequencies) / frequency_response(drive, frequencies))
    >>> ratio.round(3).tolist()
    [1.0, 0.98]
    """
    a, b, c, d = head_state_space(parameters)
    discrete_a, discrete_b, _, _, _ = signal.cont2discrete((a, b, c, d), sample_time)
    z = np.exp(2.0j * np.pi * np.asarray(frequencies, dtype=np.float64) * sample_time)
    identity = np.eye(a.shape[0])
    own = discrete_b
    if parameters.input_delay > 0.0:
        # After the delay the voltage of this sample acts, before it that of the previous sample.
        rest = sample_time - parameters.input_delay
        own = signal.cont2discrete((a, b, c, d), rest)[1] if rest > 0.0 else np.zeros_like(b)
    previous = discrete_b - own
    responses = [
        c[0] @ np.linalg.solve(point * identity - discrete_a, own + previous / point)[:, 0] for point in np.ravel(z)
    ]
    result: npt.NDArray[np.complex128] = np.array(responses, dtype=np.complex128).reshape(np.shape(z))
    return result
