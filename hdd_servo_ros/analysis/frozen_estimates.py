"""The adaptive NN loop with frozen estimates, over all estimates that projection allows."""

import dataclasses
import itertools
import math
from collections.abc import Iterable

import numpy as np

from hdd_servo_ros.analysis.linear_laws import FrozenEstimates, acts_on_loop, frozen_laws
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.control.adaptive_nn_parameters import MassParameters, SigmaParameters

PER_ESTIMATE = 9
"""
Number of values per estimate, including its bounds, at which the peak sensitivity is computed.

The peak is not monotone: low damping raises it at the bandwidth of the loop, high damping at Nyquist.
"""
SAFE_STEPS = 8
"""Number of steps in each direction in the search for the ends of a safe range, before bisection."""


@dataclasses.dataclass(frozen=True)
class AllowedEstimates:
    """The bounds of each estimate; infinite for an unbounded one."""

    sigma_hat: tuple[float, float]
    m_hat: tuple[float, float]

    @property
    def unbounded(self) -> tuple[str, ...]:
        """Names of the unbounded estimates."""
        ranges = (('sigma_hat', self.sigma_hat), ('m_hat', self.m_hat))
        return tuple(name for name, bounds in ranges if not all(map(math.isfinite, bounds)))

    @property
    def act_on_loop(self) -> bool:
        """Whether any estimate may differ from zero; estimates outside the loop count as zero."""
        return any((*self.sigma_hat, *self.m_hat))


def initial_estimates(controller: AdaptiveNn) -> FrozenEstimates:
    """Return the initial estimates; zero for a term that does not act on the loop."""
    p = controller.parameters
    return FrozenEstimates(*(law.initial if acts_on_loop(controller, law) else 0.0 for law in (p.sigma, p.mass)))


def allowed_estimates(controller: AdaptiveNn) -> AllowedEstimates:
    """
    Return the ranges of sigma_hat and m_hat: their bounds with projection, otherwise unbounded.

    The range is zero for an estimate that does not act on the loop.
    """
    p = controller.parameters

    def bounds(law: SigmaParameters | MassParameters) -> tuple[float, float]:
        if not acts_on_loop(controller, law):
            return 0.0, 0.0
        if law.gain == 0.0:
            # A fixed estimate.
            return law.initial, law.initial
        return (law.minimum, law.maximum) if p.projection else (-math.inf, math.inf)

    return AllowedEstimates(bounds(p.sigma), bounds(p.mass))


class FrozenLoop:
    """
    The loop of a drive and the adaptive NN controller with frozen estimates.

    Parameters
    ----------
    margins
        The drive, its sensor and the sample time.
    controller
        The controller; each method uses its current parameters.
    delay
        Samples by which u comes late.
    """

    def __init__(self, margins: LoopMargins, controller: AdaptiveNn, delay: int = 0) -> None:
        self._margins = margins
        self._controller = controller
        self._delay = delay

    def laws(self, estimates: Iterable[FrozenEstimates]) -> list[LinearController]:
        """Return the linear controllers for these estimates."""
        return frozen_laws(self._controller, estimates, self._delay)

    def peak_sensitivity(self, estimates: FrozenEstimates) -> float:
        """Return Ms for these estimates, the larger of presliding and sliding; infinity if unstable."""
        return self._margins.peak_sensitivity(self.laws([estimates])[0])

    def worst(self, allowed: AllowedEstimates) -> tuple[float, FrozenEstimates]:
        """
        Return the largest Ms over a bounded set of estimates, and the estimates.

        It is computed on a grid that includes the corners or, if the estimates act only on the velocity gain, on the
        line between its smallest and its largest value. If several estimates make the loop unstable, those nearest to
        zero are returned, on the scale of the set.

        Raises
        ------
        ValueError
            If the set is not bounded.
        """
        if allowed.unbounded:
            raise ValueError(f'unbounded estimates: {" and ".join(allowed.unbounded)}')
        bounds = allowed.sigma_hat, allowed.m_hat
        if self._controller.parameters.integral_gain == 0.0:
            # Both estimates change only the velocity gain, which takes all its values on this diagonal.
            sigma_hat, m_hat = (np.linspace(*ends, 2 * PER_ESTIMATE).tolist() for ends in bounds)
            pairs = list(zip(reversed(sigma_hat), m_hat, strict=True))
        else:
            sigma_hat, m_hat = (np.unique(np.linspace(*ends, PER_ESTIMATE)).tolist() for ends in bounds)
            pairs = list(itertools.product(sigma_hat, m_hat))
        return self.worst_of([FrozenEstimates(*pair) for pair in pairs])

    def worst_of(self, points: list[FrozenEstimates]) -> tuple[float, FrozenEstimates]:
        """Return the largest Ms of some estimates, and the estimates; raises ValueError for an empty list."""
        peaks = self._margins.peak_sensitivities(self.laws(points))
        scales = [max(abs(point[i]) for point in points) or 1.0 for i in (0, 1)]
        sizes = [abs(point.sigma_hat) / scales[0] + abs(point.m_hat) / scales[1] for point in points]
        best = max(range(len(points)), key=lambda i: (peaks[i], -sizes[i]))
        if math.isinf(peaks[best]):
            return math.inf, points[best]
        return self.peak_sensitivity(points[best]), points[best]

    def safe_range(self, start: FrozenEstimates, name: str, limit: float) -> tuple[float, float]:
        """
        Return the range of one estimate that keeps Ms below a limit, with the other estimate fixed.

        Parameters
        ----------
        start
            Estimates that keep the limit.
        name
            ``'sigma_hat'`` or ``'m_hat'``.
        limit
            The largest Ms.

        Returns
        -------
        tuple
            Ends of the range around ``start``, to a resolution of 1/400 of the gain on r; infinite for an estimate that
            does not act on the loop.
        """
        p = self._controller.parameters
        # sigma_hat changes the velocity gain by the same amount, m_hat by lambda times that amount.
        per_gain = 1.0 if name == 'sigma_hat' else p.error_filter_lambda
        if per_gain == 0.0:
            return -math.inf, math.inf
        step = 2.0 * self._controller.gain_on_r / per_gain / SAFE_STEPS

        def at(offset: float) -> FrozenEstimates:
            return start._replace(**{name: getattr(start, name) + step * offset})

        ends = []
        for direction in (-1.0, 1.0):
            offsets = [direction * count for count in range(SAFE_STEPS + 1)]
            peaks = self._margins.peak_sensitivities(self.laws(map(at, offsets)))
            beyond = next((count for count, peak in enumerate(peaks) if not peak <= limit), SAFE_STEPS + 1)
            inside, outside = direction * max(beyond - 1, 0), direction * beyond
            while abs(outside - inside) > 0.01 and beyond <= SAFE_STEPS:
                middle = 0.5 * (inside + outside)
                inside, outside = (middle, outside) if self.peak_sensitivity(at(middle)) <= limit else (inside, middle)
            ends.append(float(getattr(at(inside), name)))
        return ends[0], ends[1]
