"""
The drive of the loop: actuator, rigid body with pivot friction, resonances of the head; one step a tick.

The rigid body obeys m x'' + h + d = u (4.1) with m = 1/gain. It is integrated in substeps, each friction family by its
own second-order step; the resonances follow the rigid body's mean acceleration of each substep exactly.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive import electrical
from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.electrical import back_emf_current, driver_force, electrical_constants
from hdd_servo_ros.drive.friction import parameters as friction_places
from hdd_servo_ros.drive.friction.dahl import dahl_substep
from hdd_servo_ros.drive.friction.elastoplastic import elastoplastic_friction, elastoplastic_substep, slip_terms
from hdd_servo_ros.drive.friction.lugre import lugre_friction, lugre_level, lugre_substep, position_factor
from hdd_servo_ros.drive.friction.network import network_friction, network_substep
from hdd_servo_ros.drive.friction.parameters import (
    COMPLETE,
    DAHL,
    LUGRE,
    LUGRE_POSITION,
    NETWORK,
    NO_FRICTION,
    TANGENTIAL_STIFFNESS,
    FrictionParameters,
    friction_constants,
)
from hdd_servo_ros.drive.friction.static import static_friction, static_substep
from hdd_servo_ros.drive.resonance import ResonanceParameters, modal_form, mode_constants
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

PlantArrays = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]

# Places in the plant's constants
GAIN = 0
CONTROL_LIMIT = 1
SUBSTEPS = 2
SUBSTEP = 3
SAMPLE_TIME = 4
DISTURBANCE = 5
DISTURBANCE_FREQUENCY = 6
R0 = 7
R1 = 8
MODES = 9
MODE_PLACE = 10
ELECTRICAL = 11
"""1 with a driver's electrical dynamics, else 0; their constants begin one place on."""
ELECTRICAL_CONSTANTS = 12
FRICTION_CONSTANTS = ELECTRICAL_CONSTANTS + electrical.COUNT

STIFFNESS = FRICTION_CONSTANTS + friction_places.STIFFNESS
BRISTLE_DAMPING = FRICTION_CONSTANTS + friction_places.BRISTLE_DAMPING
VISCOUS = FRICTION_CONSTANTS + friction_places.VISCOUS
COULOMB = FRICTION_CONSTANTS + friction_places.COULOMB
STATIC = FRICTION_CONSTANTS + friction_places.STATIC
INVERSE_STRIBECK = FRICTION_CONSTANTS + friction_places.INVERSE_STRIBECK
DAHL_EXPONENT = FRICTION_CONSTANTS + friction_places.DAHL_EXPONENT
RIPPLE = FRICTION_CONSTANTS + friction_places.RIPPLE
INVERSE_PERIOD = FRICTION_CONSTANTS + friction_places.INVERSE_PERIOD
BRISTLE_LIMIT = FRICTION_CONSTANTS + friction_places.BRISTLE_LIMIT
MEAN_BACK_EMF = ELECTRICAL_CONSTANTS + electrical.MEAN_BACK_EMF

MODE_HEADER = 8
"""Constants of a mode before those of its substeps."""

# Places in the plant's state
POSITION = 0
VELOCITY = 1
AMPLIFIER = 2
COIL = 3
DEFLECTION = 4
MEAN_FRICTION = 5
FRICTION = 6
MODE_STATES = 7
"""Here the modes' q and q' begin; the accelerations of the substeps follow them."""


@dataclass(frozen=True)
class DisturbanceParameters(ParameterSet):
    """The sinusoidal disturbance d(t) = d0 sin(w t) of section 4.4, in the control's unit."""

    amplitude: float = parameter(0.0, 'amplitude d0 of the disturbance', unit='V')
    angular_frequency: float = parameter(20.0, 'angular frequency w of the disturbance', unit='rad/s', minimum=0.0)


