"""Compiled steps of the seek part, before and after a control law; see :mod:`hdd_servo_ros.control.seek`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.cnf import cnf_step
from hdd_servo_ros.control.lugre_feedforward import BRISTLE, mean_friction
from hdd_servo_ros.control.observer import OBSERVER, observed
from hdd_servo_ros.control.ptos import ptos_step
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.records import layout, record

Array = NDArray[np.float64]

FOLLOW, SEEK, SETTLE = 0.0, 1.0, 2.0
"""Modes in `/estimates`."""
FINAL_STATE, PTOS_LAW, CNF_LAW = 1.0, 2.0, 3.0
"""Methods."""

CONSTANTS = layout(
    'method',
    'gain',
    'time_step',
    'delay',
    'threshold',
    'control_limit',
    'vibration_limit',
    'vibration_samples',
    'arrival_tolerance',
    'arrival_samples',
    'switch_distance',
    'switch_velocity',
    'fading',
    'bias_of_error',
    'bias_of_velocity',
    'bias_of_gap',
    'has_friction',
    'follows_friction',
    'learns_gain',
    'gain_memory',
    'gain_range',
    'velocity_limit',
    'learns_friction',
    'friction_step',
    'friction_window',
    'friction_range',
    'has_observer',
    'observer_bias',
    ('bristle', BRISTLE),
    ('observer', OBSERVER),
)
"""
Limits of voltages [V], lengths [um] and velocities [um/s]; times in samples. ``fading`` is the factor by which the
decaying voltage decreases per sample. The next three give the constant voltage, see
:mod:`hdd_servo_ros.analysis.initial_values`.
"""

STATE = layout(
    'mode',
    'samples_in_mode',
    'samples_inside',
    'has_started',
    'first',
    'planned',
    'idle',
    'goal',
    'pending',
    'position',
    'velocity',
    'last_position',
    'last_velocity',
    'reference',
    'reference_velocity',
    'reference_acceleration',
    'deflection',
    'friction',
    'applied_friction',
    'last_applied_friction',
    'gain',
    'gain_products',
    'gain_squares',
    'friction_level',
    'length',
    'error',
    'head_velocity',
    'is_switching',
    'law',
    'held',
    'bias',
    'fading',
    'measured',
    'added',
    'last_added',
    'observed_position',
    'observed_travel',
    'origin',
    'is_stacked',
)
"""
``first`` is the offset of the ring buffer of planned voltages, ``planned`` the number of remaining ones, ``idle`` the
samples since the last one. ``goal`` [um] is the sum of the active reference steps, ``pending`` [um] the part that has
no plan yet. The position and velocity of the model at this tick and the last one follow. For a seek by feedback, the
fields from ``length`` on are its length, the distance to the target and the velocity at this tick, the voltage of its
law, the controller's voltage on the target, and the two voltages after the switch. For a sensor without a velocity
output, the fields from ``measured`` on are the measured position [um], the voltage added by the seek part that causes
the motion of the model or balances the friction [V], now and at the last tick, the observer's response to that motion
[um], and the start of the motion of the model [um]. ``is_stacked`` is set if a plan was added to an active one.
"""

ESTIMATES = layout(
    'seek_mode',
    'seek_target',
    'seek_distance',
    'seek_time',
    'seek_trajectory',
    'seek_u',
    'seek_gain',
    'seek_friction',
)

GAIN_PRIOR = 9.0e6
"""Weight of the model's own gain in the sums [um^2/s^2]: that of one sample at 3 mm/s."""
_FRICTION_FLOOR = 2.5e-3
"""Added to the square of the friction when its relative value is learned [V^2]."""
_FIRST_LEARNED = 3.0
"""Samples from the end of a trajectory to the start of friction learning, during which the resonances ring down."""
_CLIPPED = 0.98
"""Fraction of the sensor's range above which a velocity is ignored."""

