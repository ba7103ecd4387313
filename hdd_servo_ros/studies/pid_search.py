"""The PID controller with the least error on sines under a peak sensitivity and a limit of the overshoot."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution, minimize

from hdd_servo_ros.analysis.largest_gains import (
    largest_gain_on_r,
    largest_lambda,
    largest_proportional_gain,
    round_down,
    round_up,
)
from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LinearController, LoopMargins
from hdd_servo_ros.analysis.sine_error import SineErrors, command_harmonics
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.block_parameters import block_parameters, dsp_parameters
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.studies.tuning_runs import FREQUENCIES, Sections, Steps, run_sine, track

OVERSHOOT = 20.0
"""Of steps, by default [%]."""
DERIVATIVE_SHARES = (0.1, 6.0)
"""Range of k_d, over the largest without a filter."""
HUMP = math.sqrt(FREQUENCIES[0] * FREQUENCIES[1])
"""
Where the two searched ranges of sqrt(k_i/k_d)/(2 pi) meet [Hz]. About there the error has a maximum over k_i, since the
integral takes off what the derivative gives: |C|^2 = k_p^2 + (k_d w - k_i/w)^2.
"""
LARGEST_POLE = 0.9
"""Of the derivative's filter."""
LEAST_POLE = 0.005
"""Below it the derivative's filter is left out."""
INTEGRAL_COST = 1.05
"""What the integral may cost of the squared error, where steps count."""
_REJECTED = 1e9
"""Cost of what breaks the rule, beyond any squared error [um^2]."""
_SINE_DURATION, _SINE_TRANSIENT = 1.0, 0.5
"""Of the simulated sines [s]."""
_FIRST_POINTS, _POPULATION = 500, 60
"""Random points of which the global search takes the best, and how many it takes."""
_START = (0.7, 0.0)
"""k_d, over the largest without a filter, and k_i of the controller from whose run the command is taken."""


Objective = Callable[[LinearController], float]


def computation_delay(sections: Sections, node: str) -> int:
    """Return by how many samples a controller's command comes late."""
    return dsp_parameters(node, sections.get(node, {})).computation_delay


def pid_gains(law: LinearController) -> dict[str, object]:
    """Return the gains of the PID controller that acts as ``law``, under their ROS names."""
    return {
        'proportional_gain': law.proportional,
        'integral_gain': law.integral,
        'derivative_gain': law.derivative,
        'derivative_bandwidth': law.bandwidth,
    }


