"""Warnings about a low stability margin before a run, if the drive is known."""

import dataclasses
import functools
import math

import numpy as np

from hdd_servo_ros.analysis.frozen_estimates import FrozenLoop, allowed_estimates, initial_estimates
from hdd_servo_ros.analysis.linear_laws import FrozenEstimates, pid_law
from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LoopMargins
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.control.controller import Controller, WarnsBeforeRun
from hdd_servo_ros.control.observer import ObserverParameters
from hdd_servo_ros.control.pid import Pid
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales

MAX_ADAPTED_SENSITIVITY = 2.2
"""
Largest Ms with adapted estimates: :data:`MAX_SENSITIVITY` plus a tenth for the effect of adaptation.

The gains are tuned for :data:`MAX_SENSITIVITY` at initial estimates. At 2.2 the gain margin
is still 1/(1 - 1/2.2) = 1.8, and the phase margin 26 degrees.
"""


ROUNDING = 0.01
"""Tolerance of Ms above :data:`MAX_SENSITIVITY` without a warning, since tuned gains are rounded."""


@dataclasses.dataclass(frozen=True)
class LoopSurroundings:
    """The loop without its controller: drive, sensor, delay."""

    plant: PlantParameters
    sample_time: float
    """Sample time T [s]."""
    delay: int = 0
    """Delay of u [samples]."""
    sensor: LdvParameters | None = None
    """The vibrometer; None for an ideal sensor."""
    scales: SensorScales | None = None
    """Sensor scales of the controller; None for those of the sensor."""
    observer: ObserverParameters | None = None
    """Velocity observer of the controller, with the servo sensor."""
    dsp: DspParameters | None = None
    """Command path, of which filters and updates count; None for a command that is held over the sample."""

    @functools.cached_property
    def margins(self) -> LoopMargins:
        """The linear loop with this drive."""
        # The margins do not depend on the seed, which differs between the runs of a campaign.
        sensor = None if self.sensor is None else dataclasses.replace(self.sensor, seed=0)
        # Of the command path, filters and interpolation change the margins here; the delay is part of the controller.
        dsp = None
        if self.dsp is not None and self.dsp.is_filtered:
            dsp = dataclasses.replace(self.dsp.without_converter, computation_delay=0)
        return _margins(self.plant, self.sample_time, sensor, self.scales, self.observer, dsp)

    def frozen_loop(self, controller: AdaptiveNn, delay: int | None = None) -> FrozenLoop:
        """Return the loop with an adaptive NN controller with frozen estimates; ``delay`` overrides the delay."""
        return FrozenLoop(self.margins, controller, self.delay if delay is None else delay)


@functools.lru_cache(4)
def _margins(
    plant: PlantParameters,
    sample_time: float,
    sensor: LdvParameters | None,
    scales: SensorScales | None,
    observer: ObserverParameters | None,
    dsp: DspParameters | None,
) -> LoopMargins:
    """Return the linear loop with a drive, cached for runs that differ only in the controller."""
    return LoopMargins(plant, sample_time, sensor, scales, observer, dsp)


def peak_sensitivity(controller: AdaptiveNn, plant: PlantParameters, delay: int = 0) -> float:
    """
    Return Ms with the initial estimates, the larger of presliding and sliding.

    Parameters
    ----------
    controller
        The controller, with its sample time T.
    plant
        The drive.
    delay
        Delay of u [samples].

    Returns
    -------
    float
        Infinity if the loop is unstable.
    """
    loop = LoopSurroundings(plant, controller.sample_time, delay).frozen_loop(controller)
    return loop.peak_sensitivity(initial_estimates(controller))


UNCOMPUTABLE = (ArithmeticError, ValueError)
"""Exceptions of linear algebra for a loop whose values overflow."""
UNKNOWN_MARGIN = 'the stability margin of this loop cannot be computed'