PLANNED, DRIVEN, NEXT = range(3)
"""Rows of ``motion``: model driven by the plan, model driven by the held voltage, and buffer for the next state."""
DURATION, VIBRATION = range(2)
"""Columns of ``durations``."""


class SeekArrays(NamedTuple):
    """Array arguments of the kernels that precede their inputs."""

    constants: Array
    state: Array
    plans: Array
    """Voltage per length for each plan and sample [V/um], shape (plans, longest)."""
    durations: Array
    """Samples of each plan, and its residual vibration per length, shape (plans, 2); shortest plan first."""
    transition: Array
    """A of the model, shape (n, n)."""
    response: Array
    """B of the model, shape (n,)."""
    outputs: Array
    """Head position [um] and velocity [um/s] of its states, shape (2, n)."""
    motion: Array
    """States of the model, shape (3, n)."""
    ring: Array
    """Remaining planned voltages [V], shape (longest,)."""
    ptos: Array
    """Constants of :func:`~hdd_servo_ros.control.ptos.ptos_step`."""
    cnf: Array
    """Constants of :func:`~hdd_servo_ros.control.cnf.cnf_step`."""
    cnf_state: Array
    estimates: Array


@compiled_apart
def seek_before_law(
    constants: Array,
    state: Array,
    plans: Array,
    durations: Array,
    transition: Array,
    response: Array,
    outputs: Array,
    motion: Array,
    ring: Array,
    ptos: Array,
    cnf: Array,
    cnf_state: Array,
    estimates: Array,
    position: float,
    velocity: float,
    x_d: float,
    dx_d: float,
    ddx_d: float,
    control: float,
) -> tuple[float, float]:
    """Return the trajectory minus the reference in position [um] and velocity [um/s]; see :class:`Seek`."""
    c = record(constants, CONSTANTS)
    s = record(state, STATE)
    if not abs(position) + abs(velocity) + abs(x_d) + abs(dx_d) + abs(ddx_d) + abs(control) < math.inf:
        return 0.0, 0.0
    s.samples_in_mode += 1.0
    if s.has_started == 0.0:
        s.origin = s.observed_position = position
    was_seeking = s.mode == SEEK
    step = _reference_step(c, s, position, x_d, dx_d, ddx_d)
    if c.method == FINAL_STATE:
        if abs(step) > c.threshold:
            _start_seek(c, s, motion, step)
        if s.pending != 0.0:
            _plan(c, s, plans, durations, ring)
        if c.learns_gain != 0.0 and was_seeking:
            speed = velocity - dx_d
            if c.has_observer != 0.0:
                speed = (position - s.measured) / c.time_step - dx_d
            _estimate_gain(c, s, transition, response, outputs, motion, speed, control)
        s.measured = position
        along, rate = s.position, s.velocity
        if c.delay > 0.0:
            along, rate = s.last_position, s.last_velocity
        offset = along - s.goal
        if c.has_observer != 0.0:
            rate = _observed_velocity(c, s, s.origin + along)
        is_over = s.planned == 0.0 and s.pending == 0.0 and s.idle >= c.delay
    else:
        unseen = 0.0
        if c.has_observer != 0.0:
            unseen = _observed_velocity(c, s, 0.0) + c.observer_bias * position
        s.error, s.head_velocity = x_d - position, velocity - unseen - dx_d
        if abs(step) > c.threshold:
            s.mode, s.samples_in_mode = SEEK, 0.0
            s.length, s.law = abs(s.error), 0.0
            cnf_state[:] = 0.0
        is_over = abs(s.error) <= c.switch_distance and abs(s.head_velocity) <= c.switch_velocity
        s.is_switching = 1.0 if s.mode == SEEK and is_over else 0.0
        # While the law of the seek is active, the controller is given the target, so that its states stay at rest.
        offset, rate = 0.0, unseen
        if s.mode == SEEK and not is_over:
            offset, rate = -s.error, unseen + s.head_velocity
    if s.mode == SEEK and is_over:
        s.mode, s.samples_in_mode, s.samples_inside = SETTLE, 0.0, 0.0
    if s.mode == SETTLE:
        s.samples_inside = s.samples_inside + 1.0 if abs(position - x_d) <= c.arrival_tolerance else 0.0
        if s.samples_inside >= c.arrival_samples:
            s.mode, s.samples_in_mode = FOLLOW, 0.0
    found = record(estimates, ESTIMATES)
    found.seek_mode = s.mode
    found.seek_target = x_d
    found.seek_distance = x_d - position
    found.seek_time = s.samples_in_mode * c.time_step
    found.seek_trajectory = x_d + offset
    return offset, rate


