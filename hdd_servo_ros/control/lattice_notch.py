"""Adaptive notch in lattice form, whose center follows a narrow-band signal."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

Array = NDArray[np.float64]
METHODS = ('gradient', 'least_squares')
"""Values of ``method``, in the order of their numbers in the kernel."""

NOTCH = layout('k2', 'lowest', 'highest', 'step', 'forgetting', 'method', 'enabled')
"""Constants: bandwidth coefficient, bounds of the center coefficient, step, forgetting factor, method, switch."""
STATE = layout('k1', 'last', 'before', 'numerator', 'power')
"""Center coefficient, the last two states of the all-pass, and the sums of the adaptation."""
_HALVINGS = 50
"""Bisections for the center frequency, to the last bits."""


@dataclasses.dataclass(frozen=True)
class LatticeNotchParameters(ParameterSet):
    """Parameters of :class:`LatticeNotch`."""

    frequency: float = parameter(5000.0, 'center frequency at the start', unit='Hz', above=0.0)
    lowest: float = parameter(4000.0, 'lowest center frequency', unit='Hz', above=0.0)
    highest: float = parameter(6000.0, 'highest center frequency', unit='Hz', above=0.0)
    bandwidth: float = parameter(500.0, 'width of the notch at -3 dB', unit='Hz', above=0.0)
    method: str = parameter('gradient', 'adaptation of the center', choices=METHODS)
    step: float = parameter(0.01, 'step of the gradient method, relative', minimum=0.0, maximum=1.0)
    memory: float = parameter(
        0.01, 'time constant of the sums of both methods, over which past signals are forgotten', unit='s', above=0.0
    )
    enabled: bool = parameter(True, 'adapt the center; if false, the notch is fixed')

    def check_together(self) -> None:
        """Check that the center is between its bounds."""
        if not self.lowest <= self.frequency <= self.highest:
            raise ParameterError(
                'frequency', self.frequency, f'between lowest and highest, {self.lowest:g} to {self.highest:g} Hz'
            )


@compiled
def lattice_notch_step(constants: Array, state: Array, value: float) -> float:
    """Return the output of the notch, (1 + A)/2 of the all-pass A, and adapt its center."""
    c = record(constants, NOTCH)
    s = record(state, STATE)
    k1, k2 = s.k1, c.k2
    forward = value - k2 * s.before
    inner = forward - k1 * s.last
    output: float = 0.5 * (value + (k2 * forward + s.before))
    regressor = s.last
    backward = k1 * inner + s.last
    if c.enabled > 0.0:
        # With f the input through 1/D, the output is (1 + k2)/2 (f(n) + 2 k1 f(n - 1) + f(n - 2)).
        s.power = c.forgetting * s.power + (1.0 - c.forgetting) * regressor * regressor
        moved = k1
        if c.method == 0.0:
            if s.power > 0.0:
                moved = k1 - c.step * output * regressor / s.power
        else:
            # Without the coefficient of the center, of which f(n) + f(n - 2) is a multiple for a sine.
            rest = 2.0 * output / (1.0 + k2) - 2.0 * k1 * regressor
            s.numerator = c.forgetting * s.numerator + (1.0 - c.forgetting) * regressor * rest
            if s.power > 0.0:
                moved = -0.5 * s.numerator / s.power
        s.k1 = min(max(moved, c.lowest), c.highest)
    s.before = backward
    s.last = inner
    return output


class LatticeNotch:
    """
    Second-order notch (1 + A(z))/2 with an all-pass A in lattice form, whose center minimizes its output.

    The center coefficient k1 = -cos(w T) and the bandwidth coefficient k2 act on center and width alone, and the notch
    is stable for any center. Its gain is 1 at 0 Hz and at the Nyquist frequency.

    Parameters
    ----------
    parameters
        The notch and its adaptation.
    sample_time
        Sample time of the notch [s].

    Raises
    ------
    ParameterError
        If a frequency is not below the Nyquist frequency.

    Notes
    -----
    Source: P. A. Regalia, An improved lattice-based adaptive IIR notch filter, IEEE Trans. Signal Processing 39 (1991).

    Examples
    --------
    The center moves to the frequency of a sine of 5.4 kHz:

    >>> import math
    >>> from hdd_servo_ros.control.lattice_notch import LatticeNotch, LatticeNotchParameters
    >>> notch = LatticeNotch(LatticeNotchParameters(), sample_time=2e-5)
    >>> for tick in range(3000):
    ...     output = notch.step(math.sin(2.0 * math.pi * 5400.0 * 2e-5 * tick))
    >>> round(notch.frequency)
    5400
    """

    def __init__(self, parameters: LatticeNotchParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state = zeros(STATE)
        self.update(parameters)
        record(self.state, STATE).k1 = -sine_cosine_of_turns(parameters.frequency * sample_time)[1]

    def update(self, parameters: LatticeNotchParameters) -> None:
        """Change the parameters from the next step on; the present center is kept within its new bounds."""
        for name in ('highest', 'bandwidth'):
            if not 2.0 * getattr(parameters, name) * self.sample_time < 1.0:
                allowed = f'below the Nyquist frequency of the notch, {0.5 / self.sample_time:g} Hz'
                raise ParameterError(name, getattr(parameters, name), allowed)
        constants = zeros(NOTCH)
        c = record(constants, NOTCH)
        sine, cosine = sine_cosine_of_turns(0.5 * parameters.bandwidth * self.sample_time)
        c.k2 = (cosine - sine) / (cosine + sine)
        c.lowest, c.highest = (
            -sine_cosine_of_turns(frequency * self.sample_time)[1]
            for frequency in (parameters.lowest, parameters.highest)
        )
        c.step = parameters.step
        c.forgetting = 1.0 / (1.0 + self.sample_time / parameters.memory)
        c.method = METHODS.index(parameters.method)
        c.enabled = parameters.enabled
        s = record(self.state, STATE)
        s.k1 = min(max(s.k1, c.lowest), c.highest)
        self.parameters = parameters
        self.arrays = (constants, self.state)

    @property
    def frequency(self) -> float:
        """Present center frequency [Hz]."""
        k1 = record(self.state, STATE).k1
        low, high = 0.0, 0.5
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if -sine_cosine_of_turns(middle)[1] < k1:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high) / self.sample_time

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response with the present center at ``frequencies`` [Hz]."""
        z = np.exp(1j * TWO_PI * np.asarray(frequencies, dtype=np.float64) * self.sample_time)
        k1, k2 = float(record(self.state, STATE).k1), float(record(self.arrays[0], NOTCH).k2)
        numerator = 0.5 * (1.0 + k2) * (1.0 + 2.0 * k1 / z + z**-2)
        return np.asarray(numerator / (1.0 + k1 * (1.0 + k2) / z + k2 * z**-2), dtype=np.complex128)

    def step(self, value: float) -> float:
        """Return the output for the next input, and adapt the center."""
        return lattice_notch_step(*self.arrays, value)