def warnings(controller: Controller, loop: LoopSurroundings) -> tuple[str, ...]:
    """
    Return the warnings about a controller before a run, one line each.

    For an adaptive NN controller the loop with this drive is checked with the initial estimates and with all estimates
    that projection allows, instead of comparing the gain on r with ``safe_gain``. For a PID controller the loop is
    checked. Other controllers return their own warnings.
    """
    try:
        with np.errstate(all='ignore'):
            if isinstance(controller, Pid):
                return _pid_warnings(controller, loop)
            if isinstance(controller, AdaptiveNn):
                return _adaptive_nn_warnings(controller, loop)
    except UNCOMPUTABLE as error:
        return (f'{UNKNOWN_MARGIN}: {type(error).__name__}: {error}',)
    return tuple(controller.warnings()) if isinstance(controller, WarnsBeforeRun) else ()


def _pid_warnings(controller: Pid, loop: LoopSurroundings) -> tuple[str, ...]:
    p = controller.parameters
    if p.proportional_gain == 0.0:
        # The loop does not hold the position.
        return ()
    ms = loop.margins.peak_sensitivity(pid_law(p, loop.delay))
    if ms <= MAX_SENSITIVITY + ROUNDING:
        return ()
    return (
        f'low stability margin: the loop with this drive, at T = {loop.sample_time:g} s, '
        f'{_in_words(ms, MAX_SENSITIVITY)}: tune it (ros2 run hdd_servo_ros tune)',
    )


def _adaptive_nn_warnings(controller: AdaptiveNn, loop: LoopSurroundings) -> tuple[str, ...]:
    frozen = loop.frozen_loop(controller)
    initial, allowed = initial_estimates(controller), allowed_estimates(controller)
    lines = []
    ms = frozen.peak_sensitivity(initial)
    if ms > MAX_SENSITIVITY + ROUNDING:
        at = f' with {named_estimates(initial, loop.plant)}' if any(initial) else ''
        lines.append(
            f"low stability margin: k + 1/sigma_phi + max(S'S)/sigma_w = {controller.gain_on_r:.3g} "
            f'{_unit("sigma_hat", loop.plant)} acts as one linear gain on r; the loop of this gain and this drive, '
            f'at T = {loop.sample_time:g} s,{at} {_in_words(ms, MAX_SENSITIVITY)}; it may track at first and diverge '
            'after seconds: raise phi.leakage or network.leakage, lower feedback_gain or error_filter_lambda, or tune '
            'it (ros2 run hdd_servo_ros tune)'
        )
    if allowed.unbounded and not lines:
        ranges = (_safe_range(frozen, initial, name, loop.plant) for name in allowed.unbounded)
        lines.append(
            f'no bounds for {" and ".join(allowed.unbounded)} (projection is false): the loop with this drive has a '
            f'peak sensitivity of {ms:.3g} with {named_estimates(initial, loop.plant)}, and of at most '
            f'{MAX_ADAPTED_SENSITIVITY:g} only with {", or with ".join(ranges)}; the estimates may leave this range'
        )
    if allowed.act_on_loop and not allowed.unbounded:
        worst, where = frozen.worst(allowed)
        if worst > MAX_ADAPTED_SENSITIVITY:
            lines.append(
                f'low stability margin: projection allows {named_estimates(where, loop.plant)}; with these, the loop '
                f'with this drive, at T = {loop.sample_time:g} s, {_in_words(worst, MAX_ADAPTED_SENSITIVITY)}: '
                'narrow minimum and maximum of sigma and mass, or lower error_filter_lambda'
            )
    return *lines, *controller.sign_warnings()


def _in_words(ms: float, limit: float) -> str:
    return 'is unstable' if math.isinf(ms) else f'has a peak sensitivity of {ms:.3g}, above {limit:g}'


def named_estimates(estimates: FrozenEstimates, plant: PlantParameters) -> str:
    """Return estimates with their names and units."""
    return ' and '.join(f'{name} = {value:.3g} {_unit(name, plant)}' for name, value in estimates._asdict().items())


def _unit(name: str, plant: PlantParameters) -> str:
    """Return the unit of an estimate."""
    return f'{plant.control_unit} {"s" if name == "sigma_hat" else "s^2"}/{plant.length_unit}'


def _safe_range(loop: FrozenLoop, initial: FrozenEstimates, name: str, plant: PlantParameters) -> str:
    """Return the range of an estimate that keeps the margin, with the other at its initial value, as text."""
    low, high = loop.safe_range(initial, name, MAX_ADAPTED_SENSITIVITY)
    return f'{name} from {low:.2g} to {high:.2g} {_unit(name, plant)}'
