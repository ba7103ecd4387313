"""Feedforward from accelerometers on the drive's base, against vibration and shock."""

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.feedforward_kernel import (
    CONSTANTS,
    ESTIMATES,
    FIXED,
    FXLMS,
    IIR,
    NETWORK,
    NODES,
    STATE,
    FeedforwardArrays,
    feedforward_step,
)
from hdd_servo_ros.control.feedforward_parameters import FeedforwardParameters
from hdd_servo_ros.numerics.elementary import exp, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import record, zeros

Array = NDArray[np.float64]
PlainArrays = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array]
"""Fields of :class:`FeedforwardArrays`."""

ESTIMATE_NAMES: tuple[str, ...] = ESTIMATES.names or ()
_METHODS = {'fixed': FIXED, 'fxlms': FXLMS, 'iir': IIR, 'network': NETWORK}
_UM_PER_M = 1e6
_NODE_POWER_TIMES = 2.0
"""Averaging time of the nodes' powers, relative to that of the accelerations."""


class AccelerometerScales(NamedTuple):
    """Scale factors of the two accelerometers."""

    sensitivity: float
    """[V s^2/m]."""
    separation: float
    """[m]."""


class Feedforward:
    """
    Feedforward u_ff from two accelerometers on the base, added between control law and DSP.

    The drive moves by x'' = -R alpha - eta a + g (u + u_ff). Half the difference of the sensors gives alpha, half their
    sum gives a, and each is scaled to the equivalent voltage v. Then

        u_ff = sum_i w_i v_rotation(k - i) + sum_i c_i v_linear(k - i),

    with w = c = (1, 0, 0, ...) at tick 0, or a lead. ``fixed`` keeps these weights. ``fxlms`` adapts all weights by the
    filtered-x LMS algorithm (Widrow and Stearns, Adaptive Signal Processing, 1985) in its modified form (Bjarnason,
    IEEE Trans. Speech Audio Process. 3(6), 1995): a model of the path from u_ff to the error gives the error that the
    present weights would have caused, and the weights follow its gradient, computed from the accelerations filtered by
    the path. The filtered accelerations are transformed by a discrete cosine transform and normalized separately
    (Narayan, Peterson and Narasimha, IEEE Trans. Acoust. Speech Signal Process. 31(3), 1983). Without it the algorithm
    takes minutes to converge, since the last n samples of a slow vibration are almost equal. ``iir`` adds two recursive
    weights, projected so that their poles stay inside a circle. ``network`` adds W'S(z), radial basis functions of the
    linear part's output z (section 6.2), with normalized gradient, sigma-modification and projection;
    ``docs/controllers/vibration-feedforward.md`` shows its boundedness.

    A supervisor compares the mean square error with the one expected without feedforward, and fades the feedforward
    out while it increases the error.

    Parameters
    ----------
    parameters
        Method, taps, steps, limits.
    sample_time
        T [s].
    path
        Response of the error to a pulse of the feedforward [um/V], shape (path_length,); element 0 is 0.
    scales
        Scale factors of the sensors.

    Attributes
    ----------
    estimates
        u_ff [V]; fraction of it that is applied, 0 to 1; rms error, and rms error expected without feedforward [um];
        norm of the weights.
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(
        self, parameters: FeedforwardParameters, sample_time: float, path: Array, scales: AccelerometerScales
    ) -> None:
        self.sample_time = sample_time
        self.parameters = parameters
        count, length, nodes = parameters.taps, parameters.path_length, parameters.network.nodes
        self.estimates = zeros(ESTIMATES)
        self._named = FeedforwardArrays(
            constants=zeros(CONSTANTS),
            state=zeros(STATE),
            path=np.zeros(length),
            transform=_cosine_transform(count),
            nominal=np.zeros((2, count)),
            weights=np.zeros((2, count)),
            powers=np.zeros((2, count)),
            transformed=np.zeros((2, count)),
            lines=np.zeros((NODES + nodes, 2 * length)),
            taps=np.zeros((4, 2 * count)),
            network=np.zeros((3, nodes)),
            estimates=self.estimates,
        )
        self.arrays: PlainArrays = cast(PlainArrays, tuple(self._named))
        """Array arguments of the kernel, in order; a plain tuple, because numba cannot concatenate named tuples."""
        self.update(parameters, path, scales)
        self._named.weights[:] = self._named.nominal
        s = record(self._named.state, STATE)
        s.share = float(parameters.enabled)
        s.next_pause = record(self._named.constants, CONSTANTS).pause
        s.settling_left = record(self._named.constants, CONSTANTS).settling

    def update(self, parameters: FeedforwardParameters, path: Array, scales: AccelerometerScales) -> None:
        """Use new parameters from the next tick on; weights and delay lines are kept."""
        pause_before = self.parameters.supervisor.pause
        self.parameters = parameters
        self._named.path[:] = path
        model, supervisor, network = parameters.model, parameters.supervisor, parameters.network
        c = record(self._named.constants, CONSTANTS)
        c.method = _METHODS[parameters.method]
        c.is_enabled = float(parameters.enabled)
        # Half the difference of the sensors is alpha times half their distance.
        c.rotation_scale = model.arm_radius / (model.gain * scales.sensitivity * 0.5 * scales.separation)
        c.linear_scale = model.imbalance * _UM_PER_M / (model.gain * scales.sensitivity)
        c.step_size = parameters.step_size
        c.kept = 1.0 - parameters.leakage
        c.regularization = parameters.regularization
        c.power_decay = exp(-self.sample_time / parameters.power_time)
        c.error_limit = parameters.error_limit
        c.weight_limit = parameters.weight_limit
        c.control_limit = parameters.control_limit
        c.recursive_step_size = parameters.iir.step_size
        c.pole_radius = parameters.iir.pole_radius
        c.node_spacing = 2.0 * network.range / (network.nodes - 1)
        c.node_power_decay = exp(-self.sample_time / (_NODE_POWER_TIMES * parameters.power_time))
        c.network_step_size = network.step_size
        c.network_kept = 1.0 - network.leakage
        c.network_limit = network.maximum
        c.supervises = float(supervisor.enabled)
        c.mean_step = 1.0 - exp(-self.sample_time / supervisor.averaging_time)
        c.recent_step = 1.0 - exp(-self.sample_time / supervisor.reaction_time)
        c.trip_ratio = (1.0 + supervisor.tolerance) ** 2
        c.return_ratio = (1.0 - supervisor.gain_wanted) ** 2
        c.settling = 2.0 * supervisor.averaging_time / self.sample_time
        c.pause = supervisor.pause / self.sample_time
        c.fade_step = self.sample_time / supervisor.fade_time
        self._named.nominal[:] = 0.0
        lead = parameters.lead / self.sample_time if parameters.taps > 1 else 0.0
        self._named.nominal[:, 0] = parameters.initial_gain * (1.0 + lead)
        if parameters.taps > 1:
            self._named.nominal[:, 1] = -parameters.initial_gain * lead
        if parameters.method == 'fixed':
            self._named.weights[:] = self._named.nominal
        if supervisor.pause != pause_before:
            record(self._named.state, STATE).next_pause = c.pause

    @property
    def voltage(self) -> float:
        """Feedforward u_ff of the last step [V]."""
        return float(record(self.estimates, ESTIMATES).u_ff)

    @property
    def is_switched_off(self) -> bool:
        """Whether the supervisor has switched the feedforward off."""
        return bool(record(self._named.state, STATE).is_off)

    @property
    def times_switched_off(self) -> int:
        """Number of times that the supervisor has switched the feedforward off."""
        return int(record(self._named.state, STATE).switched_off)

    @property
    def error_rms(self) -> float:
        """Rms error [um], averaged as in the supervisor."""
        return float(record(self.estimates, ESTIMATES).ff_rms)

    @property
    def error_rms_without(self) -> float:
        """Rms error expected without feedforward [um]."""
        return float(record(self.estimates, ESTIMATES).ff_rms_without)

    def step(self, error: float, x_volts: float, y_volts: float) -> float:
        """
        Return the feedforward u_ff of this tick [V].

        Parameters
        ----------
        error
            Measured minus desired position [um].
        x_volts, y_volts
            Outputs of the accelerometers [V]. If an input is not finite, u_ff is not finite.
        """
        return feedforward_step(*self.arrays, error, x_volts, y_volts)

    def compensate(
        self, error: float, x_volts: float, y_volts: float, u: float, unsaturated: float, feedback: float
    ) -> tuple[float, float, float]:
        """
        Return the controller output of this tick with u_ff added [V].

        Parameters
        ----------
        error, x_volts, y_volts
            See :meth:`step`.
        u, unsaturated, feedback
            Output of :meth:`~hdd_servo_ros.control.controller.Controller.step` [V]; the feedback part is unchanged.
        """
        u_ff = self.step(error, x_volts, y_volts)
        return u + u_ff, unsaturated + u_ff, feedback


def _cosine_transform(count: int) -> Array:
    """Return the orthonormal discrete cosine transform, shape (n, n), column i for frequency i."""
    transform = np.empty((count, count))
    for i in range(count):
        scale = math.sqrt((1.0 if i == 0 else 2.0) / count)
        for j in range(count):
            transform[j, i] = scale * sine_cosine_of_turns((2 * j + 1) * i / (4.0 * count))[1]
    return transform
