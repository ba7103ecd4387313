"""The drive of the loop: rigid body with pivot friction, resonances of the head, disturbance; one step a tick."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.lugre import lugre_force, lugre_level, lugre_substep
from hdd_servo_ros.drive.friction.parameters import MODELS, FrictionParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters, modal_form, mode_constants
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

# Places in the plant's constants
GAIN = 0
INERTIA = 1
CONTROL_LIMIT = 2
SUBSTEPS = 3
SUBSTEP = 4
SAMPLE_TIME = 5
DISTURBANCE = 6
DISTURBANCE_FREQUENCY = 7
R0 = 8
R1 = 9
MODES = 10
FRICTION_MODEL = 11
STIFFNESS = 12
BRISTLE_DAMPING = 13
VISCOUS = 14
COULOMB = 15
STATIC = 16
STRIBECK = 17
MODE_CONSTANTS = 18
"""Here the modes begin."""

MODE_HEADER = 8
"""Constants of a mode before those of its substeps."""

# Places in the plant's state
POSITION = 0
VELOCITY = 1
BRISTLE = 2
MEAN_FRICTION = 3
FRICTION = 4
MODE_STATES = 5
"""Here the modes' q and q' begin; the forces of the substeps follow them."""

MODEL_NONE = MODELS.index('none')
MODEL_LUGRE = MODELS.index('lugre')


@dataclass(frozen=True)
class DisturbanceParameters(ParameterSet):
    """The sinusoidal disturbance d(t) = d0 sin(w t) of section 4.4."""

    amplitude: float = parameter(0.0, 'amplitude d0 of the disturbance', unit='V')
    angular_frequency: float = parameter(20.0, 'angular frequency w of the disturbance', unit='rad/s', minimum=0.0)


@dataclass(frozen=True)
class PlantParameters(ParameterSet):
    """Parameters of the drive; the default is the Seagate 7200.10 of chapter 5."""

    gain: float = parameter(
        4.0968e7, 'acceleration of the rigid body per volt, k of (5.1), 1/m of (4.1)', unit='um/s^2/V', above=0.0
    )
    control_limit: float = parameter(10.0, 'largest control voltage u_max of (3.18)', unit='V', above=0.0)
    substeps: int = parameter(2, 'integration steps a sample', minimum=1, maximum=1024)
    initial_position: float = parameter(0.0, 'position of the rigid body at tick 0', unit='um')
    initial_velocity: float = parameter(0.0, 'velocity of the rigid body at tick 0', unit='um/s')
    length_unit: str = parameter('um', 'unit of length of this drive, for labels', read_only=True)
    control_unit: str = parameter('V', 'unit of the control signal of this drive, for labels', read_only=True)
    friction: FrictionParameters = group(FrictionParameters)
    resonance: ResonanceParameters = group(ResonanceParameters)
    disturbance: DisturbanceParameters = group(DisturbanceParameters)


class Plant:
    """
    The drive as a block: control voltage in, head position, head velocity and pivot friction out.

    The rigid body obeys m x'' + h + d = u (4.1), with m = 1/gain; the resonances shape what the head makes of its
    motion.

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

        The modes start at rest again when their number changes.
        """
        old = self.parameters
        state = plant_state(parameters)
        modes = int(self.constants[MODES])
        constants = plant_constants(parameters, self.sample_time)
        kept = MODE_STATES
        if int(constants[MODES]) == modes:
            kept += 2 * modes
        if parameters.friction.model != old.friction.model:
            kept = BRISTLE
        state[:kept] = self.state[:kept]
        self.parameters = parameters
        self.constants = constants
        self.state = state


def plant_constants(parameters: PlantParameters, sample_time: float) -> npt.NDArray[np.float64]:
    """Return the constants of the plant's kernel for a sample time [s]."""
    substep = sample_time / parameters.substeps
    friction = parameters.friction
    modal = modal_form(parameters.resonance)
    frequency = parameters.disturbance.angular_frequency / TWO_PI
    # The mean of a sinusoid over a substep is its middle value times sin(a)/a, a half the substep's angle.
    angle = 0.5 * parameters.disturbance.angular_frequency * substep
    mean = sine_cosine_of_turns(0.5 * frequency * substep)[0] / angle if angle > 0.0 else 1.0
    constants = [
        parameters.gain,
        1.0 / parameters.gain,
        parameters.control_limit,
        float(parameters.substeps),
        substep,
        sample_time,
        parameters.disturbance.amplitude * mean,
        frequency,
        modal.r0,
        modal.r1,
        float(len(modal.modes)),
        float(MODELS.index(friction.model)),
        friction.stiffness,
        friction.bristle_damping,
        friction.viscous_coefficient,
        friction.coulomb_level,
        friction.static_level,
        friction.stribeck_velocity,
    ]
    for mode in modal.modes:
        constants += mode_constants(mode, sample_time, parameters.substeps)
    return np.array(constants)