@compiled_apart
def seek_after_law(
    constants: Array,
    state: Array,
    plans: Array,
    durations: Array,
    transition: Array,
    response: Array,
    outputs: Array,
    motion: Array,
    ring: Array,
    ptos: Array,
    cnf: Array,
    cnf_state: Array,
    estimates: Array,
    u: float,
) -> float:
    """Return the voltage that is added to the law's voltage ``u`` [V]; see :class:`Seek`."""
    c = record(constants, CONSTANTS)
    s = record(state, STATE)
    if c.method == FINAL_STATE:
        added = _along_plan(c, s, transition, response, outputs, motion, ring, u)
    else:
        added = _by_feedback(c, s, ptos, cnf, cnf_state, u)
    found = record(estimates, ESTIMATES)
    found.seek_u = added
    found.seek_gain = s.gain
    found.seek_friction = s.friction_level
    return added


@compiled
def _along_plan(
    c: np.record,
    s: np.record,
    transition: Array,
    response: Array,
    outputs: Array,
    motion: Array,
    ring: Array,
    u: float,
) -> float:
    """Return the planned voltage plus the friction along the trajectory [V], and advance the model."""
    voltage = 0.0
    if s.planned > 0.0:
        first = int(s.first)
        voltage = ring[first]
        ring[first] = 0.0
        s.first = float((first + 1) % len(ring))
        s.planned -= 1.0
        s.idle = 0.0
    else:
        s.idle += 1.0
    s.last_position, s.last_velocity = s.position, s.velocity
    if s.planned > 0.0 or s.idle < c.vibration_samples:
        _move(transition, response, motion, PLANNED, voltage)
        s.position, s.velocity = _output(outputs, motion, PLANNED)
    elif s.pending == 0.0 and s.goal != 0.0:
        # Everything is at rest on the target: clears rounding errors of the motion.
        _clear(motion, PLANNED)
        s.origin += s.goal
        s.position, s.velocity, s.goal = 0.0, 0.0, 0.0
        s.last_position, s.last_velocity = 0.0, 0.0
    if c.has_friction != 0.0 and (s.mode != FOLLOW or c.follows_friction != 0.0):
        time_step = c.time_step
        drift = time_step * (s.reference_velocity + 0.5 * time_step * s.reference_acceleration)
        s.friction, s.deflection = mean_friction(
            c.bristle,
            s.deflection,
            time_step,
            drift + s.position - s.last_position,
            s.reference_velocity + s.last_velocity,
            s.reference_velocity + time_step * s.reference_acceleration + s.velocity,
        )
    if c.learns_friction != 0.0 and s.mode != SEEK and _is_learned(c, s) and abs(u) < math.inf:
        level = s.friction_level + c.friction_step * u * s.friction / (s.friction * s.friction + _FRICTION_FLOOR)
        s.friction_level = min(max(level, 1.0 - c.friction_range), 1.0 + c.friction_range)
    s.last_applied_friction = s.applied_friction
    s.applied_friction = s.friction_level * s.friction
    s.last_added = s.added
    added: float = voltage / s.gain + s.applied_friction
    s.added = added
    return added


