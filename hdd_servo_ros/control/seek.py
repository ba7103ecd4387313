"""Seek and settle around a controller that follows: trajectories to new targets, with their feedforward."""

import dataclasses
import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.cnf import CNF_STATE, cnf_constants
from hdd_servo_ros.control.observer import OBSERVER, standing_bias
from hdd_servo_ros.control.ptos import ptos_constants
from hdd_servo_ros.control.seek_kernel import (
    CNF_LAW,
    CONSTANTS,
    ESTIMATES,
    FINAL_STATE,
    GAIN_PRIOR,
    PTOS_LAW,
    STATE,
    SeekArrays,
    seek_after_law,
    seek_before_law,
)
from hdd_servo_ros.control.seek_parameters import SeekParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.numerics.records import record, zeros

Array = NDArray[np.float64]
PlainArrays = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array]
"""The fields of :class:`SeekArrays`."""

ESTIMATE_NAMES: tuple[str, ...] = ESTIMATES.names or ()
_METHODS = {'final_state': FINAL_STATE, 'ptos': PTOS_LAW, 'cnf': CNF_LAW}
MODES = ('follow', 'seek', 'settle')
"""The modes by their numbers in `/estimates`."""
_SHARE_OF_OUTPUT = 0.93
"""Share of the largest voltage behind the law that a seek uses at most."""
_ROUNDING = 1e-9
_CALM = 3.0
"""The model swings on for so many times the samples in which its vibration counts: then a nanometer is left."""


class SeekPlans(NamedTuple):
    """The model of a drive, and voltages that move it from rest to rest."""

    plans: Array
    """Voltage per length of each plan and sample [V/um], shape (plans, longest), zeros behind the end of a plan."""
    durations: Array
    """Samples of each plan, and the vibration that it leaves per length, shape (plans, 2); the shortest one first."""
    transition: Array
    """A, shape (n, n)."""
    response: Array
    """B, shape (n,)."""
    outputs: Array
    """Head position [um] and velocity [um/s] of the states, shape (2, n)."""
    vibration_samples: int
    """Samples after a plan for which the model's vibration counts."""


