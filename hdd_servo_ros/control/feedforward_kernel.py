"""Compiled step of the feedforward from the accelerometers; see :mod:`hdd_servo_ros.control.feedforward`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.numerics.records import layout, record

Array = NDArray[np.float64]

FIXED, FXLMS, IIR, NETWORK = 1.0, 2.0, 3.0, 4.0

CONSTANTS = layout(
    'method',
    'is_enabled',
    'rotation_scale',
    'linear_scale',
    'step_size',
    'kept',
    'regularization',
    'power_decay',
    'error_limit',
    'weight_limit',
    'control_limit',
    'recursive_step_size',
    'pole_radius',
    'node_spacing',
    'node_power_decay',
    'network_step_size',
    'network_kept',
    'network_limit',
    'supervises',
    'mean_step',
    'recent_step',
    'trip_ratio',
    'return_ratio',
    'settling',
    'pause',
    'fade_step',
)
"""
Scales from half the difference and half the sum of the sensor outputs to equivalent volts at the drive [V/V];
``kept`` and ``network_kept`` are the factors that remain after leakage; times of the supervisor [samples].
"""

STATE = layout(
    'offset',
    'tap_offset',
    'share',
    'is_off',
    'settling_left',
    'pause_left',
    'next_pause',
    'switched_off',
    'square_with',
    'square_without',
    'recent_with',
    'recent_without',
    'a1',
    'a2',
    'output_1',
    'output_2',
    'filtered_1',
    'filtered_2',
    'recursive_power',
)
"""
Offsets of the delay lines; fraction of the output that is applied to the drive; supervisor; weights of the recursion,
its last outputs [V], their effect on the error [um], and the power of that effect [um^2].
"""

ESTIMATES = layout('u_ff', 'ff_share', 'ff_rms', 'ff_rms_without', 'ff_weights')

ROTATION, LINEAR, ACTING, OUTPUT, NODES = range(5)
"""Rows of the long delay lines: both accelerations, applied feedforward, output, and first node."""
ROTATION_TAPS, LINEAR_TAPS, FILTERED_ROTATION_TAPS, FILTERED_LINEAR_TAPS = range(4)
"""Rows of the delay lines of the taps."""
NODE_WEIGHT, NODE_FILTERED, NODE_POWER = range(3)
"""Rows of the network array."""

_GROSS = 4.0
"""Ratio of the mean squares over a few milliseconds above which the supervisor switches the feedforward off at once."""
_LONGEST_PAUSE = 64.0
"""Longest pause, relative to the first one."""
_NODE_POWER_FLOOR = 1e-4
"""Added to the power of a node's filtered value [um^2/V^2], to avoid division by zero."""


class FeedforwardArrays(NamedTuple):
    """Array arguments of :func:`feedforward_step` that precede its inputs."""

    constants: Array
    state: Array
    path: Array
    """Response of the error to a pulse of the feedforward [um/V], shape (p,)."""
    transform: Array
    """Orthonormal discrete cosine transform, shape (n, n)."""
    nominal: Array
    """Leakage targets of the weights of both channels, shape (2, n)."""
    weights: Array
    """Weights of both channels, shape (2, n)."""
    powers: Array
    """Power of each transformed filtered acceleration [um^2], shape (2, n)."""
    transformed: Array
    """Transformed filtered accelerations [um], then their corrections, shape (2, n)."""
    lines: Array
    """Delay lines of the length of the path, shape (4 + nodes, 2 p)."""
    taps: Array
    """Delay lines of the length of the taps, shape (4, 2 n)."""
    network: Array
    """Weight [V], filtered value [um/V] and power [um^2/V^2] of each node, shape (3, nodes)."""
    estimates: Array


@compiled_apart
def feedforward_step(
    constants: Array,
    state: Array,
    path: Array,
    transform: Array,
    nominal: Array,
    weights: Array,
    powers: Array,
    transformed: Array,
    lines: Array,
    taps: Array,
    network: Array,
    estimates: Array,
    error: float,
    x_volts: float,
    y_volts: float,
) -> float:
    """Return the feedforward [V]; see :meth:`hdd_servo_ros.control.feedforward.Feedforward.step`."""
    c = record(constants, CONSTANTS)
    s = record(state, STATE)
    if not abs(error) + abs(x_volts) + abs(y_volts) < math.inf:
        return math.nan
    offset = _one_back(s.offset, len(path))
    tap_offset = _one_back(s.tap_offset, weights.shape[1])
    s.offset, s.tap_offset = float(offset), float(tap_offset)
    _append(lines, taps, path, ROTATION, offset, tap_offset, 0.5 * c.rotation_scale * (x_volts - y_volts))
    _append(lines, taps, path, LINEAR, offset, tap_offset, 0.5 * c.linear_scale * (x_volts + y_volts))
    # The error without past feedforward, and the error that the present weights would have caused.
    without = error - _convolved(path, lines, ACTING, offset)
    expected = without + _filtered_output(c, s, path, weights, lines, taps, network, offset, tap_offset)
    if c.method >= FXLMS:
        adapting = min(max(expected, -c.error_limit), c.error_limit)
        _adapt_taps(c, transform, nominal, weights, powers, transformed, taps, tap_offset, adapting)
        if c.method == IIR:
            _adapt_recursion(c, s, adapting)
        elif c.method == NETWORK:
            _adapt_nodes(c, network, adapting)
    output = _output(c, s, path, weights, lines, taps, network, offset, tap_offset)
    _supervise(c, s, error, without, expected)
    acting = s.share * output
    _push(lines, ACTING, offset, len(path), acting)
    found = record(estimates, ESTIMATES)
    found.u_ff = acting
    found.ff_share = s.share
    found.ff_rms = math.sqrt(s.square_with)
    found.ff_rms_without = math.sqrt(s.square_without)
    found.ff_weights = _norm(weights)
    return acting  # type: ignore[no-any-return]


