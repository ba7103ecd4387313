"""Peak sensitivity and stability of a loop with runout cancellation, at its steady gain."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.fragility import ROUNDING, LoopSurroundings
from hdd_servo_ros.analysis.frozen_estimates import initial_estimates
from hdd_servo_ros.analysis.linear_laws import frozen_law, pid_law
from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LinearController, LoopMargins
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.pid import Pid
from hdd_servo_ros.control.runout import samples_per_revolution
from hdd_servo_ros.control.runout_parameters import RunoutParameters
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters

MAX_RUNOUT_SENSITIVITY = 2.2
"""Largest peak sensitivity with the cancellation: 10 % above that without it."""
_PHASES = 64
"""Number of phases of exp(-2 pi j f T N) in the search for the worst sensitivity between two harmonics."""
_BESIDE = np.concatenate([-np.geomspace(0.5, 1e-3, 60), np.geomspace(1e-3, 0.5, 60)])
"""Frequencies next to a harmonic, in revolutions per second over the speed."""


class RunoutMargin(NamedTuple):
    """Effect of the cancellation on a loop."""

    peak: float
    """Peak sensitivity, infinite if the loop is unstable."""
    slowest: float
    """Largest factor per revolution of the remaining error of an order; it diverges from 1 on."""
    worst_order: int
    """The order with that factor."""


def linear_law(controller: Controller, delay: int) -> LinearController | None:
    """Return the linear form of a controller of this package with initial estimates; None for a custom one."""
    if isinstance(controller, Pid):
        return pid_law(controller.parameters, delay)
    if isinstance(controller, AdaptiveNn):
        return frozen_law(controller, initial_estimates(controller), delay)
    return None


def runout_margin(
    margins: LoopMargins, law: LinearController, runout: RunoutParameters, path: NDArray[np.float64]
) -> RunoutMargin:
    """
    Return the margin of a loop with the cancellation, the worse of presliding and sliding.

    With S of the loop without it, H the response of the error to the voltage and the steady gain g, the sensitivity is
    S/(1 + H C). For ``harmonics``, C is a sum of resonators at the orders: e -> u_rro is linear and time-invariant
    (Bodson, Sacks and Khosla, 1994), and the poles of the loop are computed. For ``repetitive``, with H_m the model's
    response and

        W = (Q/H_m) g z^-N/(1 - (1 - g) z^-N),    1 + H C = (1 + W (H - H_m))/(1 - W H_m),

    each order k changes per revolution by the factor 1 - g (1 + Q (H/H_m - 1)), and the peak is taken over all
    frequencies and all phases of z^-N. Both hold for slowly changing orders: the restart of the filter in each
    revolution and the memory of the path are neglected.

    Parameters
    ----------
    margins
        The drive.
    law
        The controller.
    runout
        The cancellation.
    path
        Pulse response used by the cancellation, from :func:`~hdd_servo_ros.analysis.feedforward_path.runout_path`.
    """
    makes = _harmonics if runout.method == 'harmonics' else _repetitive
    found = [makes(margins, law, runout, path, index) for index in range(len(margins.drives))]
    if not math.isfinite(margins.peak_sensitivity(law)):
        worst = max(found, key=lambda each: each.slowest)
        return worst._replace(peak=math.inf)
    return max(found, key=lambda each: each.peak)


def _diverges_at_first(
    margins: LoopMargins, law: LinearController, runout: RunoutParameters, path: NDArray[np.float64]
) -> bool:
    """Return whether ``harmonics`` is unstable with its larger initial gain."""
    if runout.method != 'harmonics' or runout.initial_gain <= runout.gain:
        return False
    first = dataclasses.replace(runout, gain=runout.initial_gain)
    return math.isinf(runout_margin(margins, law, first, path).peak)


def _turns(runout: RunoutParameters, sample_time: float) -> float:
    samples = samples_per_revolution(runout, sample_time)
    return 1.0 / samples if samples else runout.revolutions_per_minute * sample_time / 60.0


def _model(path: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the response of a pulse response at frequencies in cycles per sample."""
    return np.asarray(np.exp(-2j * np.pi * np.outer(turns, np.arange(len(path)))) @ path)


def _harmonics(
    margins: LoopMargins, law: LinearController, runout: RunoutParameters, path: NDArray[np.float64], index: int
) -> RunoutMargin:
    turns, sample_time = _turns(runout, margins.sample_time), margins.sample_time
    orders = np.array(runout.orders, dtype=np.float64)
    model = _model(path, orders * turns)
    gains = 2.0 * runout.gain * turns / np.abs(model)
    phases = np.exp(1j * np.angle(model))
    steps = np.exp(2j * np.pi * orders * turns)
    drive = margins.drives[index]
    loop = law.closed_loop(drive)
    size, count = len(loop), len(orders)
    entered = np.zeros(size)
    if law.delay:
        entered[-1] = 1.0
    else:
        entered[: len(drive.a)] = drive.b[:, 0]
    position = np.zeros(size)
    position[: len(drive.a)] = drive.c[0]
    # The states of an order are a - j b in the fixed frame.
    whole = np.zeros((size + 2 * count, size + 2 * count))
    whole[:size, :size] = loop - np.outer(entered, position) * float(np.sum(gains * phases.real))
    for i in range(count):
        first = size + 2 * i
        whole[:size, first] = entered
        turned = np.array([[steps[i].real, -steps[i].imag], [steps[i].imag, steps[i].real]])
        correction = -gains[i] * steps[i] * phases[i].conjugate()
        whole[first : first + 2, first : first + 2] = turned
        whole[first, :size] = correction.real * position
        whole[first + 1, :size] = correction.imag * position
    radius = float(np.abs(np.linalg.eigvals(whole)).max())
    frequencies = np.concatenate([margins.frequencies, *((order + _BESIDE) * turns / sample_time for order in orders)])
    frequencies = np.unique(frequencies[(frequencies > 0.0) & (frequencies <= 0.5 / sample_time)])
    z = np.exp(2j * np.pi * frequencies * sample_time)[:, None]
    resonators = phases.conjugate() / (1.0 - steps / z) + phases / (1.0 - steps.conjugate() / z)
    canceling = 0.5 * (gains * resonators).sum(axis=1)
    sensitivity = margins.sensitivity(law, index, frequencies)
    peak = float(np.abs(sensitivity / (1.0 + margins.path(law, index, frequencies) * canceling)).max())
    responses = margins.path(law, index, orders * turns / sample_time) / model
    factors = np.abs(1.0 - runout.gain * responses)
    worst = int(np.argmax(factors))
    return RunoutMargin(peak if radius < 1.0 else math.inf, float(factors[worst]), runout.orders[worst])