class SeekSurroundings(NamedTuple):
    """What a seek part has to know beside its parameters."""

    plans: SeekPlans
    """Model and plans at T."""
    delay: int = 0
    """Computation delay behind the law [samples], 0 or 1."""
    velocity_limit: float = math.inf
    """Largest velocity that the sensor shows [um/s]."""
    output_limit: float = math.inf
    """Largest voltage that comes out behind the law [V]."""
    bias_gains: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Gains of the constant voltage after a switch, on error [V/um], velocity [V s/um] and gap."""
    observer: Array | None = None
    """Constants of the observer that gives the velocity (:data:`~hdd_servo_ros.control.observer.OBSERVER`), if any."""


class Seek:
    """
    Seek and settle around the law of any controller, which follows.

    A jump of the reference x_d is a new target. ``final_state`` brings the head there by final-state control in two
    degrees of freedom: a sampled model of the drive with all its modes is driven from rest to rest by

        u_p(k) = L p_N(k),    k = 0 ... N-1,

    where p_N is the smoothest plan of N samples, see :mod:`hdd_servo_ros.analysis.seek_plans`, and N the smallest one
    for which |u_p| stays below the limit and little vibration is left. The model is linear: a target that changes on
    the way adds a plan to the one under way, from any state. The model's position y and velocity are the trajectory.
    The controller gets the head's deviation from it, on top of the reference: position x - (y - x_d). Its law therefore
    knows nothing of the seek, and one with a feedforward of its own from x_d adds nothing twice. Then

        u = u_law + u_p/g + theta F(z),

    with F the friction of LuGre bristles along the trajectory (:mod:`hdd_servo_ros.control.lugre_feedforward`), which
    is held after the arrival, in the place of an integral preset.

    The drive's gain, over that of the model, is estimated during a seek: g is the quotient of sums of v w and w w, with
    v the measured velocity and w that of the model under the voltage that was held, less the friction. The level theta
    of the friction is learned after the trajectory's end, from the voltage that the law still adds (feedback error
    learning, Kawato, Furukawa and Suzuki, Biol. Cybern. 57, 1987): theta += mu u_law F/(F^2 + eps).

    ``ptos`` (:mod:`~hdd_servo_ros.control.ptos`) and ``cnf`` (:mod:`~hdd_servo_ros.control.cnf`) move the head by
    feedback of error and velocity instead, with the friction of the measured velocity fed forward. They replace the
    controller's voltage until the head is close to the target and slow; meanwhile the controller sees the head on the
    target. At the switch u goes on without a step: a constant and a fading voltage are added to the controller's, which
    take the place of its initial values (:mod:`hdd_servo_ros.analysis.initial_values`).

    With a sensor that has no velocity output, the velocity comes from an observer
    (:mod:`~hdd_servo_ros.control.observer`), which takes the voltage against friction for acceleration. What it makes
    of the trajectory and of the added voltage is taken off what it shows of the head; the gain is then estimated from
    positions.

    Modes: seek while there is a plan or the law of the seek acts, settle until the measured position is on the target
    for some samples, follow.

    Parameters
    ----------
    parameters
        Method, limits, model, friction, learning.
    sample_time
        T [s].
    surroundings
        Model and plans at T, delay, and the sensor's limit.
    scales
        How the sensor's outputs are scaled.

    Attributes
    ----------
    estimates
        Mode (0 follow, 1 seek, 2 settle); target [um]; distance to it from the measured position [um]; time since the
        last change of the mode [s]; position on the trajectory [um]; voltage that is added to the law's [V]; estimated
        gain over that of the model; learned level of the friction over that of the model.
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(
        self,
        parameters: SeekParameters,
        sample_time: float,
        surroundings: SeekSurroundings,
        scales: SensorScales | None = None,
    ) -> None:
        self.sample_time = sample_time
        self.scales = scales or SensorScales.none()
        self.estimates = zeros(ESTIMATES)
        plans = surroundings.plans
        longest = plans.plans.shape[1]
        self._named = SeekArrays(
            constants=zeros(CONSTANTS),
            state=zeros(STATE),
            plans=plans.plans.copy(),
            durations=plans.durations.copy(),
            transition=plans.transition.copy(),
            response=plans.response.copy(),
            outputs=plans.outputs.copy(),
            motion=np.zeros((3, len(plans.response))),
            ring=np.zeros(longest),
            ptos=self._ptos(parameters, surroundings),
            cnf=self._cnf(parameters, surroundings),
            cnf_state=zeros(CNF_STATE),
            estimates=self.estimates,
        )
        self.arrays: PlainArrays = cast(PlainArrays, tuple(self._named))
        """The arrays that the kernels take first: plain, as numba joins no named tuple to another."""
        s = record(self._named.state, STATE)
        s.gain = s.friction_level = 1.0
        s.gain_products = s.gain_squares = GAIN_PRIOR
        s.idle = _CALM * plans.vibration_samples
        self.update(parameters, surroundings)

    def update(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> None:
        """Take other parameters from the next tick on; a seek under way and what was learned go on."""
        self.parameters = parameters
        plans = surroundings.plans
        for name in ('plans', 'durations', 'transition', 'response', 'outputs'):
            getattr(self._named, name)[:] = getattr(plans, name)
        self._named.ptos[:] = self._ptos(parameters, surroundings)
        self._named.cnf[:] = self._cnf(parameters, surroundings)
        friction, learning, switch = parameters.friction, parameters.learning, parameters.switch
        c = record(self._named.constants, CONSTANTS)
        c.method = _METHODS[parameters.method]
        c.time_step = self.sample_time
        c.delay = float(surroundings.delay)
        c.threshold = parameters.threshold
        c.control_limit = self._control_limit(parameters, surroundings)
        c.gain = parameters.model.gain
        c.vibration_limit = parameters.vibration_limit
        c.vibration_samples = _CALM * plans.vibration_samples
        c.arrival_tolerance = parameters.arrival_tolerance
        c.arrival_samples = float(parameters.arrival_samples)
        c.switch_distance = switch.distance
        c.switch_velocity = switch.velocity
        c.fading = exp(-self.sample_time / switch.fade_time)
        c.bias_of_error, c.bias_of_velocity, c.bias_of_gap = surroundings.bias_gains
        c.has_friction = float(friction.enabled)
        c.follows_friction = float(friction.range == 'always')
        c.learns_gain = float(learning.gain)
        c.gain_memory = learning.gain_memory
        c.gain_range = learning.gain_range
        c.velocity_limit = surroundings.velocity_limit
        c.learns_friction = float(learning.friction)
        c.friction_step = 1.0 - exp(-learning.friction_rate * self.sample_time)
        c.friction_window = learning.friction_window / self.sample_time
        c.friction_range = learning.friction_range
        c.has_observer = float(surroundings.observer is not None)
        if surroundings.observer is not None:
            found = record(surroundings.observer, OBSERVER)
            for name in OBSERVER.names or ():
                setattr(c.observer, name, getattr(found, name))
            c.observer_bias = standing_bias(found)
        c.bristle.stiffness = friction.stiffness
        c.bristle.bristle_damping = friction.bristle_damping
        c.bristle.coulomb_level = friction.coulomb_level
        c.bristle.static_level = friction.static_level
        c.bristle.inverse_stribeck_velocity = 1.0 / friction.stribeck_velocity
        s = record(self._named.state, STATE)
        if not friction.enabled:
            s.friction = 0.0
        if not learning.gain:
            s.gain = 1.0
        if not learning.friction:
            s.friction_level = 1.0

    @staticmethod
    def _control_limit(parameters: SeekParameters, surroundings: SeekSurroundings) -> float:
        """Return the largest voltage of a seek [V]; some of what the drive takes is left to feedback and friction."""
        return min(parameters.control_limit, _SHARE_OF_OUTPUT * surroundings.output_limit)

    def _ptos(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> Array:
        # A late command is a lag.
        lag = parameters.ptos.lag + surroundings.delay * self.sample_time
        law = dataclasses.replace(parameters.ptos, lag=lag)
        limit = self._control_limit(parameters, surroundings)
        return ptos_constants(law, parameters.model.gain, limit, self.sample_time)

    def _cnf(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> Array:
        # What the friction's feedforward does not cancel, the linear part has to know.
        model, limit = parameters.model, self._control_limit(parameters, surroundings)
        return cnf_constants(parameters.cnf, model.gain, limit, self.sample_time, model.viscous_coefficient)

    @property
    def mode(self) -> str:
        """``follow``, ``seek`` or ``settle``."""
        return MODES[int(record(self._named.state, STATE).mode)]

    @property
    def gain(self) -> float:
        """Estimated gain over that of the model."""
        return float(record(self._named.state, STATE).gain)

    @property
    def friction_level(self) -> float:
        """Learned level of the friction over that of the model."""
        return float(record(self._named.state, STATE).friction_level)

    @property
    def at_limits(self) -> tuple[str, ...]:
        """Which of ``gain`` and ``friction`` are at the limit of what is learned."""
        learning = self.parameters.learning
        found = {'gain': (self.gain, learning.gain_range), 'friction': (self.friction_level, learning.friction_range)}
        return tuple(name for name, (value, reach) in found.items() if 0.0 < reach <= abs(value - 1.0) + _ROUNDING)

    def before_law(self, inputs: ControllerInputs, control: float) -> ControllerInputs:
        """
        Return what the controller gets at a tick: the head's deviation from the trajectory, on top of the reference.

        Parameters
        ----------
        inputs
            What is measured and desired.
        control
            Drive voltage held since the tick before [V].
        """
        offset, rate = seek_before_law(
            *self.arrays,
            inputs.position,
            inputs.velocity,
            inputs.desired_position,
            inputs.desired_velocity,
            inputs.desired_acceleration,
            control,
        )
        return inputs._replace(
            position=inputs.position - offset,
            velocity=inputs.velocity - rate,
            displacement_volts=inputs.displacement_volts - offset / self.scales.displacement,
            velocity_volts=inputs.velocity_volts - rate / self.scales.velocity,
        )

    def after_law(self, u: float, unsaturated: float, feedback: float) -> tuple[float, float, float]:
        """
        Return a controller's output of this tick with that of the seek part added [V].

        Parameters
        ----------
        u, unsaturated, feedback
            As :meth:`~hdd_servo_ros.control.controller.Controller.step` returns them [V]; the feedback part stays.
        """
        added = seek_after_law(*self.arrays, u)
        return u + added, unsaturated + added, feedback


def no_plans() -> SeekPlans:
    """Return plans for a method that has none, and a model that does not move."""
    return SeekPlans(np.zeros((1, 1)), np.ones((1, 2)), np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), 1)


def no_seek(sample_time: float) -> Seek:
    """Return a seek part that stands for none."""
    return Seek(SeekParameters(method='final_state'), sample_time, SeekSurroundings(no_plans()))
