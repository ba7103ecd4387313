"""Feedforward from accelerometers on the base of the drive, against vibration and shock."""

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
"""The fields of :class:`FeedforwardArrays`."""

ESTIMATE_NAMES: tuple[str, ...] = ESTIMATES.names or ()
_METHODS = {'fixed': FIXED, 'fxlms': FXLMS, 'iir': IIR, 'network': NETWORK}
_UM_PER_M = 1e6
_NODE_POWER_TIMES = 2.0
"""The nodes' powers are averaged for this many times as long as those of the accelerations."""


class AccelerometerScales(NamedTuple):
    """How the outputs of the two accelerometers are read."""

    sensitivity: float
    """[V s^2/m]."""
    separation: float
    """[m]."""


class Feedforward:
    """
    Feedforward u_ff between a controller's law and the DSP, from two accelerometers on the base.

    The drive moves by x'' = -R alpha - eta a + g (u + u_ff): half the difference of the sensors gives alpha, half their
    sum gives a, and each is scaled to the voltage v that it acts like. Then

        u_ff = sum_i w_i v_rotation(k - i) + sum_i c_i v_linear(k - i),

    with w = c = (1, 0, 0, ...) at tick 0, or a lead. ``fixed`` leaves it at that. ``fxlms`` adapts all weights by the
    filtered-x LMS algorithm (Widrow and Stearns, Adaptive Signal Processing, 1985) in its modified form (Bjarnason,
    IEEE Trans. Speech Audio Process. 3(6), 1995): from the model of the path from u_ff to the error follows the error
    as it would be with the present weights all the time, and that is reduced along the accelerations filtered by the
    path. These pass a discrete cosine transform and are normalized one by one (Narayan, Peterson and Narasimha, IEEE
    Trans. Acoust. Speech Signal Process. 31(3), 1983), since the last n samples of a slow vibration are nearly the same
    and the plain algorithm takes minutes. ``iir`` adds two recursive weights, projected so that their poles stay inside
    a circle. ``network`` adds W'S(z), radial basis functions of the linear part's output z (section 6.2), with
    normalized gradient, sigma-modification and projection; for its boundedness, see
    ``docs/controllers/vibration-feedforward.md``.

    A supervisor compares the mean square of the error with that of the error as it would be without feedforward, and
    fades the feedforward out while it does harm.

    Parameters
    ----------
    parameters
        Method, taps, steps, limits.
    sample_time
        T [s].
    path
        Response of the error to a pulse of the feedforward [um/V], shape (path_length,); element 0 is 0.
    scales
        How the sensors are read.

    Attributes
    ----------
    estimates
        u_ff [V]; the share of it that acts, 0 to 1; rms of the error, and as it would be without feedforward [um]; norm
        of the weights.
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
        """The arrays that the kernel takes first: plain, as numba joins no named tuple to another."""
        self.update(parameters, path, scales)
        self._named.weights[:] = self._named.nominal
        s = record(self._named.state, STATE)
        s.share = float(parameters.enabled)
        s.next_pause = record(self._named.constants, CONSTANTS).pause
        s.settling_left = record(self._named.constants, CONSTANTS).settling

    def update(self, parameters: FeedforwardParameters, path: Array, scales: AccelerometerScales) -> None:
        """Take other parameters from the next tick on; what was adapted and what is remembered go on."""
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
        """u_ff of the last step [V]."""
        return float(record(self.estimates, ESTIMATES).u_ff)

    @property
    def is_switched_off(self) -> bool:
        """Whether the supervisor has switched the feedforward off at present."""
        return bool(record(self._named.state, STATE).is_off)

    @property
    def times_switched_off(self) -> int:
        """How often the supervisor has switched the feedforward off."""
        return int(record(self._named.state, STATE).switched_off)

    @property
    def error_rms(self) -> float:
        """Rms of the error [um], averaged as the supervisor does."""
        return float(record(self.estimates, ESTIMATES).ff_rms)

    @property
    def error_rms_without(self) -> float:
        """Rms of the error as it would be without feedforward [um]."""
        return float(record(self.estimates, ESTIMATES).ff_rms_without)

    def step(self, error: float, x_volts: float, y_volts: float) -> float:
        """
        Return u_ff of this tick [V].

        Parameters
        ----------
        error
            Measured position less desired position [um].
        x_volts, y_volts
            Outputs of the accelerometers [V]. If an input is not finite, neither is u_ff.
        """
        return feedforward_step(*self.arrays, error, x_volts, y_volts)

    def compensate(
        self, error: float, x_volts: float, y_volts: float, u: float, unsaturated: float, feedback: float
    ) -> tuple[float, float, float]:
        """
        Return a controller's output of this tick with u_ff added [V].

        Parameters
        ----------
        error, x_volts, y_volts
            As of :meth:`step`.
        u, unsaturated, feedback
            As :meth:`~hdd_servo_ros.control.controller.Controller.step` returns them [V]; the feedback part stays.
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