class PidSearch:
    """
    The search for one drive; its parts are explained in :mod:`~hdd_servo_ros.studies.tune`.

    The errors on sines are estimated in the global search and simulated in the local one. At each point of the search
    k_p is the largest that the peak sensitivity allows.

    Parameters
    ----------
    plant
        The drive, also in ``sections``.
    sample_time
        T [s].
    sections
        Parameters of drive and vibrometer for the runs, and of the PID controller its computation delay.
    overshoot
        Largest overshoot of steps [%]; infinity for no limit.
    report
        Receives lines of text on the progress.
    """

    def __init__(
        self,
        plant: PlantParameters,
        sample_time: float,
        sections: Sections,
        overshoot: float,
        report: Callable[[str], None],
    ) -> None:
        self._sample_time = sample_time
        self._sections = sections
        self._overshoot = overshoot
        self._report = report
        self._margins = LoopMargins(plant, sample_time)
        self._delay = computation_delay(sections, 'pid_controller')
        self._steps = Steps(sections, sample_time)
        # With hardly any k_p and no filter, k_d could reach this far.
        self._reach = largest_gain_on_r(
            self._margins, largest_lambda(self._margins, 100.0, delay=self._delay), delay=self._delay
        )
        # The searched range of sqrt(k_i/k_d)/(2 pi), up to where k_d alone would have a loop gain of 1. [Hz]
        crossover = max(plant.rigid_gain * self._reach / (2.0 * math.pi), 2.0 * HUMP)
        self._whole = (0.1 * HUMP, crossover)
        self._estimate = self._estimate_of_errors(plant)

    def _estimate_of_errors(self, plant: PlantParameters) -> SineErrors:
        start = self._law(_START[0] * self._reach, _START[1], 0.0)
        commands = {}
        for frequency in FREQUENCIES:
            rows = run_sine('pid', pid_gains(start), self._sections, self._sample_time, frequency, _SINE_DURATION)
            last = rows.control[-round((_SINE_DURATION - _SINE_TRANSIENT) / self._sample_time) :, 0]
            commands[frequency] = command_harmonics(last, frequency, self._sample_time)
        ldv: LdvParameters = block_parameters('ldv_sensor', self._sections.get('ldv_sensor', {}))
        noise = (ldv.displacement_noise, ldv.velocity_noise) if ldv.noise else (0.0, 0.0)
        return SineErrors(plant, self._sample_time, commands, *noise)

    def _law(self, derivative: float, integral: float, bandwidth: float, digits: int = 15) -> LinearController:
        """Return the controller with the largest k_p that the peak sensitivity allows; 0 if it allows none."""
        law = LinearController(0.0, derivative, integral, bandwidth, self._delay)
        proportional = largest_proportional_gain(self._margins, law)
        return dataclasses.replace(law, proportional=round_down(proportional, digits) if proportional > 0.0 else 0.0)

    def _at(self, point: Sequence[float]) -> LinearController:
        """Return the controller at a point of the search: logarithms of k_d and k_i/k_d, and the filter's pole."""
        share, frequency, pole = point
        derivative = math.exp(share) * self._reach
        bandwidth = -math.log(pole) / (2.0 * math.pi * self._sample_time) if pole > LEAST_POLE else 0.0
        return self._law(derivative, derivative * (2.0 * math.pi * math.exp(frequency)) ** 2, bandwidth)

    def _checked(self, objective: Objective) -> Callable[[Sequence[float]], float]:
        """
        Return the cost of a point: an objective where the rule is kept, more than any such where it is broken.

        A point that is no better than another one which keeps the rule needs no runs on steps: it is not the minimum.
        """
        best = math.inf

        def cost(point: Sequence[float]) -> float:
            nonlocal best
            law = self._at(point)
            if law.proportional == 0.0:
                return 1e3 * _REJECTED
            value = objective(law)
            if value < best:
                excess = self._excess(law)
                if excess > 0.0:
                    return _REJECTED * (1.0 + min(excess, 100.0))
                best = value
            return value

        return cost

    def _excess(self, law: LinearController) -> float:
        """Return by how much the overshoot is beyond its limit [%]."""
        if math.isinf(self._overshoot):
            return 0.0
        return self._steps.overshoot(pid_gains(law), self._overshoot) - self._overshoot

    def _estimated(self, law: LinearController) -> float:
        """Return the estimated sum of the mean squared errors on the sines [um^2]."""
        return sum(self._estimate.mean_squares(law).values())

    def _simulated(self, law: LinearController) -> float:
        """Return the sum of the mean squared errors on the simulated sines [nm^2]."""
        return sum(error**2 for error in self.errors(law))

    def errors(self, law: LinearController) -> list[float]:
        """Return the simulated rms errors on the sines [nm]."""
        runs = (
            track('pid', pid_gains(law), self._sections, self._sample_time, f, _SINE_DURATION, _SINE_TRANSIENT)
            for f in FREQUENCIES
        )
        return [run.rms_error for run in runs]

    def run(self) -> LinearController:
        """Search, and return the controller; its gains have three digits or fewer."""
        point, estimate = self._best_by_estimate()
        point = self._improved(self._simulated, point)
        found = self._at(point)
        self._report(f'least error: {self._described(found)}')
        if math.isinf(self._overshoot):
            return self._rounded(found)
        point = self._minimum(_integral_within(self._estimated, INTEGRAL_COST * estimate), self._whole, point).x
        affordable = _integral_within(self._simulated, INTEGRAL_COST * self._simulated(found))
        found = self._at(self._improved(affordable, point))
        self._report(f'largest integral: {self._described(found)}')
        return self._rounded(found)

    def _described(self, law: LinearController) -> str:
        errors = ' and '.join(
            f'{error:.1f} nm at {f:g} Hz' for error, f in zip(self.errors(law), FREQUENCIES, strict=True)
        )
        return f'k_i = {law.integral:.3g} V/(um s), rms errors of {errors}'

    def _minimum(
        self, objective: Objective, integral_range: tuple[float, float], start: Sequence[float] = ()
    ) -> OptimizeResult:
        """Search all k_d and filters, and a range of sqrt(k_i/k_d)/(2 pi) [Hz], with ``start`` among the first."""
        cost = self._checked(objective)
        bounds = _bounds(integral_range)
        # Few points have any k_p, so that a search that began with some dozens of them might not find one.
        low, high = np.transpose(bounds)
        points = low + (high - low) * np.random.default_rng(1).random((_FIRST_POINTS, len(bounds)))
        if len(start):
            points = np.vstack([start, points])
        order = np.argsort([cost(point) for point in points], kind='stable')
        return differential_evolution(
            cost,
            bounds,
            init=points[order[:_POPULATION]],
            maxiter=40,
            mutation=(0.4, 0.9),
            recombination=0.9,
            seed=1,
            polish=False,
        )

    def _best_by_estimate(self) -> tuple[Sequence[float], float]:
        """Return the best point of a global search on both sides of the hump, by the estimated cost, and this."""
        best: Sequence[float] = ()
        least = _REJECTED
        for low, high in ((self._whole[0], HUMP), (HUMP, self._whole[1])):
            found = self._minimum(self._estimated, (low, high))
            searched = f'sqrt(k_i/k_d) of {low:.0f} to {high:.0f} Hz'
            if found.fun >= _REJECTED:
                self._report(f'{searched}: no PID controller keeps the rule')
                continue
            squares = self._estimate.mean_squares(self._at(found.x))
            errors = ' and '.join(f'{1e3 * math.sqrt(square):.1f} nm at {f:g} Hz' for f, square in squares.items())
            self._report(f'{searched}: rms errors of about {errors}')
            if found.fun < least:
                best, least = found.x, found.fun
        if least == _REJECTED:
            allowed = (
                f'a larger value: no PID controller with Ms <= {MAX_SENSITIVITY:g} has less overshoot on this drive [%]'
            )
            raise ParameterError('overshoot', self._overshoot, allowed)
        return best, least

    def _improved(self, objective: Objective, point: Sequence[float]) -> Sequence[float]:
        """Return what a local search makes of a point."""
        cost = self._checked(objective)
        bounds = _bounds(self._whole)
        # Begun anew where it has ended: at the edge of what the rule allows, a simplex may close up too early.
        for _ in range(2):
            share, frequency, pole = point
            simplex = [(share, frequency, pole), (share - 0.05, frequency, pole), (share, frequency - 0.05, pole)]
            simplex.append((share, frequency, pole + 0.03))
            options = {'initial_simplex': simplex, 'xatol': 1e-3, 'fatol': math.inf}
            point = minimize(cost, point, method='Nelder-Mead', bounds=bounds, options=options).x
        return point

    def _rounded(self, law: LinearController) -> LinearController:
        """Return the best controller near ``law`` whose gains have three digits."""
        integrals = [_neighbors(law.integral)]
        if not math.isinf(self._overshoot):
            # The first one that the other gains keep the rule with.
            integrals = [[round_down((1.0 - step) * law.integral)] for step in (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)]
        keeping: list[LinearController] = []
        for some in integrals:
            near = itertools.product(_neighbors(law.derivative), some, _neighbors(law.bandwidth))
            laws = (self._law(*gains, digits=3) for gains in near)
            keeping = keeping or [law for law in laws if self._keeps_the_rule(law)]
        return min(keeping, key=self._simulated, default=law)

    def _keeps_the_rule(self, law: LinearController) -> bool:
        return (
            law.proportional > 0.0
            and self._excess(law) <= 0.0
            and self._margins.peak_sensitivity(law) <= MAX_SENSITIVITY
        )


