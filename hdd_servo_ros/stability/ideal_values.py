"""
Ideal values sigma, m, phi and W* of the estimates in the proof of theorem 4.1, for a known drive.

The proof requires only that, everywhere in the run,

    |h - sigma v| + |d| <= W*'S + phi,                                                   (4.12)-(4.15)

so all values that satisfy this give valid bounds. The bounds differ: c2 of (4.31) grows with the squared ideal values.
Therefore the values with the smallest c2 are used. This is a least distance problem: minimize a weighted sum of squares
under linear inequalities. Lawson and Hanson's nonnegative least squares solves it exactly (*Solving Least Squares
Problems*, chapter 23).
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hdd_servo_ros.control.adaptive_nn_parameters import AdaptiveNnParameters
from hdd_servo_ros.control.rbf import lattice
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

Array = NDArray[np.float64]
Region = tuple[tuple[float, float], tuple[float, float]]

_VELOCITIES = 401
_SLOW_VELOCITIES = 100
_POSITIONS = 41
_CUTS = 60
_WORST = 16


@dataclasses.dataclass(frozen=True)
class KnownPlant(ParameterSet):
    """Drive of (4.1) as the certificate knows it: m x'' + h + d = u with the LuGre friction (4.5), (4.6)."""

    mass: float = parameter(1.0, 'mass m, 1/gain of the drive', unit='V s^2/um', above=0.0)
    stiffness: float = parameter(1.0, 'sigma_0', unit='V/um', above=0.0)
    bristle_damping: float = parameter(0.0, 'bristle damping sigma_1', unit='V s/um', minimum=0.0)
    viscous_coefficient: float = parameter(0.0, 'viscous friction coefficient sigma_2', unit='V s/um', minimum=0.0)
    coulomb_level: float = parameter(1.0, 'f_c', unit='V', above=0.0)
    static_level: float = parameter(1.0, 'f_s', unit='V', above=0.0)
    stribeck_velocity: float = parameter(1.0, 'v_s', unit='um/s', above=0.0)
    disturbance_bound: float = parameter(0.0, 'bound d* on the magnitude of the disturbance', unit='V', minimum=0.0)

    def bristle_bound(self, velocity: Array) -> Array:
        """
        Return the bound on ``|h_z|`` [V] of (4.13) at velocities [um/s]: (sigma_0 + sigma_1 alpha(v) |v|)/alpha_min.

        With alpha_min = sigma_0/f_s this is f_s (1 + sigma_1 |v|/g(v)). It allows a bristle at its largest deflection
        against the motion at any speed, and so grows with ``|v|`` without limit.
        """
        level = self.coulomb_level + (self.static_level - self.coulomb_level) * np.exp(
            -((velocity / self.stribeck_velocity) ** 2)
        )
        bound: Array = self.static_level * (1.0 + self.bristle_damping * np.abs(velocity) / level)
        return bound


@dataclasses.dataclass(frozen=True)
class IdealValues:
    """
    Ideal values of the estimates.

    Attributes
    ----------
    sigma, mass, phi
        Ideal values sigma [V s/um], m [V s^2/um] and phi [V].
    weights
        W* [V], shape (n n,), position index first; zeros if the network is disabled.
    """

    sigma: float
    mass: float
    phi: float
    weights: Array


def theorem_values(plant: KnownPlant, parameters: AdaptiveNnParameters, region: Region) -> IdealValues:
    """
    Return the values for the thesis's split of the friction, over a region of position and velocity.

    sigma = sigma_1 + sigma_2 as in (4.12), and phi and W* bound (4.13) and d* on a grid over the region. If S depends
    on more than the measured state and the initial lattice (adaptive widths, network of the reference), W* is zero and
    phi is the whole bound.

    Parameters
    ----------
    plant
        The drive.
    parameters
        The controller.
    region
        Smallest and largest position [um]; smallest and largest velocity [um/s]. Represents the compact set Omega.
    """
    _check_parts(parameters)
    (x_low, x_high), (v_low, v_high) = region
    reach = max(abs(v_low), abs(v_high), 1e-300)
    slow = np.geomspace(min(1e-2 * plant.stribeck_velocity, reach), reach, _SLOW_VELOCITIES)
    v = np.concatenate((np.linspace(v_low, v_high, _VELOCITIES), -slow, slow, [0.0]))
    v = np.unique(v[(v >= v_low) & (v <= v_high)])
    x, v = (grid.ravel() for grid in np.meshgrid(np.linspace(x_low, x_high, _POSITIONS), v, indexing='ij'))
    sigma = plant.bristle_damping + plant.viscous_coefficient
    if not parameters.sigma.enabled:
        raise ParameterError('sigma.enabled', False, 'true: the split (4.12) has a term that sigma_hat must cancel')
    demand = plant.bristle_bound(v) + plant.disturbance_bound
    use_network = parameters.network.enabled and not parameters.width.enabled
    use_network = use_network and parameters.network.input == 'measured'
    return _smallest_c2(plant.mass, parameters, np.zeros_like(v), sigma, demand, v, (x, v) if use_network else None)


def run_values(
    mass: float,
    parameters: AdaptiveNnParameters,
    friction: Array,
    velocity: Array,
    network_inputs: tuple[Array, Array] | None,
    disturbance_bound: float,
) -> IdealValues:
    """
    Return the values for the friction observed in one run; sigma is also free.

    They are not valid for another run, but bound this one much more tightly: the friction itself stays near g(v), where
    its bound (4.13) grows with sigma_1 |v|. They do not depend on the friction model.

    Parameters
    ----------
    mass
        Mass m [V s^2/um].
    parameters
        The controller.
    friction, velocity
        h [V] and v [um/s] at the ticks.
    network_inputs
        Network inputs position [um] and velocity [um/s] at the ticks; None if unknown, in which case W* is zero.
    disturbance_bound
        Bound d* [V].
    """
    _check_parts(parameters)
    if not parameters.network.enabled or parameters.width.enabled:
        network_inputs = None
    sigma = None if parameters.sigma.enabled else 0.0
    demand = np.full_like(friction, disturbance_bound)
    return _smallest_c2(mass, parameters, friction, sigma, demand, velocity, network_inputs)


def _check_parts(parameters: AdaptiveNnParameters) -> None:
    """Reject a controller without the parts that the proof needs."""
    p = parameters
    if p.desired.enabled:
        allowed = (
            'false: theorem 4.1 holds for the measured v and a_r; docs/concepts/stability-certificate.md has the proof '
            'of this option'
        )
        raise ParameterError('desired.enabled', True, allowed)
    for name, enabled in (('mass.enabled', p.mass.enabled), ('phi.enabled', p.phi.enabled)):
        if not enabled:
            raise ParameterError(name, enabled, 'true: theorem 4.1 does not hold without it')
    laws = [
        ('sigma', p.sigma.enabled, p.sigma.gain, p.sigma.leakage),
        ('mass', True, p.mass.gain, p.mass.leakage),
        ('phi', True, p.phi.gain, p.phi.leakage),
        ('network', p.network.enabled, min(p.network.gain), p.network.leakage),
        ('compensator', p.compensator.enabled, p.compensator.gain, p.compensator.leakage),
    ]
    positive = {'feedback_gain': p.feedback_gain}
    for name, enabled, gain, leakage in laws:
        if enabled:
            positive |= {f'{name}.gain': gain, f'{name}.leakage': leakage}
    for name, value in positive.items():
        if value <= 0.0:
            raise ParameterError(name, value, 'above 0, as theorem 4.1 requires')


class NetworkAt:
    """
    W'S at many points, where S is the product of the activations of both axes.

    Parameters
    ----------
    parameters
        The controller; its initial lattice is used.
    inputs
        Positions [um] and velocities [um/s] of the points.
    """

    def __init__(self, parameters: AdaptiveNnParameters, inputs: tuple[Array, Array]) -> None:
        network = parameters.network
        position_width, velocity_width = network.axis_widths
        axes = (
            (inputs[0], lattice(network.position_minimum, network.position_maximum, network.nodes), position_width),
            (inputs[1], lattice(network.velocity_minimum, network.velocity_maximum, network.nodes), velocity_width),
        )
        self._position, self._velocity = (
            np.exp(-(((z[:, None] - centers[None, :]) / width) ** 2)) for z, centers, width in axes
        )

    def output(self, weights: Array) -> Array:
        """Return W'S at every point [V]."""
        nodes = self._position.shape[1]
        values: Array = ((self._position @ weights.reshape(nodes, nodes)) * self._velocity).sum(axis=1)
        return values

    def activations(self, points: NDArray[np.intp]) -> Array:
        """Return S at some points, shape (len(points), n n)."""
        products = self._position[points][:, :, None] * self._velocity[points][:, None, :]
        return products.reshape(len(points), -1)