@dataclass(frozen=True)
class PlantParameters(ParameterSet):
    """Parameters of the drive; the default is the Seagate 7200.10 of chapter 5."""

    gain: float = parameter(
        4.0968e7,
        'acceleration of the rigid body per volt, k of (5.1), 1/m of (4.1); read with the reduced driver',
        unit='um/s^2/V',
        above=0.0,
    )
    control_limit: float = parameter(10.0, 'largest control voltage u_max of (3.18)', unit='V', above=0.0)
    substeps: int = parameter(4, 'integration steps a sample', minimum=1, maximum=1024)
    initial_position: float = parameter(0.0, 'position of the rigid body at tick 0', unit='um')
    initial_velocity: float = parameter(0.0, 'velocity of the rigid body at tick 0', unit='um/s')
    length_unit: str = parameter('um', 'unit of length of this drive, for labels', read_only=True)
    control_unit: str = parameter('V', 'unit of the control signal of this drive, for labels', read_only=True)
    actuator: ActuatorParameters = group(ActuatorParameters)
    friction: FrictionParameters = group(FrictionParameters)
    resonance: ResonanceParameters = group(ResonanceParameters)
    disturbance: DisturbanceParameters = group(DisturbanceParameters)

    @property
    def rigid_gain(self) -> float:
        """Return the acceleration per volt of the rigid body [um/s^2/V], from whichever the driver makes the source."""
        return self.gain if self.actuator.driver == 'reduced' else self.actuator.gain


class Plant:
    """
    The drive as a block: control voltage in; head position, head velocity and pivot friction out.

    Parameters
    ----------
    parameters
        The drive.
    sample_time
        T [s].

    Raises
    ------
    ParameterError
        If the sample time is not positive.
    """

    def __init__(self, parameters: PlantParameters, sample_time: float) -> None:
        if not 0.0 < sample_time < np.inf:
            raise ParameterError('sample_time', sample_time, 'above 0 [s]')
        self.sample_time = sample_time
        self.parameters = parameters
        self.constants = plant_constants(parameters, sample_time)
        self.state = plant_state(parameters)

    @property
    def arrays(self) -> PlantArrays:
        """The arrays that the kernels take first: constants and state."""
        return self.constants, self.state

    def output(self) -> tuple[float, float, float]:
        """Return head position [um], head velocity [um/s] and pivot friction [V] at the present tick."""
        return plant_output(self.constants, self.state)

    def step(self, tick: int, control: float, disturbance: float = 0.0) -> tuple[float, float, float]:
        """
        Advance from ``tick`` - 1 to ``tick`` and return the output there.

        Parameters
        ----------
        tick
            Number k of the tick at the end of the step, at least 1.
        control
            u held over [(k-1)T, kT) [V]; saturated at the control limit here.
        disturbance
            External part of d held over the same time [V]; like d of (4.1) it acts against u.
        """
        return plant_step(self.constants, self.state, tick, control, disturbance)

    def update(self, parameters: PlantParameters) -> None:
        """
        Go on under other parameters from the present state.

        The contact keeps its deflection, up to what the new parameters let it bear; it starts at zero again when the
        friction model changes, as the modes start at rest when their number changes. The friction of the output is
        that of the new parameters. ``constants`` and ``state`` are new arrays afterwards.
        """
        constants = plant_constants(parameters, self.sample_time)
        state = plant_state(parameters)
        modes = int(constants[MODES])
        kept = MODE_STATES + 2 * modes if modes == int(self.constants[MODES]) else MODE_STATES
        state[:kept] = self.state[:kept]
        if parameters.friction.model != self.parameters.friction.model:
            state[[DEFLECTION, MEAN_FRICTION]] = 0.0
        limit = _deflection_limit(constants, float(state[VELOCITY]))
        state[DEFLECTION] = min(max(state[DEFLECTION], -limit), limit)
        state[FRICTION] = _friction(
            constants, FRICTION_CONSTANTS, state[POSITION], state[VELOCITY], state[DEFLECTION], state[MEAN_FRICTION]
        )
        self.parameters = parameters
        self.constants = constants
        self.state = state


def plant_constants(parameters: PlantParameters, sample_time: float) -> npt.NDArray[np.float64]:
    """Return the constants of the plant's kernel for a sample time [s]."""
    substep = sample_time / parameters.substeps
    modal = modal_form(parameters.resonance)
    disturbance = parameters.disturbance
    frequency = disturbance.angular_frequency / TWO_PI
    # The mean of a sinusoid over a substep is its middle value times sin(a)/a, a half the substep's angle.
    angle = 0.5 * disturbance.angular_frequency * substep
    mean = sine_cosine_of_turns(0.5 * frequency * substep)[0] / angle if angle > 0.0 else 1.0
    friction = friction_constants(parameters.friction)
    constants = [
        parameters.rigid_gain,
        parameters.control_limit,
        float(parameters.substeps),
        substep,
        sample_time,
        disturbance.amplitude * mean,
        frequency,
        modal.r0,
        modal.r1,
        float(len(modal.modes)),
        float(FRICTION_CONSTANTS + len(friction)),
    ]
    if not parameters.actuator.is_electrical:
        constants += [0.0] * (1 + electrical.COUNT)
    else:
        constants += [1.0, *electrical_constants(parameters.actuator, substep)]
    constants += friction
    for mode in modal.modes:
        constants += mode_constants(mode, sample_time, parameters.substeps)
    return np.array(constants)


