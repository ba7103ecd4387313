"""Cancellation of repeatable runout: adaptive feedforward of harmonics, or repetitive control per sector."""

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.runout_kernel import (
    CONSTANTS,
    COSINE,
    ESTIMATES,
    FILTER,
    HARMONICS,
    ORDER,
    PARTS,
    REPETITIVE,
    SCALE,
    SINE,
    STATE,
    RunoutArrays,
    learning_filter,
    response_at,
    runout_step,
)
from hdd_servo_ros.control.runout_parameters import RunoutParameters
from hdd_servo_ros.numerics.records import record, zeros
from hdd_servo_ros.parameters import ParameterError

Array = NDArray[np.float64]
PlainArrays = tuple[Array, Array, Array, Array, Array, Array, Array]
"""Fields of :class:`~hdd_servo_ros.control.runout_kernel.RunoutArrays`."""

ESTIMATE_NAMES: tuple[str, ...] = ESTIMATES.names or ()
_METHODS = {'harmonics': HARMONICS, 'repetitive': REPETITIVE}
_TOLERANCE, _ROUNDING = 1e-5, 0.501e-9
"""Tolerances on the difference between T and the time between two sectors: relative, and [s]; as for the spindle."""
_REVOLUTIONS_OF_PATH = 4.0
"""Revolutions of the pulse response from which the method harmonics computes its phase angles."""


def samples_per_revolution(parameters: RunoutParameters, sample_time: float) -> int:
    """
    Return the number of samples of T [s] per revolution, 0 if it is not an integer.

    A revolution has exactly N samples if T differs from 60/(rpm N) by at most 1e-5 of T, or by rounding to integer
    nanoseconds.
    """
    count = parameters.sectors or round(60.0 / (parameters.revolutions_per_minute * sample_time)) or 1
    between = 60.0 / (parameters.revolutions_per_minute * count)
    return count if abs(between - sample_time) <= max(_TOLERANCE * sample_time, _ROUNDING) else 0


def path_length(parameters: RunoutParameters, sample_time: float) -> int:
    """
    Return the number of samples of the error's pulse response that the cancellation needs, including the first one.

    Raises
    ------
    ParameterError
        If T [s] and the parameters are incompatible.
    """
    samples = samples_per_revolution(parameters, sample_time)
    if parameters.method == 'harmonics':
        highest = max(parameters.orders)
        turns = _turns_per_sample(parameters, sample_time)
        if not highest * turns < 0.5:
            allowed = f'below {0.5 / turns:.4g}, half the sampling frequency, at sample_time = {sample_time!r} s'
            raise ParameterError('runout.orders', parameters.orders, allowed)
        return math.ceil(_REVOLUTIONS_OF_PATH / turns)
    if samples < 3:
        count = parameters.sectors or round(60.0 / (parameters.revolutions_per_minute * sample_time)) or 1
        needed = round(60e9 / (parameters.revolutions_per_minute * count)) / 1e9
        allowed = (
            'harmonics, since repetitive needs an integer number of samples per revolution, at least 3, such as '
            f'{count} with sample_time = {needed!r} s at {parameters.revolutions_per_minute:g} 1/min; sample_time is '
            f'{sample_time!r} s'
        )
        raise ParameterError('runout.method', parameters.method, allowed)
    return samples + 1


def _turns_per_sample(parameters: RunoutParameters, sample_time: float) -> float:
    samples = samples_per_revolution(parameters, sample_time)
    return 1.0 / samples if samples else parameters.revolutions_per_minute * sample_time / 60.0