def _smallest_c2(
    mass: float,
    parameters: AdaptiveNnParameters,
    force: Array,
    sigma: float | None,
    demand: Array,
    velocity: Array,
    network_inputs: tuple[Array, Array] | None,
) -> IdealValues:
    """
    Return the values with the smallest c2 under ``|force - sigma v| + demand <= W*'S + phi`` at every point.

    If ``sigma`` is given, ``force`` excludes sigma v. Of many thousand inequalities few are active. They are added
    where the present solution violates them most; a remaining deficit is added to phi.
    """
    network = None if network_inputs is None else NetworkAt(parameters, network_inputs)
    count = parameters.network.nodes**2
    # The unknowns are scaled by the square roots of their leakages, so that the sum of their squares is 2 c2.
    phi_scale = parameters.phi.leakage**-0.5
    sigma_scale = parameters.sigma.leakage**-0.5 if sigma is None else 0.0
    weight_scale = parameters.network.leakage**-0.5 if network is not None else 0.0
    rows = np.empty((0, 2 + (count if network is not None else 0)))
    bounds = np.empty(0)
    phi, own_sigma, weights = 0.0, 0.0, np.zeros(count)
    lacks = np.abs(force) + demand
    tolerance = 1e-6 * float(lacks.max(initial=0.0))
    for _ in range(_CUTS):
        if not (lacks > tolerance).any():
            break
        worst = np.argsort(lacks)[-_WORST:]
        worst = worst[lacks[worst] > tolerance]
        signs = np.where(force[worst] - own_sigma * velocity[worst] >= 0.0, 1.0, -1.0)
        new = np.zeros((len(worst), rows.shape[1]))
        new[:, 0] = phi_scale
        new[:, 1] = signs * velocity[worst] * sigma_scale
        if network is not None:
            new[:, 2:] = network.activations(worst) * weight_scale
        rows = np.vstack((rows, new))
        bounds = np.concatenate((bounds, signs * force[worst] + demand[worst]))
        found = _least_distance(rows, bounds)
        phi, own_sigma = found[0] * phi_scale, found[1] * sigma_scale
        if network is not None:
            weights = found[2:] * weight_scale
        lacks = np.abs(force - own_sigma * velocity) + demand - phi
        if network is not None:
            lacks = lacks - network.output(weights)
    phi += max(float(lacks.max(initial=0.0)), 0.0)
    return IdealValues(own_sigma if sigma is None else sigma, mass, phi, weights)


def _least_distance(rows: Array, bounds: Array) -> Array:
    """Return the shortest y with ``rows @ y >= bounds`` (a solution must exist)."""
    norms = np.linalg.norm(rows, axis=1)
    scaled = bounds / norms
    # Scaled to order one, so that the residual below is neither tiny nor almost one.
    largest = scaled.max()
    system = np.vstack(((rows / norms[:, None]).T, scaled / largest))
    target = np.zeros(len(system))
    target[-1] = 1.0
    multipliers, _ = nnls(system, target, maxiter=30 * system.shape[1])
    residual = system @ multipliers - target
    found: Array = -residual[:-1] / residual[-1] * largest
    return found
