"""Adaptive neural network controller of chapter 4, thesis eqs. (4.10)-(4.21)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.adaptation import decay_and_step
from hdd_servo_ros.control.adaptive_nn_kernel import (
    CONSTANTS,
    ESTIMATE_NAMES,
    ESTIMATES,
    STATE,
    WEIGHT_LAW,
)
from hdd_servo_ros.control.adaptive_nn_kernel import adaptive_nn_step as adaptive_nn_step
from hdd_servo_ros.control.adaptive_nn_parameters import AdaptiveNnParameters as AdaptiveNnParameters
from hdd_servo_ros.control.desired_compensation import REGRESSORS
from hdd_servo_ros.control.rbf import largest_square_sum, lattice
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log
from hdd_servo_ros.numerics.records import record, zeros
from hdd_servo_ros.parameters import ParameterError

AdaptiveNnArrays = tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
]


class AdaptiveNn:
    """
    Adaptive neural network controller of chapter 4.

    With e = x - x_d, v = dx/dt::

        r = e' + lambda e                              (4.10)
        a_r = x_d'' - lambda e'                        (4.11)
        u = -k r + sigma_hat v + m_hat a_r - W_hat'S(x, v) sgn r - phi_hat sgn r      (4.16)
        sigma_hat' = -k_sigma (v r + sigma_sigma sigma_hat)                           (4.18)
        m_hat' = -k_m (a_r r + sigma_m m_hat)                                         (4.19)
        phi_hat' = k_phi (|r| - sigma_phi phi_hat)              (4.20, corrected: the dot is missing in print)
        W_hat' = Gamma (S |r| - sigma_w W_hat)                  (4.21, corrected: the dot is missing in print)

    The control at tick k uses the estimates of tick k, which are adapted up to tick k - 1. The adaptation laws are then
    integrated over one sample with r, v, a_r and S held. Each law is linear in its own estimate, so its discrete form
    is exact (see :func:`~hdd_servo_ros.control.adaptation.decay_and_step`), and stable for all nonnegative constants.

    Estimates: t [s]; r [um/s]; sigma_hat [V s/um]; m_hat [V s^2/um]; phi_hat [V]; norm of W_hat [V]; e [um]; the
    network's output W_hat'S [V]; integral of e [um s]; the lattice's widths [um], [um/s]; the compensator's output
    [V]; spring_hat and hysteresis_hat [V/um], relaxation_hat [V s/um], and the estimated bristle friction [V].

    Parameters
    ----------
    parameters
        Design constants. ``docs/controllers/adaptive-nn.md`` lists them with the thesis's symbols.
    sample_time
        T [s].

    Examples
    --------
    One tick with a position error of 0.1 um and a velocity of 50 um/s:

    >>> from hdd_servo_ros.control import AdaptiveNn, AdaptiveNnParameters, ControllerInputs
    >>> controller = AdaptiveNn(AdaptiveNnParameters(), sample_time=1e-4)
    >>> inputs = ControllerInputs(
    ...     tick=0,
    ...     position=0.1,
    ...     velocity=50.0,
    ...     displacement_volts=0.0125,
    ...     velocity_volts=0.002,
    ...     desired_position=0.0,
    ...     desired_velocity=0.0,
    ...     desired_acceleration=0.0,
    ... )
    >>> u, unsaturated, feedback = controller.step(inputs)  # V
    >>> round(u, 6), round(feedback, 6)
    (-0.028732, -0.028732)
    >>> estimates = dict(zip(controller.estimate_names, controller.estimates.tolist(), strict=True))
    >>> estimates['r'], estimates['sigma_hat']  # um/s, V s/um
    (299.6, 6.9e-06)
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: AdaptiveNnParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._output_limit = math.inf
        n, m = parameters.network.nodes, parameters.compensator.nodes
        self.constants = zeros(CONSTANTS)
        self.state = zeros(STATE)
        self.estimates = zeros(ESTIMATES)
        self._centers: NDArray[np.float64] = np.zeros((2, n))
        self._weight_laws = np.tile(zeros(WEIGHT_LAW), (n * n, 1))
        self._activations: NDArray[np.float64] = np.zeros((2, n))
        self._weights: NDArray[np.float64] = np.zeros((n, n))
        self._compensator_centers: NDArray[np.float64] = np.zeros((2, m))
        self._compensator_activations: NDArray[np.float64] = np.zeros((2, m))
        self._compensator_weights: NDArray[np.float64] = np.zeros((m, m))
        self._history: NDArray[np.float64] = np.zeros((parameters.desired.ticks(sample_time) + 1, len(REGRESSORS)))
        self.arrays: AdaptiveNnArrays = (
            self.constants,
            self.state,
            self._centers,
            self._weight_laws,
            self._activations,
            self._weights,
            self._compensator_centers,
            self._compensator_activations,
            self._compensator_weights,
            self._history,
            self.estimates,
        )
        """Array arguments of the kernel, in order; the last one holds the estimates."""
        self._reset(parameters)
        self._apply(parameters)

    def _reset(self, parameters: AdaptiveNnParameters) -> None:
        """Reset the estimates, the weights of both networks and the widths to their initial values."""
        s = record(self.state, STATE)
        s.sigma_hat = parameters.sigma.initial
        s.m_hat = parameters.mass.initial
        s.phi_hat = parameters.phi.initial
        s.spring_hat = parameters.bristle.spring.initial
        s.hysteresis_hat = parameters.bristle.hysteresis.initial
        s.relaxation_hat = parameters.bristle.relaxation.initial
        s.log_position_width = s.log_velocity_width = 0.0
        self.weights[:] = parameters.network.initial
        self.compensator_weights[:] = 0.0

    @property
    def weights(self) -> NDArray[np.float64]:
        """Network weights W_hat [V], a view of shape (n n,), position index first."""
        return self._weights.reshape(-1)

    @property
    def compensator_weights(self) -> NDArray[np.float64]:
        """Compensator weights W_c [V], a view of shape (m m,), position index first."""
        return self._compensator_weights.reshape(-1)

    @property
    def gain_on_r(self) -> float:
        """
        Upper bound k + 1/sigma_phi + max(S'S)/sigma_w [V s/um] of the equivalent linear gain on r.

        The adapted estimates multiply sgn r, as a relay whose height is at most ``mean |r|`` times ``1/sigma_phi +
        max(S'S)/sigma_w``. The equivalent gain of such a relay is 8/pi^2 (sine) or 2/pi (noise) of that factor. With
        adaptive widths, the largest widths are used.
        """
        p = self.parameters
        gain = p.feedback_gain
        if p.phi.enabled and p.phi.gain > 0.0:
            gain += 1.0 / p.phi.leakage if p.phi.leakage > 0.0 else math.inf
        if p.network.enabled and max(p.network.gain) > 0.0:
            factor = p.width.factor if p.width.enabled else 1.0
            position_width, velocity_width = p.network.axis_widths
            squares = largest_square_sum(self._centers[0], factor * position_width)
            squares *= largest_square_sum(self._centers[1], factor * velocity_width)
            gain += squares / p.network.leakage if p.network.leakage > 0.0 else math.inf
        return gain

    def warnings(self) -> tuple[str, ...]:
        """
        Return warnings about these constants: a linear gain above ``safe_gain``, negative adaptation gains.

        ``safe_gain`` is the limit here. If the drive is known, :mod:`~hdd_servo_ros.analysis.fragility` computes it.
        """
        safe, gain = self.parameters.safe_gain, self.gain_on_r
        if not gain > safe > 0.0:
            return self.sign_warnings()
        fragile = (
            f"low stability margin: k + 1/sigma_phi + max(S'S)/sigma_w = {gain:.3g} V s/um acts as one linear gain on "
            f'r and exceeds safe_gain = {safe:.3g} V s/um; the loop may track at first and diverge after seconds: '
            'raise phi.leakage or network.leakage, or lower feedback_gain'
        )
        return fragile, *self.sign_warnings()

    def sign_warnings(self) -> tuple[str, ...]:
        """Return warnings about adaptation laws with a negative gain."""
        return tuple(
            f'{name}.gain = {law.gain:.3g} is negative: the law adapts in the wrong direction, and its leakage '
            f'makes the estimate grow by {-law.gain * law.leakage:.3g} 1/s'
            for name, law in (('sigma', self.parameters.sigma), ('mass', self.parameters.mass))
            if law.enabled and law.gain < 0.0
        )

    def update(self, parameters: AdaptiveNnParameters) -> None:
        """
        Use new parameters from the next tick on; the estimates are kept unless ``reset_count`` changes.

        A reset does not affect the integral of e, the velocity filter and the delayed part of a shaped step, because
        they are not estimates.

        Raises
        ------
        ParameterError
            If the number of nodes or the lag changes: the weights and the stored regressors would be meaningless.
        """
        for name, new, old in (
            ('network.nodes', parameters.network.nodes, len(self._weights)),
            ('compensator.nodes', parameters.compensator.nodes, len(self._compensator_weights)),
            ('desired.lag', parameters.desired.lag, self.parameters.desired.lag),
        ):
            if new != old:
                raise ParameterError(name, new, f'{old}, which is fixed for this run')
        if parameters.reset_count != self.parameters.reset_count:
            self._reset(parameters)
        self._apply(parameters)

    def limit_output(self, limit: float) -> None:
        """Limit the drive voltage also to +-``limit`` [V], the range of the converter after the controller."""
        self._output_limit = limit
        self._apply(self.parameters)

    def _apply(self, parameters: AdaptiveNnParameters) -> None:
        self.parameters = parameters
        c = record(self.constants, CONSTANTS)
        self._fill_signals(c)
        self._fill_laws(c)
        self._fill_desired(c.desired)
        self._fill_network(c.network)
        self._fill_compensator(c.compensator)

    def _fill_signals(self, c: Any) -> None:
        parameters = self.parameters
        c.time_step = self.sample_time
        c.uses_difference = parameters.velocity_source == 'difference'
        c.filters_reference = parameters.filter_reference
        c.smoothing = 1.0
        if parameters.velocity_bandwidth > 0.0:
            c.smoothing = 1.0 - exp(-TWO_PI * parameters.velocity_bandwidth * self.sample_time)
        c.shaping_share = parameters.shaping.share
        c.shaping_ticks = parameters.shaping.ticks(self.sample_time)
        c.error_filter_lambda = parameters.error_filter_lambda
        c.integral_gain = parameters.integral_gain
        c.feedback_gain = parameters.feedback_gain
        c.boundary_layer = parameters.boundary_layer
        c.control_limit = min(parameters.control_limit, self._output_limit)
        c.freezes_when_saturated = parameters.freeze_when_saturated
        c.r_limit = parameters.r_limit

    def _fill_laws(self, c: Any) -> None:
        parameters = self.parameters
        for name, own in parameters.laws.items():
            law = getattr(c, name.removeprefix('bristle.'))
            law.decay, law.step = decay_and_step(own.gain, own.leakage, self.sample_time)
            law.minimum, law.maximum = (own.minimum, own.maximum) if parameters.projection else (-math.inf, math.inf)
            # The law of phi_hat has no regressor to normalize.
            if name != 'phi' and own.scale > 0.0:
                law.normalization = 1.0 / (own.scale * own.scale)
            else:
                law.normalization = 0.0
        for law, own in ((c.sigma, parameters.sigma), (c.mass, parameters.mass), (c.phi, parameters.phi)):
            law.enabled = own.enabled
        width = parameters.width
        reach = log(width.factor)
        c.width.enabled = width.enabled
        c.width.decay, c.width.step = decay_and_step(width.gain, width.leakage, self.sample_time)
        c.width.minimum, c.width.maximum = -reach, reach

    def _fill_desired(self, c: Any) -> None:
        desired, bristle = self.parameters.desired, self.parameters.bristle
        c.enabled = desired.enabled
        c.has_bristles = bristle.enabled
        c.decay = exp(-desired.peak_decay * self.sample_time)
        c.distance = bristle.distance
        c.spring_distance = bristle.spring_distance

    def _fill_network(self, c: Any) -> None:
        network = self.parameters.network
        c.enabled = network.enabled
        c.reads_reference = network.input == 'reference'
        position_width, velocity_width = network.axis_widths
        c.position_inverse_square = 1.0 / (position_width * position_width)
        c.velocity_inverse_square = 1.0 / (velocity_width * velocity_width)
        c.weight_limit = network.maximum if self.parameters.projection else math.inf
        self._centers[0] = lattice(network.position_minimum, network.position_maximum, network.nodes)
        self._centers[1] = lattice(network.velocity_minimum, network.velocity_maximum, network.nodes)
        self._weight_laws[:] = [decay_and_step(gain, network.leakage, self.sample_time) for gain in network.gain]

    def _fill_compensator(self, c: Any) -> None:
        compensator = self.parameters.compensator
        m = compensator.nodes
        c.enabled = compensator.enabled
        position = 0.5 * compensator.width * (compensator.position_maximum - compensator.position_minimum)
        velocity = 0.5 * compensator.width * (compensator.velocity_maximum - compensator.velocity_minimum)
        c.position_inverse_square = 1.0 / (position * position)
        c.velocity_inverse_square = 1.0 / (velocity * velocity)
        c.decay, c.step = decay_and_step(compensator.gain, compensator.leakage, self.sample_time)
        c.lag = compensator.lag
        c.weight_limit = compensator.maximum if self.parameters.projection else math.inf
        self._compensator_centers[0] = lattice(compensator.position_minimum, compensator.position_maximum, m)
        self._compensator_centers[1] = lattice(compensator.velocity_minimum, compensator.velocity_maximum, m)

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit, and its feedback part -k r [V]; see :class:`Controller`."""
        return adaptive_nn_step(*self.arrays, *inputs)