class RunoutCancellation:
    """
    Cancellation of the error component that repeats with every revolution of the spindle.

    A voltage u_rro is added to the output of a controller. With the spindle angle theta and the response H_n of the
    error to u_rro at order n, ``harmonics`` is adaptive feedforward cancellation (Bodson, Sacks and Khosla, IEEE Trans.
    Autom. Control 39(9), 1994):

        u_rro = sum of a_n cos n theta + b_n sin n theta,
        a_n -= g 2/(N |H_n|) e cos(n theta + arg H_n),   b_n -= g 2/(N |H_n|) e sin(n theta + arg H_n),

    with N samples per revolution, so that each revolution removes the fraction g of the error. g decreases from
    ``initial_gain`` as 2/(2 + t), with t revolutions of learning, to ``gain``. It works at any T.

    ``repetitive`` is repetitive control with an internal model of the path. The error without the cancellation is
    computed with the pulse response h of the error to u_rro: d = e - h * u_rro. Its mean over the revolutions is kept
    for each sector. The newest revolution has the weight g: 1/j in the j-th revolution, and at least ``gain``. The
    first revolutions are averaged, so that noise is not learned as runout. In the next revolution

        u_rro = -(periodic convolution of the mean with l),   l = inverse DFT of Q_k/H_k,

    Q_k = 1/(1 + (k f_rev/cutoff)^8). The filter is noncausal: it uses the previous revolutions ahead of the sector.

    Parameters
    ----------
    parameters
        Method, speed, gains, limits.
    sample_time
        T [s].
    path
        Response of the error to a pulse of u_rro [um/V], shape (:func:`path_length`,); element 0 is 0.

    Attributes
    ----------
    path
        The pulse response above.
    estimates
        u_rro [V]; rms of the learned cancellation over a revolution [V]; the gain g.

    Raises
    ------
    ParameterError
        If T and the parameters are incompatible.
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: RunoutParameters, sample_time: float, path: Array) -> None:
        self.sample_time = sample_time
        self.estimates = zeros(ESTIMATES)
        path_length(parameters, sample_time)  # Rejects an incompatible T.
        samples = samples_per_revolution(parameters, sample_time) if parameters.method == 'repetitive' else 0
        self._named = RunoutArrays(
            constants=zeros(CONSTANTS),
            state=zeros(STATE),
            harmonics=np.zeros((6, len(parameters.orders))),
            sectors=np.zeros(PARTS * samples),
            path=np.zeros(samples),
            line=np.zeros(2 * samples),
            estimates=self.estimates,
        )
        self.arrays: PlainArrays = cast(PlainArrays, tuple(self._named))
        """Array arguments of the kernel, in order; a plain tuple, because numba cannot concatenate named tuples."""
        self.update(parameters, path)

    def update(self, parameters: RunoutParameters, path: Array) -> None:
        """Use new parameters from the next tick on; the learned cancellation is kept."""
        self.parameters, self.path = parameters, path
        samples = samples_per_revolution(parameters, self.sample_time)
        turns = _turns_per_sample(parameters, self.sample_time)
        c = record(self._named.constants, CONSTANTS)
        c.method = _METHODS[parameters.method]
        c.acts = float(parameters.enabled)
        c.learns = float(parameters.enabled and parameters.learning)
        c.samples = float(samples)
        c.turns_per_sample = turns
        c.gain = parameters.gain
        c.initial_gain = parameters.initial_gain
        # Exact for an integer number of samples, since 1.0/(1.0/n) may be less than n.
        c.first_tick = float(parameters.wait * samples) if samples else math.ceil(parameters.wait / turns)
        c.error_limit = parameters.error_limit
        c.control_limit = parameters.control_limit
        if parameters.method == 'repetitive':
            taps = np.zeros(samples)
            learning_filter(path, parameters.cutoff * samples * self.sample_time, taps)
            self._named.sectors[FILTER * samples : (FILTER + 1) * samples] = np.roll(taps[::-1], 1)
            self._named.path[:] = path[1:]
            return
        harmonics = self._named.harmonics
        for i, order in enumerate(parameters.orders):
            real, imaginary = response_at(path, order * turns)
            size = math.sqrt(real * real + imaginary * imaginary)
            harmonics[ORDER, i] = order
            harmonics[SINE, i], harmonics[COSINE, i] = (imaginary / size, real / size) if size > 0.0 else (0.0, 0.0)
            harmonics[SCALE, i] = 2.0 * turns / size if size > 0.0 else 0.0

    @property
    def learned_rms(self) -> float:
        """Rms of the learned cancellation over a revolution [V]."""
        return float(record(self.estimates, ESTIMATES).rro_rms)

    @property
    def is_limited(self) -> bool:
        """Whether the cancellation reached its limit in the last revolution, as when it diverges."""
        return bool(record(self._named.state, STATE).limited_left > 0.0)

    @property
    def gain(self) -> float:
        """Present fraction of the repeatable error that is learned per revolution."""
        return float(record(self.estimates, ESTIMATES).rro_gain)

    def step(self, tick: int, error: float) -> float:
        """
        Return u_rro of a tick [V].

        Parameters
        ----------
        tick
            Tick k, which gives the spindle angle.
        error
            Measured minus desired position [um]. If it is not finite, u_rro is NaN.
        """
        return runout_step(*self.arrays, tick, error)

    def compensate(
        self, tick: int, error: float, u: float, unsaturated: float, feedback: float
    ) -> tuple[float, float, float]:
        """
        Return the controller output of this tick with u_rro added [V].

        Parameters
        ----------
        tick, error
            See :meth:`step`.
        u, unsaturated, feedback
            Output of :meth:`~hdd_servo_ros.control.controller.Controller.step` [V]; the feedback part is unchanged.
        """
        u_rro = self.step(tick, error)
        return u + u_rro, unsaturated + u_rro, feedback
