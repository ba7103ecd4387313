"""Seek and settle for any controller: trajectories to new targets, with their feedforward."""

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
"""Fields of :class:`SeekArrays`."""

ESTIMATE_NAMES: tuple[str, ...] = ESTIMATES.names or ()
_METHODS = {'final_state': FINAL_STATE, 'ptos': PTOS_LAW, 'cnf': CNF_LAW}
MODES = ('follow', 'seek', 'settle')
"""Names of the modes, by their numbers in `/estimates`."""
_SHARE_OF_OUTPUT = 0.93
"""Largest fraction of the voltage limit after the law that a seek uses."""
_ROUNDING = 1e-9
_CALM = 3.0
"""Simulated time after a plan, relative to the settling time of its vibration: leaves less than a nanometer."""


class SeekPlans(NamedTuple):
    """Model of a drive, and voltages that move it from rest to rest."""

    plans: Array
    """Voltage per length for each plan and sample [V/um], shape (plans, longest), zero after the end of a plan."""
    durations: Array
    """Samples of each plan, and its residual vibration per length, shape (plans, 2); shortest plan first."""
    transition: Array
    """A, shape (n, n)."""
    response: Array
    """B, shape (n,)."""
    outputs: Array
    """Head position [um] and velocity [um/s] of the states, shape (2, n)."""
    vibration_samples: int
    """Samples after a plan over which the residual vibration of the model counts."""


