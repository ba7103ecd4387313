"""The adaptive neural network controller of chapter 4, (4.10)-(4.21)."""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control import adaptive_nn_kernel as kernel
from hdd_servo_ros.control.adaptation import decay_and_step
from hdd_servo_ros.control.adaptive_nn_kernel import adaptive_nn_step
from hdd_servo_ros.control.adaptive_nn_parameters import NETWORK_INPUTS, VELOCITY_SOURCES, AdaptiveNnParameters
from hdd_servo_ros.control.rbf import largest_square_sum, lattice
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log
from hdd_servo_ros.parameters import ParameterError

AdaptiveNnArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

__all__ = ['AdaptiveNn', 'AdaptiveNnParameters', 'adaptive_nn_step']

ESTIMATE_NAMES = (
    't',
    'r',
    'sigma_hat',
    'm_hat',
    'phi_hat',
    'W_norm',
    'e',
    'network',
    'integral',
    'position_width',
    'velocity_width',
    'compensator',
)


class AdaptiveNn:
    """
    The adaptive neural network controller of chapter 4.

    With e = x - x_d, v = dx/dt,

        r = e' + lambda e                              (4.10)
        a_r = x_d'' - lambda e'                        (4.11)
        u = -k r + sigma_hat v + m_hat a_r - W_hat'S(x, v) sgn r - phi_hat sgn r      (4.16)
        sigma_hat' = -k_sigma (v r + sigma_sigma sigma_hat)                           (4.18)
        m_hat' = -k_m (a_r r + sigma_m m_hat)                                         (4.19)
        phi_hat' = k_phi (|r| - sigma_phi phi_hat)              (4.20, corrected: the dot is missing in print)
        W_hat' = Gamma (S |r| - sigma_w W_hat)                  (4.21, corrected: the dot is missing in print)

    At tick k the control uses the estimates of tick k, which hold what was learnt up to tick k - 1; then the laws run
    over one sample with r, v, a_r and S held. They are linear in their own estimate, so this is done exactly (see
    :func:`~hdd_servo_ros.control.adaptation.decay_and_step`), which is stable for any constants that are not negative.

    Estimates: t [s]; r [um/s]; sigma_hat [V s/um]; m_hat [V s^2/um]; phi_hat [V]; norm of W_hat [V]; e [um]; the
    network's output W_hat'S [V]; integral of e [um s]; the lattice's widths [um], [um/s]; the compensator's output [V].

    Parameters
    ----------
    parameters
        Design constants. ``docs/controllers.md`` relates their names to the thesis's symbols.
    sample_time
        T [s].
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: AdaptiveNnParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._output_limit = math.inf
        self.estimates: NDArray[np.float64] = np.zeros(len(ESTIMATE_NAMES))
        self._nodes = parameters.network.nodes
        self._compensator_nodes = parameters.compensator.nodes
        n, m = self._nodes, self._compensator_nodes
        self.state: NDArray[np.float64] = np.zeros(kernel.ACTIVATIONS + 2 * n + n * n + 2 * m + m * m)
        self._forget(parameters)
        self._take(parameters)

    def _forget(self, parameters: AdaptiveNnParameters) -> None:
        """Set what is learnt to its initial values: the estimates, both networks' weights, the widths."""
        self.state[kernel.SIGMA] = parameters.sigma.initial
        self.state[kernel.MASS] = parameters.mass.initial
        self.state[kernel.PHI] = parameters.phi.initial
        self.state[kernel.POSITION_WIDTH] = self.state[kernel.VELOCITY_WIDTH] = 0.0
        self.weights[:] = parameters.network.initial
        self.compensator_weights[:] = 0.0

    @property
    def weights(self) -> NDArray[np.float64]:
        """W_hat [V], a view of shape (n n,), position index first."""
        start = kernel.ACTIVATIONS + 2 * self._nodes
        return self.state[start : start + self._nodes * self._nodes]

    @property
    def compensator_weights(self) -> NDArray[np.float64]:
        """W_c [V], a view of shape (m m,), position index first."""
        start = kernel.ACTIVATIONS + 2 * self._nodes + self._nodes * self._nodes + 2 * self._compensator_nodes
        return self.state[start : start + self._compensator_nodes * self._compensator_nodes]

    @property
    def gain_on_r(self) -> float:
        """
        The linear gain k + 1/sigma_phi + max(S'S)/sigma_w [V s/um] that the law comes to once its estimates follow |r|.

        A steady |r| ends in phi_hat = |r|/sigma_phi and W_hat = S |r|/sigma_w, and these multiply sgn r. Where the
        widths adapt, the widest lattice counts.
        """
        p = self.parameters
        gain = p.feedback_gain
        if p.phi.enabled and p.phi.gain > 0.0:
            gain += 1.0 / p.phi.leakage if p.phi.leakage > 0.0 else math.inf
        if p.network.enabled and max(p.network.gain) > 0.0:
            factor = p.width.factor if p.width.enabled else 1.0
            position_width, velocity_width = p.network.axis_widths
            squares = largest_square_sum(self._position_centres, factor * position_width)
            squares *= largest_square_sum(self._velocity_centres, factor * velocity_width)
            gain += squares / p.network.leakage if p.network.leakage > 0.0 else math.inf
        return gain

    def warnings(self) -> tuple[str, ...]:
        """
        Return what a user should be told of these constants before a run: what makes the loop fragile, if so.

        ``safe_gain`` judges the loop; where the drive is known, :mod:`~hdd_servo_ros.analysis.fragility` does.
        """
        safe, gain = self.parameters.safe_gain, self.gain_on_r
        if not gain > safe > 0.0:
            return self.sign_warnings()
        fragile = (
            f"fragile constants: k + 1/sigma_phi + max(S'S)/sigma_w = {gain:.3g} V s/um acts as one linear gain on "
            f'r and exceeds safe_gain = {safe:.3g} V s/um; the loop may track at first and burst after seconds: '
            'raise phi.leakage or network.leakage, or lower feedback_gain'
        )
        return fragile, *self.sign_warnings()

    def sign_warnings(self) -> tuple[str, ...]:
        """Return what a user should be told of laws that learn away from the error."""
        return tuple(
            f'{name}.gain = {law.gain:.3g} is negative: the law learns away from the error, and its leakage '
            f'makes the estimate grow by {-law.gain * law.leakage:.3g} 1/s'
            for name, law in (('sigma', self.parameters.sigma), ('mass', self.parameters.mass))
            if law.enabled and law.gain < 0.0
        )

    def update(self, parameters: AdaptiveNnParameters) -> None:
        """
        Take other parameters from the next tick on; what was learnt stays, unless ``reset_count`` is another.

        A reset leaves the integral of e, the velocity filter and a jump's late part alone: they are no estimates.

        Raises
        ------
        ParameterError
            If the number of nodes differs: the weights would have no meaning.
        """
        for name, new, old in (
            ('network.nodes', parameters.network.nodes, self._nodes),
            ('compensator.nodes', parameters.compensator.nodes, self._compensator_nodes),
        ):
            if new != old:
                raise ParameterError(name, new, f'fixed at {old} for this run')
        if parameters.reset_count != self.parameters.reset_count:
            self._forget(parameters)
        self._take(parameters)

    def limit_output(self, limit: float) -> None:
        """Limit the drive voltage to +-``limit`` [V] as well, since no more comes out behind the controller."""
        self._output_limit = limit
        self._take(self.parameters)

    def _take(self, parameters: AdaptiveNnParameters) -> None:
        self.parameters = parameters
        network, compensator = parameters.network, parameters.compensator
        self._position_centres = lattice(network.position_minimum, network.position_maximum, network.nodes)
        self._velocity_centres = lattice(network.velocity_minimum, network.velocity_maximum, network.nodes)
        size = kernel.CENTRES + 2 * network.nodes + 2 * network.nodes**2 + 2 * compensator.nodes
        constants: NDArray[np.float64] = np.zeros(size)
        self._fill_signals(constants)
        self._fill_laws(constants)
        self._fill_network(constants)
        self._fill_compensator(constants)
        self.constants = constants

    def _fill_signals(self, constants: NDArray[np.float64]) -> None:
        parameters = self.parameters
        constants[kernel.TIME_STEP] = self.sample_time
        constants[kernel.VELOCITY_SOURCE] = VELOCITY_SOURCES.index(parameters.velocity_source)
        constants[kernel.FILTER_REFERENCE] = float(parameters.filter_reference)
        constants[kernel.SMOOTHING] = 1.0
        if parameters.velocity_bandwidth > 0.0:
            constants[kernel.SMOOTHING] = 1.0 - exp(-TWO_PI * parameters.velocity_bandwidth * self.sample_time)
        constants[kernel.LAMBDA] = parameters.error_filter_lambda
        constants[kernel.INTEGRAL_GAIN] = parameters.integral_gain
        constants[kernel.SHAPING_SHARE] = parameters.shaping.share
        constants[kernel.SHAPING_TICKS] = parameters.shaping.ticks(self.sample_time)
        constants[kernel.FEEDBACK_GAIN] = parameters.feedback_gain
        constants[kernel.BOUNDARY_LAYER] = parameters.boundary_layer
        constants[kernel.CONTROL_LIMIT] = min(parameters.control_limit, self._output_limit)
        constants[kernel.FREEZE] = float(parameters.freeze_when_saturated)
        constants[kernel.R_LIMIT] = parameters.r_limit

    def _fill_laws(self, constants: NDArray[np.float64]) -> None:
        parameters = self.parameters
        for at, law in (
            (kernel.SIGMA_LAW, parameters.sigma),
            (kernel.MASS_LAW, parameters.mass),
            (kernel.PHI_LAW, parameters.phi),
        ):
            bounds = (law.minimum, law.maximum) if parameters.projection else (-math.inf, math.inf)
            a, b = decay_and_step(law.gain, law.leakage, self.sample_time)
            constants[at : at + kernel.LAW_SIZE] = float(law.enabled), a, b, *bounds
        width = parameters.width
        a, b = decay_and_step(width.gain, width.leakage, self.sample_time)
        reach = log(width.factor)
        constants[kernel.WIDTH_LAW : kernel.WIDTH_LAW + kernel.LAW_SIZE] = float(width.enabled), a, b, -reach, reach

    def _fill_network(self, constants: NDArray[np.float64]) -> None:
        network = self.parameters.network
        n = network.nodes
        constants[kernel.NETWORK] = float(network.enabled)
        constants[kernel.NODES] = n
        constants[kernel.NETWORK_INPUT] = NETWORK_INPUTS.index(network.input)
        position_width, velocity_width = network.axis_widths
        constants[kernel.POSITION_INVERSE] = 1.0 / (position_width * position_width)
        constants[kernel.VELOCITY_INVERSE] = 1.0 / (velocity_width * velocity_width)
        constants[kernel.WEIGHT_LIMIT] = network.maximum if self.parameters.projection else math.inf
        constants[kernel.CENTRES : kernel.CENTRES + n] = self._position_centres
        constants[kernel.CENTRES + n : kernel.CENTRES + 2 * n] = self._velocity_centres
        laws = np.array([decay_and_step(gain, network.leakage, self.sample_time) for gain in network.gain])
        decay = kernel.CENTRES + 2 * n
        constants[decay : decay + n * n] = laws[:, 0]
        constants[decay + n * n : decay + 2 * n * n] = laws[:, 1]

    def _fill_compensator(self, constants: NDArray[np.float64]) -> None:
        compensator = self.parameters.compensator
        m = compensator.nodes
        constants[kernel.COMPENSATOR] = float(compensator.enabled)
        constants[kernel.COMPENSATOR_NODES] = m
        position = 0.5 * compensator.width * (compensator.position_maximum - compensator.position_minimum)
        velocity = 0.5 * compensator.width * (compensator.velocity_maximum - compensator.velocity_minimum)
        constants[kernel.COMPENSATOR_POSITION] = 1.0 / (position * position)
        constants[kernel.COMPENSATOR_VELOCITY] = 1.0 / (velocity * velocity)
        a, b = decay_and_step(compensator.gain, compensator.leakage, self.sample_time)
        constants[kernel.COMPENSATOR_DECAY], constants[kernel.COMPENSATOR_STEP] = a, b
        centres = len(constants) - 2 * m
        constants[kernel.COMPENSATOR_LAG] = compensator.lag
        constants[centres : centres + m] = lattice(compensator.position_minimum, compensator.position_maximum, m)
        constants[centres + m :] = lattice(compensator.velocity_minimum, compensator.velocity_maximum, m)

    @property
    def arrays(self) -> AdaptiveNnArrays:
        """The arrays that the kernel takes first: constants, state, estimates."""
        return self.constants, self.state, self.estimates

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit, and its feedback part -k r [V]; see :class:`Controller`."""
        return adaptive_nn_step(*self.arrays, *inputs)