def plant_state(parameters: PlantParameters) -> npt.NDArray[np.float64]:
    """Return the plant's state at tick 0: the contact undeflected, the modes and currents at rest."""
    modes = len(modal_form(parameters.resonance).modes)
    state = np.zeros(MODE_STATES + 2 * modes + parameters.substeps)
    state[POSITION] = parameters.initial_position
    state[VELOCITY] = parameters.initial_velocity
    friction = np.array(friction_constants(parameters.friction))
    state[FRICTION] = _friction(friction, 0, parameters.initial_position, parameters.initial_velocity, 0.0, 0.0)
    return state


def _deflection_limit(constants: npt.NDArray[np.float64], velocity: float) -> float:
    """Return the largest deflection [um] that the contact of the friction model bears at a velocity [um/s]."""
    model = int(constants[FRICTION_CONSTANTS])
    if model == DAHL:
        return float(constants[COULOMB] / constants[STIFFNESS])
    if model in (TANGENTIAL_STIFFNESS, COMPLETE):
        return float(slip_terms(constants, FRICTION_CONSTANTS, abs(velocity))[0] / constants[STIFFNESS])
    return float(constants[BRISTLE_LIMIT])


@compiled
def _friction(
    constants: npt.NDArray[np.float64],
    place: int,
    position: float,
    velocity: float,
    deflection: float,
    mean_friction: float,
) -> float:
    """Return the friction [V] at a state of the rigid body; ``mean_friction`` holds a static model at rest."""
    model = int(constants[place])
    if model in (LUGRE, LUGRE_POSITION):
        level = lugre_level(
            velocity,
            constants[place + friction_places.COULOMB],
            constants[place + friction_places.STATIC],
            constants[place + friction_places.INVERSE_STRIBECK],
        )
        if model == LUGRE_POSITION:
            level *= position_factor(
                position, constants[place + friction_places.RIPPLE], constants[place + friction_places.INVERSE_PERIOD]
            )
        return lugre_friction(
            velocity,
            deflection,
            constants[place + friction_places.STIFFNESS],
            constants[place + friction_places.BRISTLE_DAMPING],
            constants[place + friction_places.VISCOUS],
            level,
        )
    if model == NO_FRICTION:
        return 0.0
    if model == DAHL:
        stiffness: float = constants[place + friction_places.STIFFNESS]
        return stiffness * deflection
    if model in (TANGENTIAL_STIFFNESS, COMPLETE):
        return elastoplastic_friction(constants, place, velocity, deflection)
    if model == NETWORK:
        return network_friction(constants, place, position, velocity)
    return static_friction(constants, place, velocity, mean_friction)