@compiled
def _observed_velocity(c: np.record, s: np.record, position: float) -> float:
    """
    Return the velocity that an observer would show for the model's motion, given the voltage added to the law's.

    An observer interprets every voltage as acceleration, including the voltage against friction, and models no
    resonances. It is linear: its estimate for the head minus this value is its estimate for the head's deviation from
    the trajectory under the law's voltage alone.
    """
    held = s.last_added if c.delay > 0.0 else s.added
    s.observed_position, s.observed_travel = observed(
        c.observer, s.observed_position, s.observed_travel, position, held
    )
    return s.observed_travel * c.observer.per_second  # type: ignore[no-any-return]


@compiled
def _is_learned(c: np.record, s: np.record) -> bool:
    """Return whether the friction is learned at this tick, given the time since the last plan."""
    return _FIRST_LEARNED < s.idle <= c.friction_window  # type: ignore[no-any-return]


@compiled
def _by_feedback(c: np.record, s: np.record, ptos: Array, cnf: Array, cnf_state: Array, u: float) -> float:
    """Return the voltage that PTOS or CNF adds to the controller's, and the added voltage after the switch [V]."""
    velocity = s.head_velocity
    if c.has_friction != 0.0 and s.mode != FOLLOW:
        time_step = c.time_step
        s.friction, s.deflection = mean_friction(
            c.bristle, s.deflection, time_step, time_step * velocity, velocity, velocity
        )
    if s.mode == SEEK or s.is_switching != 0.0:
        if c.method == PTOS_LAW:
            law = ptos_step(ptos, s.error, velocity, s.law)
        else:
            # As with the lag of PTOS: a delayed command acts after the head has moved on.
            lag = c.delay * c.time_step
            rise = c.gain * s.law * lag
            error = s.error - lag * (velocity + 0.5 * rise)
            law = cnf_step(cnf, cnf_state, error, velocity + rise, s.length)
        s.law = law
        if s.is_switching == 0.0:
            # On the target the controller outputs the voltage it holds against friction; the feedforward now does this.
            s.held = u
            s.bias, s.fading = -u, law
        else:
            # Initial value compensation: no step in u, and the smallest transient.
            gap = law - (u - s.held)
            bias: float = c.bias_of_error * s.error + c.bias_of_velocity * velocity + c.bias_of_gap * gap
            s.bias, s.fading = bias - s.held, gap - bias
    else:
        s.fading *= c.fading
    s.last_added = s.added
    s.added = s.friction
    return s.friction + s.bias + s.fading  # type: ignore[no-any-return]


@compiled
def _reference_step(c: np.record, s: np.record, position: float, x_d: float, dx_d: float, ddx_d: float) -> float:
    """Return the step of the reference: distance from the extrapolation of the last tick, initially from the head."""
    time_step = c.time_step
    rise = x_d - s.reference
    step = x_d - position
    if s.has_started != 0.0:
        change = ddx_d - s.reference_acceleration
        # The extrapolation is a polynomial with the derivatives of both ticks, or with the velocity of one of them:
        # where the reference starts or stops, its velocity has a step and its position has none.
        mean = 0.5 * (s.reference_velocity + dx_d)
        step = rise - time_step * (mean - time_step * change / 12.0)
        for slope in (s.reference_velocity, dx_d):
            other = rise - time_step * slope
            if abs(other) < abs(step):
                step = other
        # An acceleration step anywhere within the sample moves the reference by less than this.
        if abs(step) <= 0.25 * time_step * time_step * abs(change):
            step = 0.0
    s.has_started = 1.0
    s.reference, s.reference_velocity, s.reference_acceleration = x_d, dx_d, ddx_d
    return step