class SeekSurroundings(NamedTuple):
    """Knowledge of the seek part about drive and loop, in addition to its parameters."""

    plans: SeekPlans
    """Model and plans at T."""
    delay: int = 0
    """Computation delay after the law [samples], 0 or 1."""
    velocity_limit: float = math.inf
    """Largest velocity that the sensor can measure [um/s]."""
    output_limit: float = math.inf
    """Largest voltage after the law [V]."""
    bias_gains: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Gains of the constant voltage after a switch: on error [V/um], velocity [V s/um] and voltage difference."""
    observer: Array | None = None
    """Constants of the observer for the velocity (:data:`~hdd_servo_ros.control.observer.OBSERVER`), or None."""


class Seek:
    """
    Seek and settle around the law of any controller, which then follows the track.

    A step of the reference x_d is a new target. ``final_state`` moves the head there by final-state control with two
    degrees of freedom. A sampled model of the drive, with all its modes, is driven from rest to rest by

        u_p(k) = L p_N(k),    k = 0 ... N-1,

    where p_N is the smoothest plan of N samples, see :mod:`hdd_servo_ros.analysis.seek_plans`. N is the smallest number
    for which ``|u_p|`` stays below the limit and the residual vibration is small. The model is linear: a target change
    during a seek adds a plan to the active one, from any state. Position y and velocity of the model are the
    trajectory. The controller receives the head's deviation from it, on top of the reference: position x - (y - x_d).
    Its law is therefore unaware of the seek, and a controller with its own feedforward of x_d adds nothing twice. Then

        u = u_law + u_p/g + theta F(z),

    where F is the friction of LuGre bristles along the trajectory (:mod:`hdd_servo_ros.control.lugre_feedforward`). It
    is held after arrival and serves as an integrator preset.

    The gain g of the drive relative to the model is estimated during a seek: it is the sum of v w divided by the sum of
    w w, with the measured velocity v and the velocity w of the model under the held voltage minus the friction. The
    relative friction theta is learned after the end of the trajectory, from the voltage that the law still adds
    (feedback error learning, Kawato, Furukawa and Suzuki, Biol. Cybern. 57, 1987):
    theta += mu u_law F/(F^2 + eps).

    ``ptos`` (:mod:`~hdd_servo_ros.control.ptos`) and ``cnf`` (:mod:`~hdd_servo_ros.control.cnf`) move the head by
    feedback of error and velocity, with a feedforward of the friction at the measured velocity. They replace the
    controller's voltage until the head is close to the target and slow. Meanwhile the controller is given the target as
    the head's position. At the switch u has no step: a constant and a decaying voltage are added to the controller's,
    instead of initial values of its states (:mod:`hdd_servo_ros.analysis.initial_values`).

    If the sensor has no velocity output, an observer estimates the velocity
    (:mod:`~hdd_servo_ros.control.observer`). The observer interprets the voltage against friction as acceleration.
    Its response to the trajectory and to the added voltage is subtracted from its estimate for the head. The gain is
    then estimated from positions.

    Modes: seek while a plan or the law of the seek is active, settle until the measured position has been on the target
    for some samples, follow.

    Parameters
    ----------
    parameters
        Method, limits, model, friction, learning.
    sample_time
        T [s].
    surroundings
        Model and plans at T, delay, and limit of the sensor.
    scales
        Scale factors of the sensor outputs.

    Attributes
    ----------
    estimates
        Mode (0 follow, 1 seek, 2 settle); target [um]; distance to it from the measured position [um]; time since the
        last change of mode [s]; position on the trajectory [um]; voltage added to that of the law [V]; estimated gain
        relative to the model; learned friction relative to the model.
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
        """Array arguments of the kernels, in order; a plain tuple, because numba cannot concatenate named tuples."""
        s = record(self._named.state, STATE)
        s.gain = s.friction_level = 1.0
        s.gain_products = s.gain_squares = GAIN_PRIOR
        s.idle = _CALM * plans.vibration_samples
        self.update(parameters, surroundings)

    def update(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> None:
        """Use new parameters from the next tick on; an active seek continues, and learned values are kept."""
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
        """Return the largest voltage of a seek [V]; leaves a reserve for feedback and friction."""
        return min(parameters.control_limit, _SHARE_OF_OUTPUT * surroundings.output_limit)

    def _ptos(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> Array:
        # The computation delay is a lag.
        lag = parameters.ptos.lag + surroundings.delay * self.sample_time
        law = dataclasses.replace(parameters.ptos, lag=lag)
        limit = self._control_limit(parameters, surroundings)
        return ptos_constants(law, parameters.model.gain, limit, self.sample_time)

    def _cnf(self, parameters: SeekParameters, surroundings: SeekSurroundings) -> Array:
        # The linear part must compensate the friction that the feedforward does not cancel.
        model, limit = parameters.model, self._control_limit(parameters, surroundings)
        return cnf_constants(parameters.cnf, model.gain, limit, self.sample_time, model.viscous_coefficient)

    @property
    def mode(self) -> str:
        """Mode: ``follow``, ``seek`` or ``settle``."""
        return MODES[int(record(self._named.state, STATE).mode)]

    @property
    def gain(self) -> float:
        """Estimated gain of the drive relative to the model."""
        return float(record(self._named.state, STATE).gain)

    @property
    def friction_level(self) -> float:
        """Learned friction relative to the model."""
        return float(record(self._named.state, STATE).friction_level)

    @property
    def at_limits(self) -> tuple[str, ...]:
        """Names, of ``gain`` and ``friction``, whose learned value is at its bound."""
        learning = self.parameters.learning
        found = {'gain': (self.gain, learning.gain_range), 'friction': (self.friction_level, learning.friction_range)}
        return tuple(name for name, (value, reach) in found.items() if 0.0 < reach <= abs(value - 1.0) + _ROUNDING)

    def before_law(self, inputs: ControllerInputs, control: float) -> ControllerInputs:
        """
        Return the inputs of the controller at a tick: the deviation from the trajectory, on top of the reference.

        Parameters
        ----------
        inputs
            Measured and desired signals.
        control
            Drive voltage held since the previous tick [V].
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
        Return the controller output of this tick with the voltage of the seek part added [V].

        Parameters
        ----------
        u, unsaturated, feedback
            Output of :meth:`~hdd_servo_ros.control.controller.Controller.step` [V]; the feedback part is unchanged.
        """
        added = seek_after_law(*self.arrays, u)
        return u + added, unsaturated + added, feedback


def no_plans() -> SeekPlans:
    """Return empty plans for a method without plans, and a model that does not move."""
    return SeekPlans(np.zeros((1, 1)), np.ones((1, 2)), np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), 1)


def no_seek(sample_time: float) -> Seek:
    """Return a seek part with method none, as a placeholder."""
    return Seek(SeekParameters(method='final_state'), sample_time, SeekSurroundings(no_plans()))