@compiled
def plant_output(constants: npt.NDArray[np.float64], state: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Return head position [um], head velocity [um/s] and pivot friction [V] of a state."""
    row = MODE_HEADER + 2 * int(constants[SUBSTEPS])
    position = constants[R0] * state[POSITION] + constants[R1] * state[VELOCITY]
    velocity = constants[R0] * state[VELOCITY]
    place = int(constants[MODE_PLACE])
    for i in range(int(constants[MODES])):
        q = state[MODE_STATES + 2 * i]
        p = state[MODE_STATES + 2 * i + 1]
        position += constants[place + 4] * q + constants[place + 5] * p
        velocity += constants[place + 6] * q + constants[place + 7] * p
        place += row
    return position, velocity, state[FRICTION]


@compiled
def _rigid_substep(
    constants: npt.NDArray[np.float64],
    position: float,
    velocity: float,
    deflection: float,
    friction: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float, float]:
    """Return position, velocity, deflection and mean friction after one substep, by the friction's own scheme."""
    model = int(constants[FRICTION_CONSTANTS])
    substep = constants[SUBSTEP]
    gain = constants[GAIN]
    if model in (LUGRE, LUGRE_POSITION):
        factor = 1.0
        if model == LUGRE_POSITION:
            middle = position + 0.5 * substep * velocity
            factor = position_factor(middle, constants[RIPPLE], constants[INVERSE_PERIOD])
        mean, deflection, friction = lugre_substep(
            substep,
            gain,
            velocity,
            deflection,
            friction,
            applied,
            drag,
            constants[STIFFNESS],
            constants[BRISTLE_DAMPING],
            constants[VISCOUS],
            constants[COULOMB],
            constants[STATIC],
            constants[INVERSE_STRIBECK],
            factor,
            constants[BRISTLE_LIMIT],
        )
    elif model == NO_FRICTION:
        mean = (2.0 * velocity + gain * substep * applied) / (2.0 + gain * substep * drag)
    elif model == DAHL:
        stiffness = constants[STIFFNESS]
        mean, force, friction = dahl_substep(
            substep,
            gain,
            velocity,
            stiffness * deflection,
            friction,
            applied,
            drag,
            stiffness,
            constants[COULOMB],
            constants[DAHL_EXPONENT],
        )
        deflection = force / stiffness
    elif model in (TANGENTIAL_STIFFNESS, COMPLETE):
        mean, deflection, friction = elastoplastic_substep(
            constants, FRICTION_CONSTANTS, substep, gain, velocity, deflection, friction, applied, drag
        )
    elif model == NETWORK:
        mean, friction = network_substep(
            constants, FRICTION_CONSTANTS, substep, gain, position, velocity, friction, applied, drag
        )
    else:
        position, velocity, friction = static_substep(
            constants, FRICTION_CONSTANTS, substep, gain, position, velocity, applied, drag
        )
        return position, velocity, deflection, friction
    return position + substep * mean, 2.0 * mean - velocity, deflection, friction


@compiled
def plant_step(
    constants: npt.NDArray[np.float64],
    state: npt.NDArray[np.float64],
    tick: int,
    control: float,
    disturbance: float,
) -> tuple[float, float, float]:
    """Advance ``state`` from ``tick`` - 1 to ``tick``; see :meth:`Plant.step`."""
    control = min(max(control, -constants[CONTROL_LIMIT]), constants[CONTROL_LIMIT])
    substeps = int(constants[SUBSTEPS])
    substep = constants[SUBSTEP]
    modes = int(constants[MODES])
    is_electrical = constants[ELECTRICAL] != 0.0
    start = float(tick - 1) * constants[SAMPLE_TIME]
    position = state[POSITION]
    velocity = state[VELOCITY]
    amplifier = state[AMPLIFIER]
    coil = state[COIL]
    deflection = state[DEFLECTION]
    friction = state[MEAN_FRICTION]
    accelerations = MODE_STATES + 2 * modes
    for j in range(substeps):
        applied = control
        drag = 0.0
        if is_electrical:
            amplifier, coil, applied = driver_force(constants, ELECTRICAL_CONSTANTS, control, amplifier, coil)
            drag = constants[MEAN_BACK_EMF]
        applied -= disturbance
        if constants[DISTURBANCE] != 0.0:
            turns = constants[DISTURBANCE_FREQUENCY] * (start + (float(j) + 0.5) * substep)
            applied -= constants[DISTURBANCE] * sine_cosine_of_turns(turns)[0]
        previous_position = position
        previous_velocity = velocity
        position, velocity, deflection, friction = _rigid_substep(
            constants, position, velocity, deflection, friction, applied, drag
        )
        if is_electrical:
            coil -= back_emf_current(constants, ELECTRICAL_CONSTANTS, (position - previous_position) / substep)
        state[accelerations + j] = (velocity - previous_velocity) / substep
    state[POSITION] = position
    state[VELOCITY] = velocity
    state[AMPLIFIER] = amplifier
    state[COIL] = coil
    state[DEFLECTION] = deflection
    state[MEAN_FRICTION] = friction
    state[FRICTION] = _friction(constants, FRICTION_CONSTANTS, position, velocity, deflection, friction)
    place = int(constants[MODE_PLACE])
    for i in range(modes):
        q = state[MODE_STATES + 2 * i]
        p = state[MODE_STATES + 2 * i + 1]
        next_q = constants[place] * q + constants[place + 1] * p
        next_p = constants[place + 2] * q + constants[place + 3] * p
        place += MODE_HEADER
        for j in range(substeps):
            acceleration = state[accelerations + j]
            next_q += constants[place] * acceleration
            next_p += constants[place + 1] * acceleration
            place += 2
        state[MODE_STATES + 2 * i] = next_q
        state[MODE_STATES + 2 * i + 1] = next_p
    return plant_output(constants, state)
