"""The loop with the adaptive NN controller's estimates frozen, over all estimates that projection allows."""

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
Values per estimate, its bounds included, at which the peak sensitivity of a set is computed.

It is not monotone: too little damping raises it at the loop's bandwidth, too much at Nyquist.
"""
SAFE_STEPS = 8
"""Steps to either side in which the ends of a safe range are searched for, before they are bisected."""


@dataclasses.dataclass(frozen=True)
class AllowedEstimates:
    """The values that each estimate may take, smallest and largest; infinite where nothing bounds it."""

    sigma_hat: tuple[float, float]
    m_hat: tuple[float, float]

    @property
    def unbounded(self) -> tuple[str, ...]:
        """Names of the estimates that nothing bounds."""
        ranges = (('sigma_hat', self.sigma_hat), ('m_hat', self.m_hat))
        return tuple(name for name, bounds in ranges if not all(map(math.isfinite, bounds)))

    @property
    def act_on_loop(self) -> bool:
        """Whether any of them may be other than zero, which is what one outside of the loop counts as."""
        return any((*self.sigma_hat, *self.m_hat))


def initial_estimates(controller: AdaptiveNn) -> FrozenEstimates:
    """Return the estimates at tick 0; zero for a part that does not act on the loop."""
    p = controller.parameters
    return FrozenEstimates(*(law.initial if acts_on_loop(controller, law) else 0.0 for law in (p.sigma, p.mass)))


def allowed_estimates(controller: AdaptiveNn) -> AllowedEstimates:
    """
    Return what sigma_hat and m_hat may come to: with projection their bounds, without it anything.

    Zero is all that matters of one that does not act on the loop.
    """
    p = controller.parameters

    def bounds(law: SigmaParameters | MassParameters) -> tuple[float, float]:
        if not acts_on_loop(controller, law):
            return 0.0, 0.0
        if law.gain == 0.0:
            # It stays where it is.
            return law.initial, law.initial
        return (law.minimum, law.maximum) if p.projection else (-math.inf, math.inf)

    return AllowedEstimates(bounds(p.sigma), bounds(p.mass))


class FrozenLoop:
    """
    The loop around a drive with the adaptive NN controller's estimates frozen.

    Parameters
    ----------
    margins
        The drive, its sensor and T.
    controller
        The law; its parameters count as they are when a method is called.
    delay
        Samples by which u comes late.
    """

    def __init__(self, margins: LoopMargins, controller: AdaptiveNn, delay: int = 0) -> None:
        self._margins = margins
        self._controller = controller
        self._delay = delay

    def laws(self, estimates: Iterable[FrozenEstimates]) -> list[LinearController]:
        """Return the linear controllers of these estimates."""
        return frozen_laws(self._controller, estimates, self._delay)

    def peak_sensitivity(self, estimates: FrozenEstimates) -> float:
        """Return Ms of these estimates, in presliding or sliding, whichever is larger; infinity if unstable."""
        return self._margins.peak_sensitivity(self.laws([estimates])[0])

    def worst(self, allowed: AllowedEstimates) -> tuple[float, FrozenEstimates]:
        """
        Return the largest Ms over a bounded set of estimates, and where.

        It is computed on a grid that includes the corners, or, where the estimates act on the gain on velocity alone,
        on the line between its smallest and its largest value. Of several estimates that make the loop unstable, those
        nearest to zero are returned, on the scale of the set.

        Raises
        ------
        ValueError
            If the set is not bounded.
        """
        if allowed.unbounded:
            raise ValueError(f'no bounds for {" and ".join(allowed.unbounded)}')
        bounds = allowed.sigma_hat, allowed.m_hat
        if self._controller.parameters.integral_gain == 0.0:
            # Both estimates change the gain on velocity alone, which takes all its values on this diagonal.
            sigma_hat, m_hat = (np.linspace(*ends, 2 * PER_ESTIMATE).tolist() for ends in bounds)
            pairs = list(zip(reversed(sigma_hat), m_hat, strict=True))
        else:
            sigma_hat, m_hat = (np.unique(np.linspace(*ends, PER_ESTIMATE)).tolist() for ends in bounds)
            pairs = list(itertools.product(sigma_hat, m_hat))
        return self.worst_of([FrozenEstimates(*pair) for pair in pairs])

    def worst_of(self, points: list[FrozenEstimates]) -> tuple[float, FrozenEstimates]:
        """Return the largest Ms of some estimates, and of which; raises ValueError if there are none."""
        peaks = self._margins.peak_sensitivities(self.laws(points))
        scales = [max(abs(point[i]) for point in points) or 1.0 for i in (0, 1)]
        sizes = [abs(point.sigma_hat) / scales[0] + abs(point.m_hat) / scales[1] for point in points]
        best = max(range(len(points)), key=lambda i: (peaks[i], -sizes[i]))
        if math.isinf(peaks[best]):
            return math.inf, points[best]
        return self.peak_sensitivity(points[best]), points[best]

    def safe_range(self, start: FrozenEstimates, name: str, limit: float) -> tuple[float, float]:
        """
        Return between which values of one estimate Ms keeps a limit; the other stays.

        Parameters
        ----------
        start
            Estimates with which it does.
        name
            ``'sigma_hat'`` or ``'m_hat'``.
        limit
            The largest Ms.

        Returns
        -------
        tuple
            Ends of the range around ``start``, each to a four-hundredth of the gain on r; infinities for an estimate
            that does not act on the loop.
        """
        p = self._controller.parameters
        # sigma_hat changes the gain on velocity by as much, m_hat by lambda times as much.
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