@compiled
def _one_back(offset: float, length: int) -> int:
    """Return the offset of a delay line of double length after one more value."""
    return int(offset) - 1 if offset > 0.0 else length - 1


@compiled
def _push(lines: Array, row: int, offset: int, length: int, value: float) -> None:
    """Write the newest value of a delay line twice, so that all its values are contiguous from ``offset`` on."""
    lines[row, offset] = value
    lines[row, offset + length] = value


@compiled_apart
def _convolved(path: Array, lines: Array, row: int, offset: int) -> float:
    """Return the sum of path[i] times the value i samples ago; four partial sums hide the latency of the additions."""
    sum_0, sum_1, sum_2, sum_3 = 0.0, 0.0, 0.0, 0.0
    for i in range(0, len(path), 4):
        sum_0 += path[i] * lines[row, offset + i]
        sum_1 += path[i + 1] * lines[row, offset + i + 1]
        sum_2 += path[i + 2] * lines[row, offset + i + 2]
        sum_3 += path[i + 3] * lines[row, offset + i + 3]
    return (sum_0 + sum_1) + (sum_2 + sum_3)


@compiled
def _append(lines: Array, taps: Array, path: Array, row: int, offset: int, tap_offset: int, value: float) -> None:
    """Append the newest value of a channel [V] and its response through the path [um]."""
    length = taps.shape[1] // 2
    _push(lines, row, offset, len(path), value)
    _push(taps, row, tap_offset, length, value)
    _push(taps, row + FILTERED_ROTATION_TAPS, tap_offset, length, _convolved(path, lines, row, offset))


@compiled
def _weighted(weights: Array, taps: Array, first_row: int, tap_offset: int) -> float:
    """Return the weighted sum of the stored values of both channels."""
    rotation, linear = 0.0, 0.0
    for i in range(weights.shape[1]):
        rotation += weights[0, i] * taps[first_row, tap_offset + i]
        linear += weights[1, i] * taps[first_row + 1, tap_offset + i]
    return rotation + linear


@compiled
def _filtered_output(
    c: np.record,
    s: np.record,
    path: Array,
    weights: Array,
    lines: Array,
    taps: Array,
    network: Array,
    offset: int,
    tap_offset: int,
) -> float:
    """Return the effect of the output of the present weights on the error [um]."""
    total = _weighted(weights, taps, FILTERED_ROTATION_TAPS, tap_offset)
    if c.method == IIR:
        total += s.a1 * s.filtered_1 + s.a2 * s.filtered_2
    elif c.method == NETWORK:
        for j in range(network.shape[1]):
            network[NODE_FILTERED, j] = _convolved(path, lines, NODES + j, offset)
            total += network[NODE_WEIGHT, j] * network[NODE_FILTERED, j]
    return total


@compiled
def _adapt_taps(
    c: np.record,
    transform: Array,
    nominal: Array,
    weights: Array,
    powers: Array,
    transformed: Array,
    taps: Array,
    tap_offset: int,
    error: float,
) -> None:
    """Take one step of the normalized filtered-x LMS algorithm in the coordinates of the cosine transform."""
    count = weights.shape[1]
    total = 0.0
    for channel in range(2):
        row = FILTERED_ROTATION_TAPS + channel
        for i in range(count):
            transformed[channel, i] = 0.0
        for j in range(count):
            value = taps[row, tap_offset + j]
            for i in range(count):
                transformed[channel, i] += transform[j, i] * value
        for i in range(count):
            value = transformed[channel, i]
            powers[channel, i] = c.power_decay * powers[channel, i] + (1.0 - c.power_decay) * value * value
            total += value * value / (powers[channel, i] + c.regularization)
    step = c.step_size * error / (float(count) + max(total, 1.0))
    for channel in range(2):
        for i in range(count):
            # Far below the regularization a weight would only follow noise, so its step becomes very small.
            power = powers[channel, i]
            transformed[channel, i] *= step * power / ((power + c.regularization) * (power + c.regularization))
        for j in range(count):
            correction = 0.0
            for i in range(count):
                correction += transform[j, i] * transformed[channel, i]
            rest = nominal[channel, j]
            weight = rest + c.kept * (weights[channel, j] - rest) - correction
            weights[channel, j] = min(max(weight, -c.weight_limit), c.weight_limit)


