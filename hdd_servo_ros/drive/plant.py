"""
Drive model of the servo loop: actuator, rigid body with pivot friction, head resonances; one step per tick.

The rigid body obeys m x'' + h + d = u, thesis eq. (4.1), with m = 1/gain. It is integrated in substeps, with a
second-order scheme for each friction family. The resonances respond exactly to the mean acceleration of the rigid body
in each substep, and to its velocity jumps at the crash stops. A drive of modes alone has no rigid body: its modes
respond exactly to the mean force in each substep.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.electrical import DRIVER, back_emf_current, driver_force, electrical_constants
from hdd_servo_ros.drive.friction.dispatch import contact_after_change, friction_force, friction_substep
from hdd_servo_ros.drive.friction.parameters import FRICTION, FrictionParameters, friction_constants, friction_nodes
from hdd_servo_ros.drive.resonance import MODE, ResonanceParameters, modal_arrays, modal_form
from hdd_servo_ros.drive.substeps import contact_frequency, contact_warning, needed_substeps
from hdd_servo_ros.drive.temperature import TemperatureParameters, resonance_at
from hdd_servo_ros.drive.travel import (
    IMPACTS,
    STOPS,
    TRAVEL,
    StopImpacts,
    TravelParameters,
    count_impact,
    excite_modes,
    travel_constants,
    travel_substep,
)
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

Array = npt.NDArray[np.float64]
PlantArrays = tuple[Array, Array, Array, Array, Array, Array]
"""Constants, nodes of the friction network, modes, responses of the modes, state, motion of the modes."""

PLANT = layout(
    'gain',
    'control_limit',
    'substeps',
    'substep',
    'sample_time',
    'disturbance_amplitude',
    'disturbance_frequency',
    'r0',
    'r1',
    'has_rigid_body',
    'input_delay',
    'is_electrical',
    ('driver', DRIVER),
    ('friction', FRICTION),
    ('travel', TRAVEL),
)
"""
Constants of the plant kernel.

``input_delay`` is in substeps. ``disturbance_amplitude`` is the amplitude of the mean of the disturbance over a
substep; r0 and r1 are R0 and R1 of the modal form.
"""

PLANT_STATE = layout(
    'position',
    'velocity',
    'amplifier',
    'coil',
    'deflection',
    'mean_friction',
    'friction',
    ('impacts', IMPACTS),
    *(f'previous_{quarter}' for quarter in range(4)),
)
"""
Plant state without the modes.