def _integral_within(cost: Objective, most: float) -> Objective:
    """Return an objective whose minimum has the largest k_i of those that cost no more than ``most``."""

    def objective(law: LinearController) -> float:
        own = cost(law)
        return -law.integral if own <= most else own / most

    return objective


def _bounds(integral_range: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the limits of a search: logarithms of k_d and of sqrt(k_i/k_d)/(2 pi), and the filter's pole."""
    (low_share, high_share), (low, high) = DERIVATIVE_SHARES, integral_range
    return [(math.log(low_share), math.log(high_share)), (math.log(low), math.log(high)), (0.0, LARGEST_POLE)]


def _neighbors(value: float) -> list[float]:
    """Return the two values with three digits about ``value`` and the next ones below and above, 0 for 0."""
    if value == 0.0:
        return [0.0]
    down, up = round_down(value), round_up(value)
    return [round_down(0.998 * down), down, up, round_up(1.002 * up)]


def tune_pid(
    plant: PlantParameters,
    sample_time: float,
    sections: Sections,
    overshoot: float = OVERSHOOT,
    report: Callable[[str], None] = lambda line: None,
) -> dict[str, object]:
    """
    Return the PID controller's gains by the rule of :mod:`~hdd_servo_ros.studies.tune`, under their ROS names.

    Parameters
    ----------
    plant, sample_time, sections, overshoot, report
        See :class:`PidSearch`.

    Raises
    ------
    ParameterError
        If no PID controller keeps the rule.
    """
    return pid_gains(PidSearch(plant, sample_time, sections, overshoot, report).run())
