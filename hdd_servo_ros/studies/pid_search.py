"""PID controller with the least error on sines for a maximum peak sensitivity and a maximum overshoot."""

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
from hdd_servo_ros.parameters import ParameterError, to_mapping
from hdd_servo_ros.studies.tuning_runs import FREQUENCIES, Sections, Steps, run_sine, track

OVERSHOOT = 20.0
"""Default limit of the overshoot of steps [%]."""
DERIVATIVE_SHARES = (0.1, 6.0)
"""Search range of k_d, relative to the largest k_d without a filter."""
BOUNDARY = math.sqrt(FREQUENCIES[0] * FREQUENCIES[1])
"""
Boundary between the two search ranges of sqrt(k_i/k_d)/(2 pi) [Hz]. Near it the error has a maximum over k_i, because
integral and derivative cancel: ``|C|^2 = k_p^2 + (k_d w - k_i/w)^2``.
"""
LARGEST_POLE = 0.9
"""Largest pole of the derivative filter."""
LEAST_POLE = 0.005
"""Smallest pole of the derivative filter; the search omits the filter below it."""
INTEGRAL_COST = 1.05
"""Allowed factor on the squared error for a larger k_i, with a limit of the overshoot."""
_REJECTED = 1e9
"""Cost of gains that violate the rule, above any squared error [um^2]."""
_SINE_DURATION, _SINE_TRANSIENT = 1.0, 0.5
"""Duration of the simulated sines, and the transient within it [s]."""
_FIRST_POINTS, _POPULATION = 500, 60
"""Number of random points, and number of the best of them with which the global search starts."""
_START = (0.7, 0.0)
"""k_d, relative to the largest without a filter, and k_i of the controller whose run yields the command."""
_FILTERS = ('frequencies', 'sections')
"""Ends of the names of the lists that add filters to the command path."""


Objective = Callable[[LinearController], float]


def computation_delay(sections: Sections, node: str) -> int:
    """
    Return the computation delay of a controller [samples].

    Raises
    ------
    ParameterError
        If the command is filtered or interpolated, which tuning does not take into account.
    """
    dsp = dsp_parameters(node, sections.get(node, {}))
    if dsp.is_interpolated:
        raise ParameterError(
            f'{node}.dsp.interpolation', dsp.interpolation, 'hold, because tuning assumes a command held over a sample'
        )
    if dsp.filters.is_used:
        used = tuple(name for name, value in to_mapping(dsp.filters).items() if value and name.endswith(_FILTERS))
        raise ParameterError(
            f'{node}.dsp.filters',
            used,
            'empty lists, because tuning assumes that the drive gets the controller voltage',
        )
    return dsp.computation_delay


def pid_gains(law: LinearController) -> dict[str, object]:
    """Return the gains of the PID controller equivalent to ``law``, under their ROS parameter names."""
    return {
        'proportional_gain': law.proportional,
        'integral_gain': law.integral,
        'derivative_gain': law.derivative,
        'derivative_bandwidth': law.bandwidth,
    }