Position x and velocity v of the rigid body, driver states b and c, deflection of the friction contact, mean friction of
the last substep, friction at the tick, the crash-stop impacts so far, and, for the input delay, the limited control
voltages of the last sample, one per quarter.
"""


@dataclass(frozen=True)
class DisturbanceParameters(ParameterSet):
    """Sinusoidal disturbance d(t) = d0 sin(w t) of thesis section 4.4, in the unit of the control signal."""

    amplitude: float = parameter(0.0, 'amplitude d0 of the sinusoidal disturbance', unit='V')
    angular_frequency: float = parameter(
        20.0, 'angular frequency w of the sinusoidal disturbance', unit='rad/s', minimum=0.0
    )


@dataclass(frozen=True)
class PlantParameters(ParameterSet):
    """
    Parameters of the drive; the defaults describe the Seagate 7200.10 of thesis chapter 5.

    Notes
    -----
    Source: thesis section 5.3. The friction is calibrated to the text on figs. 2.3 and 5.4; see
    ``docs/results/validation.md``.

    Examples
    --------
    A drive with viscous friction and without resonances:

    >>> from hdd_servo_ros.drive import PlantParameters
    >>> from hdd_servo_ros.parameters import from_mapping
    >>> drive = from_mapping(PlantParameters, {'friction.model': 'viscous', 'resonance.form': 'none'})
    >>> drive.gain, drive.friction.viscous_coefficient
    (40968000.0, 4.6e-06)
    """

    gain: float = parameter(
        4.0968e7,
        'acceleration of the rigid body per volt, k = 1/m; used with the reduced driver',
        unit='um/s^2/V',
        above=0.0,
        equation='4.1, 5.1',
    )
    control_limit: float = parameter(
        10.0, 'saturation limit u_max of the control voltage', unit='V', above=0.0, equation='3.18'
    )
    input_delay: float = parameter(
        0.0,
        'delay between the control voltage and the driver, at most one sample time; within a substep, the mean of the '
        'delayed voltage acts',
        unit='s',
        minimum=0.0,
        read_only=True,
    )
    substeps: int = parameter(
        4,
        'integration substeps per sample; 0 selects the number that the friction contact needs',
        minimum=0,
        maximum=1024,
    )
    initial_position: float = parameter(
        0.0, 'position of the rigid body at tick 0; with the form modes, that of the head by its first mode', unit='um'
    )
    initial_velocity: float = parameter(
        0.0,
        'velocity of the rigid body at tick 0; with the form modes, that of the head by its first mode',
        unit='um/s',
    )
    length_unit: str = parameter('um', 'length unit of this drive, for labels', read_only=True)
    control_unit: str = parameter('V', 'unit of the control signal of this drive, for labels', read_only=True)
    actuator: ActuatorParameters = group(ActuatorParameters)
    friction: FrictionParameters = group(FrictionParameters)
    resonance: ResonanceParameters = group(ResonanceParameters)
    temperature: TemperatureParameters = group(TemperatureParameters)
    travel: TravelParameters = group(TravelParameters)
    disturbance: DisturbanceParameters = group(DisturbanceParameters)

    def check_together(self) -> None:
        """Check that the rigid body starts between the crash stops, and that a drive of modes alone needs no body."""
        resonance_at(self.resonance, self.temperature)
        if not self.resonance.has_rigid_body:
            self._check_without_rigid_body()
        travel = self.travel
        if travel.is_limited and not travel.lower <= self.initial_position <= travel.upper:
            raise ParameterError(
                'initial_position',
                self.initial_position,
                f'a position between the crash stops at {travel.lower!r} um and {travel.upper!r} um',
            )

    def _check_without_rigid_body(self) -> None:
        """Reject what acts on a rigid body or is driven by its velocity."""
        because = 'because resonance.form is modes, which has no rigid body'
        if self.friction.model != 'none':
            raise ParameterError('friction.model', self.friction.model, f'none, {because}')
        if self.travel.is_limited:
            limit = 'lower' if self.travel.lower != 0.0 else 'upper'
            raise ParameterError(f'travel.{limit}', getattr(self.travel, limit), f'0 [um] (no crash stop), {because}')
        if self.actuator.is_electrical and self.actuator.back_emf_constant != 0.0:
            raise ParameterError(
                'actuator.back_emf_constant', self.actuator.back_emf_constant, f'0 [V s/rad], {because}'
            )
        for name in ('initial_position', 'initial_velocity'):
            if getattr(self, name) != 0.0 and self.resonance.residues[0] == 0.0:
                raise ParameterError(name, getattr(self, name), '0, because the residue of the first mode is 0')

    @property
    def rigid_gain(self) -> float:
        """
        Return the acceleration of the rigid body per volt [um/s^2/V], from ``gain`` or from the actuator data.

        With the resonance form ``modes`` it is the factor k of the sum of the modes.
        """
        return self.gain if self.actuator.driver == 'reduced' else self.actuator.gain

    @property
    def resonance_at_temperature(self) -> ResonanceParameters:
        """Return the resonances with the factors of the temperature."""
        return resonance_at(self.resonance, self.temperature)

    def substeps_at(self, sample_time: float) -> int:
        """Return the substeps per sample time [s]: as given, or the number that the friction contact needs."""
        return self.substeps or needed_substeps(contact_frequency(self.rigid_gain, self.friction), sample_time)


class Plant:
    """
    Drive block with the control voltage as input and head position, head velocity and pivot friction as outputs.

    Parameters
    ----------
    parameters
        The drive.
    sample_time
        T [s].
    is_multirate
        Whether u may change at the quarters of a sample. The number of substeps is then rounded up to a multiple of
        four.

    Raises
    ------
    ParameterError
        If the sample time is not positive.

    Notes
    -----
    Source: thesis eqs. (4.1), (5.1) to (5.5); friction from chapter 2, actuator from chapter 3.

    Examples
    --------
    Apply 50 mV to the default drive for 1 ms; position [um], velocity [um/s] and friction [V] at the last tick:

    >>> from hdd_servo_ros.drive import Plant, PlantParameters
    >>> plant = Plant(PlantParameters(), sample_time=1e-4)
    >>> for tick in range(1, 11):
    ...     position, velocity, friction = plant.step(tick, 0.05)
    >>> round(position, 6), round(velocity, 3), round(friction, 6)
    (0.864987, 1546.322, 0.027781)
    """

    def __init__(self, parameters: PlantParameters, sample_time: float, *, is_multirate: bool = False) -> None:
        if not 0.0 < sample_time < np.inf:
            raise ParameterError('sample_time', sample_time, 'above 0 [s]')
        self.sample_time = sample_time
        self.is_multirate = is_multirate
        self.parameters = parameters
        self.state = zeros(PLANT_STATE)
        self.motion: Array = np.zeros((0, 2))
        state = record(self.state, PLANT_STATE)
        if parameters.resonance.has_rigid_body:
            state.position = parameters.initial_position
            state.velocity = parameters.initial_velocity
        self.update(parameters)
        if not parameters.resonance.has_rigid_body and parameters.resonance.residues[0] != 0.0:
            residue = parameters.resonance.residues[0]
            self.motion[0] = parameters.initial_position / residue, parameters.initial_velocity / residue

    def output(self) -> tuple[float, float, float]:
        """Return head position [um], head velocity [um/s] and pivot friction [V] at the current tick."""
        return plant_output(*self.arrays)

    def step(
        self,
        tick: int,
        control: float,
        disturbance: float = 0.0,
        later_voltages: tuple[float, float, float] | None = None,
    ) -> tuple[float, float, float]:
        """
        Advance from ``tick`` - 1 to ``tick`` and return the output at ``tick``.

        Parameters
        ----------
        tick
            Number k of the tick at the end of the step, at least 1.
        control
            Control voltage u held over [(k-1)T, kT) [V], later by the input delay; the plant saturates it at the
            control limit.
        disturbance
            External part of d held over the same interval [V]; like d of eq. (4.1) it acts against u.
        later_voltages
            For a multirate drive, the control voltages from one quarter, half and three quarters of the interval on
            [V]; ``control`` is then that of the first quarter.

        Raises
        ------
        ValueError
            If there are later voltages but the drive is not multirate.
        """
        if later_voltages is None:
            return plant_step(*self.arrays, tick, control, disturbance)
        if not self.is_multirate:
            raise ValueError('later_voltages: expected None, because this drive is not multirate')
        return multirate_plant_step(*self.arrays, tick, control, *later_voltages, disturbance)

    @property
    def impacts(self) -> dict[str, StopImpacts]:
        """Impacts so far on each crash stop that was hit, by name (``lower`` or ``upper``)."""
        counted = record(self.state, PLANT_STATE).impacts
        return {
            name: StopImpacts(
                int(counted[name].count), int(counted[name].first_tick), float(counted[name].largest_speed)
            )
            for name in STOPS
            if counted[name].count
        }

    def impact_warnings(self) -> dict[str, str]:
        """Return a warning for each crash stop that was hit, by name (``lower`` or ``upper``)."""
        travel = self.parameters.travel
        limits = {'lower': travel.lower, 'upper': travel.upper}
        unit = self.parameters.length_unit
        return {
            name: f'the actuator hits the {name} crash stop at {limits[name]:g} {unit} by tick {found.first_tick}; '
            'further impacts are counted, not logged'
            for name, found in self.impacts.items()
        }

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings about these parameters, for the log at the start of a run."""
        p = self.parameters
        frequency = contact_frequency(p.rigid_gain, p.friction)
        line = contact_warning(frequency, self.sample_time, p.substeps_at(self.sample_time))
        return (line,) if line else ()

    def update(self, parameters: PlantParameters) -> None:
        """
        Change the parameters and continue from the current state.

        The friction contact keeps its deflection, limited to the largest that the new parameters allow. It restarts at
        zero deflection when the friction model changes; the modes restart at rest when their number changes. The
        friction in the output is recomputed with the new parameters. ``arrays`` holds the new constants afterward.
        """
        is_same_model = parameters.friction.model == self.parameters.friction.model
        self.parameters = parameters
        if parameters.input_delay > self.sample_time:
            raise ParameterError(
                'input_delay', parameters.input_delay, f'at most sample_time = {self.sample_time!r} [s]'
            )
        substeps = parameters.substeps_at(self.sample_time)
        if self.is_multirate:
            substeps = multirate_substeps(substeps)
        self.constants = plant_constants(parameters, self.sample_time, substeps)
        self.nodes = friction_nodes(parameters.friction)
        modal = modal_form(parameters.resonance_at_temperature)
        self.modes, self.responses = modal_arrays(modal, self.sample_time, substeps)
        if len(self.motion) != len(self.modes):
            self.motion = np.zeros((len(self.modes), 2))
        self.arrays: PlantArrays = (self.constants, self.nodes, self.modes, self.responses, self.state, self.motion)
        friction = record(self.constants, PLANT).friction
        state = record(self.state, PLANT_STATE)
        state.deflection, state.mean_friction = contact_after_change(
            friction, is_same_model, float(state.velocity), float(state.deflection), float(state.mean_friction)
        )
        state.friction = friction_force(
            friction, self.nodes, state.position, state.velocity, state.deflection, state.mean_friction
        )