def plant_state(parameters: PlantParameters) -> npt.NDArray[np.float64]:
    """Return the plant's state at tick 0."""
    modes = len(modal_form(parameters.resonance).modes)
    state = np.zeros(MODE_STATES + 2 * modes + parameters.substeps)
    state[POSITION] = parameters.initial_position
    state[VELOCITY] = parameters.initial_velocity
    if parameters.friction.model == 'lugre':
        rate = parameters.friction.bristle_damping + parameters.friction.viscous_coefficient
        state[FRICTION] = rate * parameters.initial_velocity
    return state


@compiled
def plant_output(constants: npt.NDArray[np.float64], state: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Return head position [um], head velocity [um/s] and pivot friction [V] of a state."""
    substeps = int(constants[SUBSTEPS])
    position = constants[R0] * state[POSITION] + constants[R1] * state[VELOCITY]
    velocity = constants[R0] * state[VELOCITY]
    place = MODE_CONSTANTS
    for i in range(int(constants[MODES])):
        q = state[MODE_STATES + 2 * i]
        p = state[MODE_STATES + 2 * i + 1]
        position += constants[place + 4] * q + constants[place + 5] * p
        velocity += constants[place + 6] * q + constants[place + 7] * p
        place += MODE_HEADER + 2 * substeps
    return position, velocity, state[FRICTION]


@compiled
def plant_step(
    constants: npt.NDArray[np.float64],
    state: npt.NDArray[np.float64],
    tick: int,
    control: float,
    disturbance: float,
) -> tuple[float, float, float]:
    """Advance ``state`` from ``tick`` - 1 to ``tick``; see :meth:`Plant.step`."""
    limit = constants[CONTROL_LIMIT]
    if control > limit:
        control = limit
    elif control < -limit:
        control = -limit
    substeps = int(constants[SUBSTEPS])
    substep = constants[SUBSTEP]
    modes = int(constants[MODES])
    model = int(constants[FRICTION_MODEL])
    inertia = constants[INERTIA]
    amplitude = constants[DISTURBANCE]
    start = float(tick - 1) * constants[SAMPLE_TIME]
    position = state[POSITION]
    velocity = state[VELOCITY]
    bristle = state[BRISTLE]
    friction = state[MEAN_FRICTION]
    forces = MODE_STATES + 2 * modes
    held = control - disturbance
    for j in range(substeps):
        applied = held
        if amplitude != 0.0:
            turns = constants[DISTURBANCE_FREQUENCY] * (start + (float(j) + 0.5) * substep)
            applied -= amplitude * sine_cosine_of_turns(turns)[0]
        if model == MODEL_LUGRE:
            mean, bristle, friction = lugre_substep(
                substep,
                inertia,
                velocity,
                bristle,
                friction,
                applied,
                constants[STIFFNESS],
                constants[BRISTLE_DAMPING],
                constants[VISCOUS],
                constants[COULOMB],
                constants[STATIC],
                constants[STRIBECK],
            )
        else:
            mean = velocity + 0.5 * substep * constants[GAIN] * applied
            friction = 0.0
        position += substep * mean
        velocity = 2.0 * mean - velocity
        state[forces + j] = constants[GAIN] * (applied - friction)
    state[POSITION] = position
    state[VELOCITY] = velocity
    state[BRISTLE] = bristle
    state[MEAN_FRICTION] = friction
    if model == MODEL_LUGRE:
        level = lugre_level(velocity, constants[COULOMB], constants[STATIC], constants[STRIBECK])
        state[FRICTION] = lugre_force(
            velocity, bristle, constants[STIFFNESS], constants[BRISTLE_DAMPING], constants[VISCOUS], level
        )
    place = MODE_CONSTANTS
    for i in range(modes):
        q = state[MODE_STATES + 2 * i]
        p = state[MODE_STATES + 2 * i + 1]
        next_q = constants[place] * q + constants[place + 1] * p
        next_p = constants[place + 2] * q + constants[place + 3] * p
        place += MODE_HEADER
        for j in range(substeps):
            force = state[forces + j]
            next_q += constants[place] * force
            next_p += constants[place + 1] * force
            place += 2
        state[MODE_STATES + 2 * i] = next_q
        state[MODE_STATES + 2 * i + 1] = next_p
    return plant_output(constants, state)