class PidSearch:
    """
    PID search for one drive; :mod:`~hdd_servo_ros.studies.tune` explains the steps.

    The global search estimates the errors on sines, the local search simulates them. At each point of the search, k_p
    is the largest value that the peak sensitivity allows.

    Parameters
    ----------
    plant
        Parameters of the drive, equal to those in ``sections``.
    sample_time
        T [s].
    sections
        Parameters of drive and vibrometer for the runs, and the computation delay of the PID controller.
    overshoot
        Limit of the overshoot of steps [%]; infinity for no limit.
    report
        Receives lines of text about the progress.
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
        # The largest k_d, with almost no k_p and no filter.
        self._largest_derivative = largest_gain_on_r(
            self._margins, largest_lambda(self._margins, 100.0, delay=self._delay), delay=self._delay
        )
        # Search range of sqrt(k_i/k_d)/(2 pi) [Hz], up to the crossover frequency of k_d alone.
        crossover = max(plant.rigid_gain * self._largest_derivative / (2.0 * math.pi), 2.0 * BOUNDARY)
        self._integral_range = (0.1 * BOUNDARY, crossover)
        self._estimate = self._estimate_of_errors(plant)

    def _estimate_of_errors(self, plant: PlantParameters) -> SineErrors:
        start = self._law(_START[0] * self._largest_derivative, _START[1], 0.0)
        commands = {}
        for frequency in FREQUENCIES:
            rows = run_sine('pid', pid_gains(start), self._sections, self._sample_time, frequency, _SINE_DURATION)
            last = rows.control[-round((_SINE_DURATION - _SINE_TRANSIENT) / self._sample_time) :, 0]
            commands[frequency] = command_harmonics(last, frequency, self._sample_time)
        ldv: LdvParameters = block_parameters('ldv_sensor', self._sections.get('ldv_sensor', {}))
        noise = (ldv.displacement_noise, ldv.velocity_noise) if ldv.noise else (0.0, 0.0)
        return SineErrors(plant, self._sample_time, commands, *noise)

    def _law(self, derivative: float, integral: float, bandwidth: float, digits: int = 15) -> LinearController:
        """Return the controller with the largest k_p that the peak sensitivity allows; k_p = 0 if it allows none."""
        law = LinearController(0.0, derivative, integral, bandwidth, self._delay)
        proportional = largest_proportional_gain(self._margins, law)
        return dataclasses.replace(law, proportional=round_down(proportional, digits) if proportional > 0.0 else 0.0)

    def _at(self, point: Sequence[float]) -> LinearController:
        """Return the controller at a point of the search; see :func:`_bounds`."""
        share, frequency, pole = point
        derivative = math.exp(share) * self._largest_derivative
        bandwidth = -math.log(pole) / (2.0 * math.pi * self._sample_time) if pole > LEAST_POLE else 0.0
        return self._law(derivative, derivative * (2.0 * math.pi * math.exp(frequency)) ** 2, bandwidth)

    def _checked(self, objective: Objective) -> Callable[[Sequence[float]], float]:
        """
        Return the cost function of points: the objective, or a larger value if the gains violate the rule.

        Step runs are skipped if the objective is not below that of an earlier point that satisfies the rule.
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
        """Return the overshoot minus its limit [%]."""
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
        """Search and return the controller, with gains rounded to at most three digits."""
        point, estimate = self._best_by_estimate()
        point = self._improved(self._simulated, point)
        found = self._at(point)
        self._report(f'gains with the least error: {self._described(found)}')
        if math.isinf(self._overshoot):
            return self._rounded(found)
        point = self._minimum(
            _integral_within(self._estimated, INTEGRAL_COST * estimate), self._integral_range, point
        ).x
        affordable = _integral_within(self._simulated, INTEGRAL_COST * self._simulated(found))
        found = self._at(self._improved(affordable, point))
        self._report(f'gains with the largest integral: {self._described(found)}')
        return self._rounded(found)

    def _described(self, law: LinearController) -> str:
        errors = ' and '.join(
            f'{error:.1f} nm at {f:g} Hz' for error, f in zip(self.errors(law), FREQUENCIES, strict=True)
        )
        return f'k_i = {law.integral:.3g} V/(um s), rms errors of {errors}'

    def _minimum(
        self, objective: Objective, integral_range: tuple[float, float], start: Sequence[float] = ()
    ) -> OptimizeResult:
        """Search all k_d and filters in a range of sqrt(k_i/k_d)/(2 pi) [Hz]; ``start`` is one of the first points."""
        cost = self._checked(objective)
        bounds = _bounds(integral_range)
        # Few points allow any k_p, so that a search from a few dozen random points might not find one.
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
        """Return the best point of the global searches below and above the error maximum, and its estimated cost."""
        best: Sequence[float] = ()
        least = _REJECTED
        for low, high in ((self._integral_range[0], BOUNDARY), (BOUNDARY, self._integral_range[1])):
            found = self._minimum(self._estimated, (low, high))
            searched = f'sqrt(k_i/k_d)/(2 pi) from {low:.0f} to {high:.0f} Hz'
            if found.fun >= _REJECTED:
                self._report(f'{searched}: no PID controller satisfies the rule')
                continue
            squares = self._estimate.mean_squares(self._at(found.x))
            errors = ' and '.join(f'{1e3 * math.sqrt(square):.1f} nm at {f:g} Hz' for f, square in squares.items())
            self._report(f'{searched}: estimated rms errors {errors}')
            if found.fun < least:
                best, least = found.x, found.fun
        if least == _REJECTED:
            allowed = (
                f'a larger value: no PID controller with Ms <= {MAX_SENSITIVITY:g} has less overshoot on this drive [%]'
            )
            raise ParameterError('overshoot', self._overshoot, allowed)
        return best, least

    def _improved(self, objective: Objective, point: Sequence[float]) -> Sequence[float]:
        """Return the result of a local search that starts at a point."""
        cost = self._checked(objective)
        bounds = _bounds(self._integral_range)
        # Restart at the result: at the limits of the rule a simplex may collapse too early.
        for _ in range(2):
            share, frequency, pole = point
            simplex = [(share, frequency, pole), (share - 0.05, frequency, pole), (share, frequency - 0.05, pole)]
            simplex.append((share, frequency, pole + 0.03))
            options = {'initial_simplex': simplex, 'xatol': 1e-3, 'fatol': math.inf}
            point = minimize(cost, point, method='Nelder-Mead', bounds=bounds, options=options).x
        return point

    def _rounded(self, law: LinearController) -> LinearController:
        """Return the best controller near ``law`` with gains of three digits."""
        integrals = [_neighbors(law.integral)]
        if not math.isinf(self._overshoot):
            # Use the first of these with which some other gains satisfy the rule.
            integrals = [[round_down((1.0 - step) * law.integral)] for step in (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)]
        valid: list[LinearController] = []
        for some in integrals:
            near = itertools.product(_neighbors(law.derivative), some, _neighbors(law.bandwidth))
            laws = (self._law(*gains, digits=3) for gains in near)
            valid = valid or [law for law in laws if self._satisfies_the_rule(law)]
        return min(valid, key=self._simulated, default=law)

    def _satisfies_the_rule(self, law: LinearController) -> bool:
        return (
            law.proportional > 0.0
            and self._excess(law) <= 0.0
            and self._margins.peak_sensitivity(law) <= MAX_SENSITIVITY
        )


def _integral_within(cost: Objective, most: float) -> Objective:
    """Return an objective whose minimum has the largest k_i with a cost of at most ``most``."""

    def objective(law: LinearController) -> float:
        own = cost(law)
        return -law.integral if own <= most else own / most

    return objective


def _bounds(integral_range: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the bounds of log relative k_d, log sqrt(k_i/k_d)/(2 pi) [Hz], and the pole of the filter."""
    (low_share, high_share), (low, high) = DERIVATIVE_SHARES, integral_range
    return [(math.log(low_share), math.log(high_share)), (math.log(low), math.log(high)), (0.0, LARGEST_POLE)]


def _neighbors(value: float) -> list[float]:
    """Return the two nearest values with three digits below and two above; only 0 for 0."""
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
    Return the PID gains by the tuning rule of :mod:`~hdd_servo_ros.studies.tune`, under their ROS parameter names.

    Parameters
    ----------
    plant, sample_time, sections, overshoot, report
        See :class:`PidSearch`.

    Raises
    ------
    ParameterError
        If no PID controller satisfies the rule.
    """
    return pid_gains(PidSearch(plant, sample_time, sections, overshoot, report).run())
