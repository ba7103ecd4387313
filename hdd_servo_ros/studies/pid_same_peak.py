"""PID controller with the least error at the peak control of the adaptive NN controller, for section 4.4."""

import copy
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import differential_evolution, minimize

from hdd_servo_ros.analysis.largest_gains import round_down, round_up
from hdd_servo_ros.analysis.metrics import TrackingMetrics
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.tuning_runs import Sections, metrics_of

DURATION = 20.0
"""Duration of the runs [s]; the error is evaluated over the last half."""
SHORT = 0.2
"""Duration of the runs in the global search over ``DURATION``: the peak is at the start, and a PID settles soon."""
COARSE = 1e-3
"""Sample time of the global search [s]."""
RANGES = ((1.0, 1e3), (1e-3, 1e5), (0.1, 10.0))
"""Search ranges of k_p [1/s], k_i [1/s^2] and k_d, relative to the feedback gain k of the adaptive NN."""
LEAST_INTEGRAL = 0.01
"""Minimum k_i / k_p [1/s]; a smaller k_i has no effect in 20 s, and is set to 0."""
Gains = tuple[float, ...]

_EXCESS_COST = 1e3
"""Relative increase of the cost per relative excess of the peak control."""


def tune_pid_same_peak(
    sections: Sections, sample_time: float, report: Callable[[str], None] = lambda line: None
) -> dict[str, object]:
    """
    Return the PID gains with the least error at the peak control of the adaptive NN controller in ``sections``.

    Differential evolution with short runs and a coarse sample time finds the starting point of Nelder-Mead searches,
    first with short runs, then with full ones.

    Parameters
    ----------
    sections
        Parameters of all blocks; the feedback gain k of the adaptive NN controller sets the scale of the search.
    sample_time
        T [s].
    report
        Receives lines of text about the progress.
    """
    peak = _metrics(Experiment(sample_time, 'adaptive_nn', sections), DURATION).peak_control
    own: AdaptiveNnParameters = block_parameters('adaptive_nn_controller', sections.get('adaptive_nn_controller', {}))

    time_steps = {sample_time, max(sample_time, COARSE)}
    at_rest = {time_step: Experiment(time_step, 'pid', sections) for time_step in time_steps}

    def found(law: Gains, duration: float, time_step: float = sample_time) -> TrackingMetrics:
        pid = block_parameters('pid_controller', {**sections.get('pid_controller', {}), **_named(law)})
        # Copying takes a third of the time of a new experiment, which checks its parameters; the rows are equal.
        experiment = copy.deepcopy(at_rest[time_step])
        experiment.update('pid_controller', {PidParameters: pid})
        return _metrics(experiment, duration)

    def cost(law: Gains, duration: float, time_step: float = sample_time) -> float:
        metrics = found(law, duration, time_step)
        # Finite, because differential evolution computes with the costs.
        if not math.isfinite(metrics.rms_error):
            return 1e9
        return metrics.rms_error * (1.0 + _EXCESS_COST * max(0.0, metrics.peak_control / peak - 1.0))

    def cost_at(exponents: Sequence[float], duration: float, time_step: float) -> float:
        return cost(_gains(exponents), duration, time_step)

    best = differential_evolution(
        cost_at,
        [(math.log(low * own.feedback_gain), math.log(high * own.feedback_gain)) for low, high in RANGES],
        args=(SHORT * DURATION, max(sample_time, COARSE)),
        popsize=12,
        maxiter=80,
        tol=1e-4,
        mutation=(0.4, 0.9),
        recombination=0.9,
        seed=1,
        polish=False,
    ).x
    report(f'global search: {_named(_gains(best))}')
    # Restart at the result: at the limit of the peak control a simplex may collapse too early.
    for duration in (SHORT * DURATION, SHORT * DURATION, DURATION, DURATION):
        simplex = np.vstack([best, best + 0.1 * np.eye(3)])
        options = {'initial_simplex': simplex, 'maxfev': 80, 'xatol': 1e-4, 'fatol': 1e-9}
        best = minimize(cost_at, best, args=(duration, sample_time), method='Nelder-Mead', options=options).x
    near = itertools.product(*({round_down(gain), round_up(gain)} if gain else {0.0} for gain in _gains(best)))
    rounded = min(near, key=lambda law: cost(law, DURATION))
    last = found(rounded, DURATION)
    report(f'local search: rms error {last.rms_error:.3g}, peak control {last.peak_control:.4g}, limit {peak:.4g}')
    return _named(rounded)


def _gains(exponents: Sequence[float]) -> Gains:
    """Return the gains at a point of the search, given as logarithms."""
    proportional, integral, derivative = (math.exp(exponent) for exponent in exponents)
    return proportional, integral if integral > LEAST_INTEGRAL * proportional else 0.0, derivative


def _named(law: Gains) -> dict[str, object]:
    """Return the gains under their ROS parameter names."""
    return dict(zip(('proportional_gain', 'integral_gain', 'derivative_gain'), law, strict=True))


def _metrics(experiment: Experiment, duration: float) -> TrackingMetrics:
    rows = experiment.run(0, round(duration / experiment.sample_time) + 1)
    return metrics_of(rows, 0.5 * duration, unit=1.0)