@compiled
def _start_seek(c: np.record, s: np.record, motion: Array, step: float) -> None:
    """Start a seek to the new target given by a step of the reference."""
    s.goal += step
    s.pending += step
    if s.mode != SEEK:
        s.gain_products = GAIN_PRIOR + c.gain_memory * (s.gain_products - GAIN_PRIOR)
        s.gain_squares = GAIN_PRIOR + c.gain_memory * (s.gain_squares - GAIN_PRIOR)
        _clear(motion, DRIVEN)
    s.mode, s.samples_in_mode = SEEK, 0.0


@compiled
def _plan(c: np.record, s: np.record, plans: Array, durations: Array, ring: Array) -> None:
    """Add the shortest plan with small residual vibration within the voltage limit to the planned voltages."""
    first = int(s.first)
    length = s.pending
    if s.planned == 0.0:
        s.is_stacked = 0.0
    elif s.is_stacked != 0.0:
        # With two active plans the head stays between the targets; with more it might go anywhere.
        return
    for plan in range(len(plans)):
        if abs(length) * durations[plan, VIBRATION] > c.vibration_limit:
            continue
        peak = 0.0
        for i in range(int(durations[plan, DURATION])):
            peak = max(peak, abs(ring[(first + i) % len(ring)] + length * plans[plan, i]))
        if peak <= c.control_limit:
            s.is_stacked = 1.0 if s.planned > 0.0 else 0.0
            _add_plan(s, plans, durations, ring, plan, length)
            return
    if s.planned > 0.0:
        return  # Wait for the end of the active plans.
    last = len(plans) - 1
    peak = 0.0
    for i in range(plans.shape[1]):
        peak = max(peak, abs(plans[last, i]))
    piece = math.copysign(min(abs(length), c.control_limit / peak), length)
    _add_plan(s, plans, durations, ring, last, piece)


@compiled
def _add_plan(s: np.record, plans: Array, durations: Array, ring: Array, plan: int, length: float) -> None:
    first = int(s.first)
    samples = int(durations[plan, DURATION])
    for i in range(samples):
        ring[(first + i) % len(ring)] += length * plans[plan, i]
    s.planned = max(s.planned, float(samples))
    s.pending -= length


@compiled
def _estimate_gain(
    c: np.record,
    s: np.record,
    transition: Array,
    response: Array,
    outputs: Array,
    motion: Array,
    velocity: float,
    control: float,
) -> None:
    """Compare the measured velocity with that of the model under the held voltage minus the friction."""
    friction = s.last_applied_friction if c.delay > 0.0 else s.applied_friction
    before, _ = _output(outputs, motion, DRIVEN)
    _move(transition, response, motion, DRIVEN, control - friction)
    after, expected = _output(outputs, motion, DRIVEN)
    if c.has_observer != 0.0:
        # The observer is biased by its own model, so the ratio of travels per sample is used.
        expected = (after - before) / c.time_step
    if max(abs(velocity), abs(expected)) < _CLIPPED * c.velocity_limit:
        products: float = s.gain_products + velocity * expected
        squares: float = s.gain_squares + expected * expected
        s.gain_products, s.gain_squares = products, squares
        s.gain = min(max(products / squares, 1.0 - c.gain_range), 1.0 + c.gain_range)


@compiled
def _move(transition: Array, response: Array, motion: Array, row: int, voltage: float) -> None:
    """Advance a state of the model by one sample with a held voltage."""
    count = motion.shape[1]
    for i in range(count):
        total = response[i] * voltage
        for j in range(count):
            total += transition[i, j] * motion[row, j]
        motion[NEXT, i] = total
    for i in range(count):
        motion[row, i] = motion[NEXT, i]


@compiled
def _output(outputs: Array, motion: Array, row: int) -> tuple[float, float]:
    position, velocity = 0.0, 0.0
    for i in range(motion.shape[1]):
        position += outputs[0, i] * motion[row, i]
        velocity += outputs[1, i] * motion[row, i]
    return position, velocity


@compiled
def _clear(motion: Array, row: int) -> None:
    for i in range(motion.shape[1]):
        motion[row, i] = 0.0