@compiled
def _adapt_recursion(c: np.record, s: np.record, error: float) -> None:
    """Adapt the two recursive weights and project them so that both poles stay inside a circle."""
    square = s.filtered_1 * s.filtered_1
    s.recursive_power = c.power_decay * s.recursive_power + (1.0 - c.power_decay) * square
    step = c.recursive_step_size * error / (s.recursive_power + square + c.regularization)
    a1 = c.kept * s.a1 - step * s.filtered_1
    a2 = c.kept * s.a2 - step * s.filtered_2
    # With z = r w, the polynomial z^2 - a1 z - a2 is stable in w inside a triangle.
    radius = c.pole_radius
    a2 = min(max(a2, -radius * radius), radius * radius)
    bound = radius - a2 / radius
    s.a1 = min(max(a1, -bound), bound)
    s.a2 = a2


@compiled
def _adapt_nodes(c: np.record, network: Array, error: float) -> None:
    """Adapt the weights of the nodes: normalized gradient, leakage (sigma-modification) and projection."""
    count = network.shape[1]
    total = 0.0
    for j in range(count):
        square = network[NODE_FILTERED, j] * network[NODE_FILTERED, j]
        network[NODE_POWER, j] = c.node_power_decay * network[NODE_POWER, j] + (1.0 - c.node_power_decay) * square
        total += square / (network[NODE_POWER, j] + _NODE_POWER_FLOOR)
    step = c.network_step_size * error / (float(count) + max(total, 1.0))
    for j in range(count):
        correction = step * network[NODE_FILTERED, j] / (network[NODE_POWER, j] + _NODE_POWER_FLOOR)
        weight = c.network_kept * network[NODE_WEIGHT, j] - correction
        network[NODE_WEIGHT, j] = min(max(weight, -c.network_limit), c.network_limit)


@compiled
def _output(
    c: np.record,
    s: np.record,
    path: Array,
    weights: Array,
    lines: Array,
    taps: Array,
    network: Array,
    offset: int,
    tap_offset: int,
) -> float:
    """Return the output of the present weights [V]."""
    output = _weighted(weights, taps, ROTATION_TAPS, tap_offset)
    if c.method == IIR:
        output += s.a1 * s.output_1 + s.a2 * s.output_2
        output = min(max(output, -c.control_limit), c.control_limit)
        s.output_2, s.output_1 = s.output_1, output
        s.filtered_2, s.filtered_1 = s.filtered_1, _convolved(path, lines, OUTPUT, offset)
        _push(lines, OUTPUT, offset, len(path), output)
    elif c.method == NETWORK:
        count = network.shape[1]
        first = -0.5 * float(count - 1)
        position = output / c.node_spacing
        for j in range(count):
            distance = position - (first + float(j))
            value = exp(-distance * distance)
            _push(lines, NODES + j, offset, len(path), value)
            output += network[NODE_WEIGHT, j] * value
    return min(max(output, -c.control_limit), c.control_limit)  # type: ignore[no-any-return]


@compiled
def _supervise(c: np.record, s: np.record, error: float, without: float, expected: float) -> None:
    """Compare the error with the one expected without feedforward, and fade the feedforward out or in."""
    if s.share == 0.0 or s.share == 1.0:
        seen = error if s.share == 1.0 else expected
        s.square_with += c.mean_step * (seen * seen - s.square_with)
        s.square_without += c.mean_step * (without * without - s.square_without)
        s.recent_with += c.recent_step * (seen * seen - s.recent_with)
        s.recent_without += c.recent_step * (without * without - s.recent_without)
    s.settling_left = max(s.settling_left - 1.0, 0.0)
    s.pause_left = max(s.pause_left - 1.0, 0.0)
    if c.supervises == 0.0:
        s.is_off = 0.0
    elif s.is_off == 0.0 and s.share == 1.0:
        bursts = s.recent_with > _GROSS * max(s.recent_without, s.square_without)
        harms = s.settling_left == 0.0 and s.square_with > c.trip_ratio * s.square_without
        if bursts or harms:
            s.is_off = 1.0
            s.switched_off += 1.0
            s.pause_left = s.next_pause
            s.next_pause = min(2.0 * s.next_pause, _LONGEST_PAUSE * c.pause)
        if bursts:
            s.share = 0.0
    elif s.is_off != 0.0 and s.pause_left == 0.0 and s.square_with < c.return_ratio * s.square_without:
        s.is_off = 0.0
        s.settling_left = c.settling
        s.square_with = s.square_without
    if c.is_enabled != 0.0 and s.is_off == 0.0:
        s.share = min(s.share + c.fade_step, 1.0)
    else:
        s.share = max(s.share - c.fade_step, 0.0)


@compiled
def _norm(weights: Array) -> float:
    """Return the Euclidean norm of the weights of both channels."""
    total = 0.0
    for i in range(weights.shape[1]):
        total += weights[0, i] * weights[0, i] + weights[1, i] * weights[1, i]
    return math.sqrt(total)
