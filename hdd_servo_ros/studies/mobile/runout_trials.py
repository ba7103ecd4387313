"""Repetitions of runs with repeatable runout for other seeds and parameters, and the effect of the cancellation."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.analysis.runout_sensitivity import linear_law, runout_margin
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.mobile.runout_cases import ALONE, FIRST, method_of
from hdd_servo_ros.studies.mobile.trials import Trial, with_changes

REVOLUTIONS = 480
"""Number of revolutions in a trial: four seconds at 7200 1/min."""
_SETTLED = 20
"""Number of revolutions after which the error from repeatable runout alone is periodic."""


class RunoutResult(NamedTuple):
    """Errors of a run with cancellation, relative to the same run without it."""

    rpe: float
    """
    RPE without cancellation, peak to peak after the first ten revolutions [nm].

    With the method ``harmonics``, all RPEs contain only the orders of the method.
    """
    rpe_ratio: float
    """RPE with / without cancellation."""
    nrpe_ratio: float
    """NRPE with / without cancellation."""
    stopped_ratio: float
    """RPE with / without cancellation, if it stops learning after ten revolutions."""
    noise_ratio: float
    """
    The same for an ideal mean of the error over revolutions 2 to 10.

    This mean contains the non-repeatable errors of the nine revolutions: no unbiased estimate from them is better.
    """


def track_errors(trial: Trial, method: str, revolutions: int, stop: int | None = None) -> NDArray[np.float64]:
    """
    Return the true track error in each revolution [um], shape (revolutions, sectors).

    Parameters
    ----------
    trial
        Run to repeat.
    method
        Method of cancellation.
    revolutions
        Duration in revolutions.
    stop
        Number of revolutions after which the cancellation stops learning; None for never.
    """
    experiment = experiment_of(trial, method)
    sectors = sectors_of(trial)
    first = revolutions if stop is None else stop
    rows = experiment.run(0, first * sectors)
    errors = [rows.track_error]
    if stop is not None and experiment.runout is not None:
        runout = experiment.runout
        runout.update(dataclasses.replace(runout.parameters, learning=False), runout.path)
        errors.append(experiment.run(first * sectors, (revolutions - first) * sectors).track_error)
    return np.concatenate(errors).reshape(-1, sectors)


def experiment_of(trial: Trial, method: str) -> Experiment:
    """Return the experiment of a trial with a method of cancellation."""
    parameters = with_changes(trial.parameters, {method_of(trial.controller): method})
    return Experiment(trial.sample_time, trial.controller, parameters, sensor='servo')


def sectors_of(trial: Trial) -> int:
    """Return the number of servo sectors per revolution."""
    return int(trial.parameters['servo_sensor']['sectors'])


def effect(trial: Trial) -> RunoutResult:
    """Return the effect of the cancellation of a trial."""
    sectors, method = sectors_of(trial), _method(trial)
    without = track_errors(trial, 'none', REVOLUTIONS)
    found = track_errors(trial, method, REVOLUTIONS)
    stopped = track_errors(trial, method, REVOLUTIONS, stop=FIRST)
    parts = [runout_parts(errors[FIRST:].ravel(), sectors) for errors in (without, found, stopped)]
    wrong = without[1:FIRST].mean(axis=0) - parts[0].repeatable
    rpe, *others = (float(np.ptp(_of_orders(trial, mean))) for mean in (*(each.repeatable for each in parts), wrong))
    nrpe_ratio = parts[1].non_repeatable_three_sigma / parts[0].non_repeatable_three_sigma
    return RunoutResult(NANOMETRES * rpe, others[0] / rpe, nrpe_ratio, others[1] / rpe, others[2] / rpe)


def _of_orders(trial: Trial, mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a mean by sector, reduced to its orders for the method ``harmonics``."""
    if _method(trial) != 'harmonics':
        return mean
    orders = list(trial.parameters[f'{trial.controller}_controller']['runout.orders'])
    spectrum = np.fft.rfft(mean)
    kept = np.zeros_like(spectrum)
    kept[orders] = spectrum[orders]
    return np.fft.irfft(kept, len(mean))


def effect_alone(trial: Trial) -> float:
    """Return the error ratio with / without cancellation after ten revolutions, from runout alone."""
    alone = dataclasses.replace(trial, parameters=with_changes(trial.parameters, ALONE))
    without = track_errors(alone, 'none', _SETTLED + 1)[_SETTLED]
    found = track_errors(alone, _method(trial), FIRST + 1)[FIRST]
    return float(np.ptp(found) / np.ptp(without))


def peak_sensitivities(trial: Trial) -> tuple[float, float]:
    """Return the peak sensitivity without and with the cancellation; infinity if the loop is unstable."""
    experiment = experiment_of(trial, _method(trial))
    delay = experiment.dsp.parameters.computation_delay
    assert experiment.observer is not None
    assert experiment.runout is not None
    loop = LoopSurroundings(
        experiment.plant.parameters, trial.sample_time, delay, observer=experiment.observer.parameters
    )
    law = linear_law(experiment.controller, delay)
    assert law is not None
    margin = runout_margin(loop.margins, law, experiment.runout.parameters, experiment.runout.path)
    return loop.margins.peak_sensitivity(law), margin.peak


def _method(trial: Trial) -> str:
    node, name = method_of(trial.controller).split(':')
    return str(trial.parameters[node][name])