def multirate_substeps(substeps: int) -> int:
    """Return a number of substeps rounded up so that each quarter of a sample has a whole number of substeps."""
    return -(-substeps // 4) * 4


def plant_constants(parameters: PlantParameters, sample_time: float, substeps: int) -> Array:
    """Return the constants of the plant kernel for a sample time [s] and substeps, in the layout :data:`PLANT`."""
    substep = sample_time / substeps
    modal = modal_form(parameters.resonance_at_temperature)
    disturbance = parameters.disturbance
    frequency = disturbance.angular_frequency / TWO_PI
    # The mean of a sinusoid over a substep is its value at the midpoint times sin(a)/a, with a = half the phase angle
    # of a substep.
    angle = 0.5 * disturbance.angular_frequency * substep
    mean = sine_cosine_of_turns(0.5 * frequency * substep)[0] / angle if angle > 0.0 else 1.0
    constants = zeros(PLANT)
    plant = record(constants, PLANT)
    plant.gain = parameters.rigid_gain
    plant.control_limit = parameters.control_limit
    plant.substeps = substeps
    plant.substep = substep
    plant.sample_time = sample_time
    plant.disturbance_amplitude = disturbance.amplitude * mean
    plant.disturbance_frequency = frequency
    plant.r0 = modal.r0
    plant.r1 = modal.r1
    plant.input_delay = parameters.input_delay / substep
    plant.has_rigid_body = float(parameters.resonance.has_rigid_body)
    if parameters.actuator.is_electrical:
        plant.is_electrical = 1.0
        plant.driver = record(electrical_constants(parameters.actuator, substep), DRIVER)
    plant.friction = record(friction_constants(parameters.friction), FRICTION)
    plant.travel = record(travel_constants(parameters.travel), TRAVEL)
    return constants


@compiled
def plant_output(
    constants: Array, nodes: Array, modes: Array, responses: Array, state: Array, motion: Array
) -> tuple[float, float, float]:
    """Return head position [um], head velocity [um/s] and pivot friction [V] for a plant state."""
    c = record(constants, PLANT)
    s = record(state, PLANT_STATE)
    position = c.r0 * s.position + c.r1 * s.velocity
    velocity = c.r0 * s.velocity
    for i in range(len(motion)):
        mode = record(modes, MODE, i)
        q, rate = motion[i, 0], motion[i, 1]
        position += mode.position_of_q * q + mode.position_of_rate * rate
        velocity += mode.velocity_of_q * q + mode.velocity_of_rate * rate
    return position, velocity, s.friction


@compiled
def plant_step(
    constants: Array,
    nodes: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    control: float,
    disturbance: float,
) -> tuple[float, float, float]:
    """Advance ``state`` and ``motion`` from ``tick`` - 1 to ``tick``; see :meth:`Plant.step`."""
    c = record(constants, PLANT)
    if c.has_rigid_body == 0.0:
        voltages = (control, control, control, control)
        _modal_sample(constants, modes, responses, state, motion, tick, voltages, disturbance)
    elif c.travel.is_limited != 0.0:
        _limited_sample(constants, nodes, modes, responses, state, motion, tick, control, disturbance)
    else:
        voltages = (control, control, control, control)
        _sample(constants, nodes, modes, responses, state, motion, tick, voltages, disturbance, False, False)
    return plant_output(constants, nodes, modes, responses, state, motion)


@compiled_apart
def multirate_plant_step(
    constants: Array,
    nodes: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    control: float,
    quarter: float,
    half: float,
    three_quarters: float,
    disturbance: float,
) -> tuple[float, float, float]:
    """Advance a multirate drive; see :meth:`Plant.step`. Not inlined, because most drives are not multirate."""
    c = record(constants, PLANT)
    voltages = (control, quarter, half, three_quarters)
    if c.has_rigid_body == 0.0:
        _modal_sample(constants, modes, responses, state, motion, tick, voltages, disturbance)
    else:
        is_limited = c.travel.is_limited != 0.0
        _sample(constants, nodes, modes, responses, state, motion, tick, voltages, disturbance, is_limited, True)
    return plant_output(constants, nodes, modes, responses, state, motion)


@compiled_apart
def _modal_sample(
    constants: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    voltages: tuple[float, float, float, float],
    disturbance: float,
) -> None:
    """Advance a drive of modes alone; its modes respond to the mean force of each substep."""
    c = record(constants, PLANT)
    s = record(state, PLANT_STATE)
    substep = c.substep
    start = float(tick - 1) * c.sample_time
    _free_motion(modes, motion)
    for j in range(int(c.substeps)):
        applied = _delayed(c, s, voltages, j)
        if c.is_electrical != 0.0:
            s.amplifier, s.coil, applied = driver_force(c.driver, applied, s.amplifier, s.coil)
        applied -= disturbance
        if c.disturbance_amplitude != 0.0:
            turns = c.disturbance_frequency * (start + (float(j) + 0.5) * substep)
            applied -= c.disturbance_amplitude * sine_cosine_of_turns(turns)[0]
        _drive_modes(responses, j, c.gain * applied, motion)
    _keep(c, s, voltages)
    s.friction = 0.0


@compiled_apart
def _limited_sample(
    constants: Array,
    nodes: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    control: float,
    disturbance: float,
) -> None:
    """Advance a drive with crash stops; not inlined, so that a drive without them does not compile their code."""
    voltages = (control, control, control, control)
    _sample(constants, nodes, modes, responses, state, motion, tick, voltages, disturbance, True, False)


@compiled
def _sample(
    constants: Array,
    nodes: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    voltages: tuple[float, float, float, float],
    disturbance: float,
    is_limited: bool,
    is_multirate: bool,
) -> None:
    """
    Advance a drive.

    ``is_limited`` and ``is_multirate`` are constants where this is inlined, so each case compiles to its own loop.
    """
    c = record(constants, PLANT)
    s = record(state, PLANT_STATE)
    control = min(max(voltages[0], -c.control_limit), c.control_limit)
    substep = c.substep
    start = float(tick - 1) * c.sample_time
    position, velocity = s.position, s.velocity
    amplifier, coil = s.amplifier, s.coil
    deflection, mean_friction = s.deflection, s.mean_friction
    velocity_jump = 0.0
    _free_motion(modes, motion)
    for j in range(int(c.substeps)):
        if is_multirate:
            control = min(max(voltages[4 * j // int(c.substeps)], -c.control_limit), c.control_limit)
        applied = control
        if c.input_delay != 0.0:
            applied = _delayed(c, s, voltages, j)
        drag = 0.0
        if c.is_electrical != 0.0:
            amplifier, coil, applied = driver_force(c.driver, applied, amplifier, coil)
            drag = c.driver.mean_back_emf
        applied -= disturbance
        if c.disturbance_amplitude != 0.0:
            turns = c.disturbance_frequency * (start + (float(j) + 0.5) * substep)
            applied -= c.disturbance_amplitude * sine_cosine_of_turns(turns)[0]
        previous_position = position
        previous_velocity = velocity
        if is_limited:
            position, velocity, deflection, mean_friction, contact, velocity_jump, speed = travel_substep(
                c.travel,
                c.friction,
                nodes,
                substep,
                c.gain,
                position,
                velocity,
                deflection,
                mean_friction,
                applied,
                drag,
            )
            if speed != 0.0:
                count_impact(s.impacts, tick, speed)
            if velocity_jump != 0.0:
                excite_modes(modes, (c.substeps - float(j)) * substep - contact, velocity_jump, motion)
        else:
            position, velocity, deflection, mean_friction = friction_substep(
                c.friction, nodes, substep, c.gain, position, velocity, deflection, mean_friction, applied, drag
            )
        if c.is_electrical != 0.0:
            coil -= back_emf_current(c.driver, (position - previous_position) / substep)
        gained = velocity - previous_velocity
        if is_limited:
            gained -= velocity_jump
        _drive_modes(responses, j, gained / substep, motion)
    if c.input_delay != 0.0:
        _keep(c, s, voltages)
    s.position, s.velocity = position, velocity
    s.amplifier, s.coil = amplifier, coil
    s.deflection, s.mean_friction = deflection, mean_friction
    s.friction = friction_force(c.friction, nodes, position, velocity, deflection, mean_friction)


@compiled
def _voltage(c: np.record, s: np.record, voltages: tuple[float, float, float, float], i: int) -> float:
    """Return the limited voltage of substep ``i`` without the delay; below 0, a substep of the last sample."""
    substeps = int(c.substeps)
    if i >= 0:
        limited: float = min(max(voltages[4 * i // substeps], -c.control_limit), c.control_limit)
        return limited
    quarter = 4 * (i + substeps) // substeps
    if quarter <= 0:
        return float(s.previous_0)
    if quarter == 1:
        return float(s.previous_1)
    if quarter == 2:
        return float(s.previous_2)
    return float(s.previous_3)


@compiled
def _delayed(c: np.record, s: np.record, voltages: tuple[float, float, float, float], j: int) -> float:
    """Return the mean voltage of substep ``j`` after the input delay."""
    whole = int(c.input_delay)
    share = c.input_delay - float(whole)
    voltage = _voltage(c, s, voltages, j - whole)
    if share == 0.0:
        return voltage
    mean: float = share * _voltage(c, s, voltages, j - whole - 1) + (1.0 - share) * voltage
    return mean


@compiled
def _keep(c: np.record, s: np.record, voltages: tuple[float, float, float, float]) -> None:
    """Keep the limited voltages of this sample for the input delay."""
    s.previous_0 = min(max(voltages[0], -c.control_limit), c.control_limit)
    s.previous_1 = min(max(voltages[1], -c.control_limit), c.control_limit)
    s.previous_2 = min(max(voltages[2], -c.control_limit), c.control_limit)
    s.previous_3 = min(max(voltages[3], -c.control_limit), c.control_limit)


@compiled
def _free_motion(modes: Array, motion: Array) -> None:
    """Advance the modes over a sample without excitation."""
    for i in range(len(motion)):
        mode = record(modes, MODE, i)
        q, rate = motion[i, 0], motion[i, 1]
        motion[i, 0] = mode.a11 * q + mode.a12 * rate
        motion[i, 1] = mode.a21 * q + mode.a22 * rate


@compiled
def _drive_modes(responses: Array, j: int, acceleration: float, motion: Array) -> None:
    """Add the response of the modes at the end of the sample to an acceleration [um/s^2] during substep ``j``."""
    for i in range(len(motion)):
        motion[i, 0] += responses[j, i, 0] * acceleration
        motion[i, 1] += responses[j, i, 1] * acceleration