def _repetitive(
    margins: LoopMargins, law: LinearController, runout: RunoutParameters, path: NDArray[np.float64], index: int
) -> RunoutMargin:
    sample_time, gain = margins.sample_time, runout.gain
    samples = len(path) - 1
    orders = np.arange(1, (samples + 1) // 2)
    ratios = _low_pass(runout, orders / (samples * sample_time)) * (
        margins.path(law, index, orders / (samples * sample_time)) / _model(path, orders / samples) - 1.0
    )
    factors = np.abs(1.0 - gain * (1.0 + ratios))
    worst = int(np.argmax(factors))
    if factors[worst] >= 1.0:
        return RunoutMargin(math.inf, float(factors[worst]), int(orders[worst]))
    frequencies = np.unique(np.concatenate([margins.frequencies, orders / (samples * sample_time)]))
    # No learning above the highest order.
    frequencies = frequencies[frequencies <= orders[-1] / (samples * sample_time)]
    low_pass = _low_pass(runout, frequencies)[:, None]
    ratio = (margins.path(law, index, frequencies) / _model(path, frequencies * sample_time))[:, None]
    late = np.exp(2j * np.pi * np.arange(_PHASES) / _PHASES)
    averaged = gain * late / (1.0 - (1.0 - gain) * late)
    factor = (1.0 - low_pass * averaged) / (1.0 + low_pass * averaged * (ratio - 1.0))
    peaks = np.abs(margins.sensitivity(law, index, frequencies)) * np.abs(factor).max(axis=1)
    peak = max(float(peaks.max()), float(np.abs(margins.sensitivity(law, index, margins.frequencies)).max()))
    return RunoutMargin(peak, float(factors[worst]), int(orders[worst]))


def _low_pass(runout: RunoutParameters, frequencies: NDArray[np.float64]) -> NDArray[np.float64]:
    if not runout.cutoff:
        return np.ones_like(frequencies)
    return np.asarray(1.0 / (1.0 + (frequencies / runout.cutoff) ** 8))


def speed_warnings(runout: RunoutParameters, disturbance: DisturbanceParameters | None) -> tuple[str, ...]:
    """Return a warning if the speed of the cancellation differs from that of the spindle."""
    if disturbance is None or not disturbance.runout.repeatable.enabled:
        return ()
    own, spindle = runout.revolutions_per_minute, disturbance.spindle.revolutions_per_minute
    if math.isclose(own, spindle, rel_tol=1e-9):
        return ()
    return (
        f'cancellation of runout: runout.revolutions_per_minute is {own:g}, but the spindle of disturbance_generator '
        f'turns at {spindle:g} 1/min: the runout does not repeat at the other speed',
    )


def runout_warnings(
    controller: Controller, loop: LoopSurroundings, runout: RunoutParameters, path: NDArray[np.float64]
) -> tuple[str, ...]:
    """
    Return a warning if the cancellation makes the loop unstable, or its margin too low.

    A loop that is so without the cancellation has the warning of :func:`~hdd_servo_ros.analysis.fragility.warnings`.
    """
    law = linear_law(controller, loop.delay)
    if law is None:
        return ()
    without = loop.margins.peak_sensitivity(law)
    if math.isinf(without):
        return ()
    found = runout_margin(loop.margins, law, runout, path)
    where = f'runout.method {runout.method}, at T = {loop.sample_time:g} s'
    if math.isfinite(found.peak) and _diverges_at_first(loop.margins, law, runout, path):
        return (
            f'cancellation of runout: the loop is unstable with the gain of the first revolutions ({where}): lower '
            f'runout.initial_gain, {runout.initial_gain:g}, or the number of runout.orders, {len(runout.orders)}',
        )
    if found.peak <= max(MAX_RUNOUT_SENSITIVITY + ROUNDING, MAX_RUNOUT_SENSITIVITY / MAX_SENSITIVITY * without):
        return ()
    if found.slowest >= 1.0:
        remedy = 'remove the order' if runout.method == 'harmonics' else 'lower runout.cutoff'
        return (
            f'cancellation of runout: order {found.worst_order} diverges ({where}), since the model is wrong there: '
            f'correct runout.model, or {remedy}',
        )
    if math.isinf(found.peak):
        return (f'cancellation of runout: the loop with it is unstable ({where})',)
    return (
        f'cancellation of runout: the loop with it has a peak sensitivity of {found.peak:.3g}, above '
        f'{MAX_RUNOUT_SENSITIVITY:g} ({where}): lower runout.gain, or tune the controller',
    )
