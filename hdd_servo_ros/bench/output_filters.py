"""Chain of filters between controller and converter: notches, resonant filters, lead filters, low passes, sections."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, sine_cosine_of_turns
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

Array = NDArray[np.float64]

_B, _A, _HISTORY = slice(0, 3), slice(3, 5), slice(5, 9)
"""Columns of a section: b0, b1, b2; a1, a2 (a0 is 1); and the last two inputs and outputs."""
_WIDTH = 9
_CHANGED, _OFFSET, _LEFT, _FADE, _COUNT, _FORMER, _LAST = range(7)
"""
Elements of the first row of the chain.

Whether the filters were changed, offset of the output and its updates left of a number of updates, sections of the
chain and of the former chain, last input.
"""
_LN_10 = 2.302585092994046


def _check_lengths(values: ParameterSet, count: int, *names: str) -> None:
    """Raise :class:`ParameterError` unless each list has one element or one per filter."""
    for name in names:
        given = getattr(values, name)
        if len(given) not in (1, count):
            raise ParameterError(name, given, f'one element, or one per frequency ({count})')


def _per_filter(values: Sequence[float], count: int) -> Sequence[float]:
    return values if len(values) == count else tuple(values) * count


@dataclasses.dataclass(frozen=True)
class NotchParameters(ParameterSet):
    """Notches (s^2 + 2 g z w s + w^2)/(s^2 + 2 z w s + w^2), with the gain g = 10^(-depth/20) at the center."""

    frequencies: tuple[float, ...] = parameter((), 'center frequency of each notch', unit='Hz', above=0.0)
    dampings: tuple[float, ...] = parameter(
        (0.1,), 'damping ratio z of the poles, half the relative width; one value, or one per notch', above=0.0
    )
    depths: tuple[float, ...] = parameter(
        (40.0,),
        'attenuation at the center; one value, or one per notch',
        unit='dB',
        minimum=0.0,
        maximum=200.0,
    )

    def check_together(self) -> None:
        """Check the lengths of the lists."""
        _check_lengths(self, len(self.frequencies), 'dampings', 'depths')


@dataclasses.dataclass(frozen=True)
class ResonantParameters(ParameterSet):
    """Resonant filters 1 + 2 k z w (s cos phi - w sin phi)/(s^2 + 2 z w s + w^2), 1 + k exp(i phi) at the center."""

    frequencies: tuple[float, ...] = parameter((), 'center frequency of each filter', unit='Hz', above=0.0)
    dampings: tuple[float, ...] = parameter(
        (0.05,), 'damping ratio z of the poles; one value, or one per filter', above=0.0
    )
    gains: tuple[float, ...] = parameter((1.0,), 'gain k at the center, added to 1; one value, or one per filter')
    phases: tuple[float, ...] = parameter(
        (0.0,),
        'phase phi of the added part at the center; one value, or one per filter',
        unit='deg',
        minimum=-360.0,
        maximum=360.0,
    )

    def check_together(self) -> None:
        """Check the lengths of the lists."""
        _check_lengths(self, len(self.frequencies), 'dampings', 'gains', 'phases')


@dataclasses.dataclass(frozen=True)
class LeadParameters(ParameterSet):
    """Lead filters (1 + q s/w)/(1 + s/(q w)), with q^2 = (1 + sin phi)/(1 - sin phi) and the gain 1 at 0 Hz."""

    frequencies: tuple[float, ...] = parameter(
        (), 'frequency of the largest phase lead of each filter', unit='Hz', above=0.0
    )
    phases: tuple[float, ...] = parameter(
        (30.0,),
        'largest phase lead phi, negative for a lag; one value, or one per filter',
        unit='deg',
        minimum=-80.0,
        maximum=80.0,
    )

    def check_together(self) -> None:
        """Check the lengths of the lists."""
        _check_lengths(self, len(self.frequencies), 'phases')


@dataclasses.dataclass(frozen=True)
class LowPassParameters(ParameterSet):
    """Low passes w^2/(s^2 + 2 z w s + w^2)."""

    frequencies: tuple[float, ...] = parameter((), 'natural frequency of each low pass', unit='Hz', above=0.0)
    dampings: tuple[float, ...] = parameter(
        (0.7,), 'damping ratio z of the poles; one value, or one per low pass', above=0.0
    )

    def check_together(self) -> None:
        """Check the lengths of the lists."""
        _check_lengths(self, len(self.frequencies), 'dampings')


@dataclasses.dataclass(frozen=True)
class FilterParameters(ParameterSet):
    """
    Parameters of :class:`OutputFilters`; with the defaults, the chain has no filter.

    Examples
    --------
    >>> from hdd_servo_ros.bench import FilterParameters
    >>> from hdd_servo_ros.parameters import from_mapping
    >>> filters = from_mapping(FilterParameters, {'notch.frequencies': (5476.0, 6494.0), 'notch.depths': (30.0,)})
    >>> filters.is_used, filters.notch.dampings
    (True, (0.1,))
    """

    notch: NotchParameters = group(NotchParameters)
    resonant: ResonantParameters = group(ResonantParameters)
    lead: LeadParameters = group(LeadParameters)
    low_pass: LowPassParameters = group(LowPassParameters)
    sections: tuple[float, ...] = parameter(
        (),
        'coefficients b0, b1, b2, 1, a1, a2 of discrete sections at the rate of the updates, concatenated, as '
        "scipy.signal returns them with output='sos'",
    )
    fade_time: float = parameter(
        1e-3, 'time over which the step that a change would cause in the output fades out', unit='s', minimum=0.0
    )

    @property
    def is_used(self) -> bool:
        """Whether the chain has a filter."""
        kinds = (self.notch, self.resonant, self.lead, self.low_pass)
        return bool(self.sections) or any(kind.frequencies for kind in kinds)

    def check_together(self) -> None:
        """Check that the sections are complete and stable."""
        if len(self.sections) % 6:
            raise ParameterError('sections', self.sections, 'six numbers per section')
        for i in range(0, len(self.sections), 6):
            a0, a1, a2 = self.sections[i + 3 : i + 6]
            if a0 != 1.0 or not abs(a2) < 1.0 or not abs(a1) < 1.0 + a2:
                raise ParameterError(
                    'sections', self.sections, f'1 and stable poles (|a2| < 1, |a1| < 1 + a2) in section {i // 6 + 1}'
                )


def filter_sections(parameters: FilterParameters, sample_time: float) -> list[tuple[tuple[str, int], Sequence[float]]]:
    """
    Return kind and number of each filter, and its coefficients b0, b1, b2, a1, a2, in the order of the chain.

    The filters are converted by the bilinear transform (Tustin), prewarped at their own frequency.

    Parameters
    ----------
    parameters
        The filters.
    sample_time
        Sample time of the filters [s].

    Raises
    ------
    ParameterError
        If a frequency is not below the Nyquist frequency.
    """
    found: list[tuple[tuple[str, int], Sequence[float]]] = []
    for kind in ('notch', 'resonant', 'lead', 'low_pass'):
        frequencies = getattr(parameters, kind).frequencies
        for frequency in frequencies:
            if not 2.0 * frequency * sample_time < 1.0:
                raise ParameterError(
                    f'dsp.filters.{kind}.frequencies',
                    frequencies,
                    f'each below the Nyquist frequency of the filters, {0.5 / sample_time:g} Hz',
                )
        polynomials: Iterator[tuple[_Polynomial, _Polynomial]] = _POLYNOMIALS[kind](getattr(parameters, kind))
        for number, (frequency, (numerator, denominator)) in enumerate(zip(frequencies, polynomials, strict=True)):
            sine, cosine = sine_cosine_of_turns(0.5 * frequency * sample_time)
            found.append(((kind, number), _discrete(numerator, denominator, cosine / sine)))
    for i in range(0, len(parameters.sections), 6):
        b0, b1, b2, _, a1, a2 = parameters.sections[i : i + 6]
        found.append((('sections', i // 6), (b0, b1, b2, a1, a2)))
    return found


_Polynomial = tuple[float, float, float]
"""Coefficients of p^2, p and 1, for p = s/w."""


def _notches(p: NotchParameters) -> Iterator[tuple[_Polynomial, _Polynomial]]:
    count = len(p.frequencies)
    for damping, depth in zip(_per_filter(p.dampings, count), _per_filter(p.depths, count), strict=False):
        gain = exp(-depth * (_LN_10 / 20.0))
        yield (1.0, 2.0 * damping * gain, 1.0), (1.0, 2.0 * damping, 1.0)


def _resonant(p: ResonantParameters) -> Iterator[tuple[_Polynomial, _Polynomial]]:
    count = len(p.frequencies)
    lists = (_per_filter(values, count) for values in (p.dampings, p.gains, p.phases))
    for damping, gain, phase in zip(*lists, strict=False):
        sine, cosine = sine_cosine_of_turns(phase / 360.0)
        width = 2.0 * damping
        yield (1.0, width + width * gain * cosine, 1.0 - width * gain * sine), (1.0, width, 1.0)


def _leads(p: LeadParameters) -> Iterator[tuple[_Polynomial, _Polynomial]]:
    for phase in _per_filter(p.phases, len(p.frequencies)):
        sine, _ = sine_cosine_of_turns(phase / 360.0)
        ratio = math.sqrt((1.0 + sine) / (1.0 - sine))
        yield (0.0, ratio, 1.0), (0.0, 1.0 / ratio, 1.0)


def _low_passes(p: LowPassParameters) -> Iterator[tuple[_Polynomial, _Polynomial]]:
    for damping in _per_filter(p.dampings, len(p.frequencies)):
        yield (0.0, 0.0, 1.0), (1.0, 2.0 * damping, 1.0)


_POLYNOMIALS: dict[str, Any] = {'notch': _notches, 'resonant': _resonant, 'lead': _leads, 'low_pass': _low_passes}


def _discrete(numerator: _Polynomial, denominator: _Polynomial, k: float) -> Sequence[float]:
    """Return b0, b1, b2, a1, a2 for p = k (z - 1)/(z + 1), by plain arithmetic in a fixed order."""
    (n2, n1, n0), (d2, d1, d0) = numerator, denominator
    if n2 == 0.0 and d2 == 0.0:
        # Of first order: with the second order, numerator and denominator would share a zero at -1.
        a0 = d1 * k + d0
        return (n1 * k + n0) / a0, (n0 - n1 * k) / a0, 0.0, (d0 - d1 * k) / a0, 0.0
    a0 = d2 * k * k + d1 * k + d0
    return (
        (n2 * k * k + n1 * k + n0) / a0,
        2.0 * (n0 - n2 * k * k) / a0,
        (n2 * k * k - n1 * k + n0) / a0,
        2.0 * (d0 - d2 * k * k) / a0,
        (d2 * k * k - d1 * k + d0) / a0,
    )


@compiled
def filters_step(chain: Array, value: float) -> float:
    """Return the output of a chain for its next input; see :class:`OutputFilters` for the rows of ``chain``."""
    count = int(chain[0, _COUNT])
    chain[0, _LAST] = value
    output = _cascade(chain, 1, count, value)
    if chain[0, _CHANGED] > 0.0:
        chain[0, _CHANGED] = 0.0
        former = _cascade(chain, 1 + count, int(chain[0, _FORMER]), value)
        if chain[0, _LEFT] > 0.0:
            former += chain[0, _OFFSET] * (chain[0, _LEFT] / chain[0, _FADE])
        chain[0, _OFFSET] = former - output
        chain[0, _LEFT] = chain[0, _FADE]
    if chain[0, _LEFT] > 0.0:
        output += chain[0, _OFFSET] * (chain[0, _LEFT] / chain[0, _FADE])
        chain[0, _LEFT] -= 1.0
    return output


@compiled
def _cascade(chain: Array, first: int, count: int, value: float) -> float:
    """Advance consecutive sections in direct form I, whose states are past signals, whatever the coefficients."""
    for i in range(first, first + count):
        output = chain[i, 0] * value + chain[i, 1] * chain[i, 5] + chain[i, 2] * chain[i, 6]
        output = output - chain[i, 3] * chain[i, 7] - chain[i, 4] * chain[i, 8]
        chain[i, 6] = chain[i, 5]
        chain[i, 5] = value
        chain[i, 8] = chain[i, 7]
        chain[i, 7] = output
        value = output
    return value


class OutputFilters:
    """
    Chain of second-order filters in series, whose parameters may change without a step in the output.

    After a change, the chain continues from the past signals of the filters that remain. The step that the change would
    cause in the output is subtracted, and fades out linearly over the fade time.

    Parameters
    ----------
    parameters
        The filters, in the order notches, resonant filters, lead filters, low passes, sections.
    sample_time
        Sample time of the filters [s]: T divided by the updates per sample.

    Attributes
    ----------
    chain
        The array of the kernel: a row with the state of a change, then a row per section with its coefficients and its
        last inputs and outputs, then those of the former chain.

    Raises
    ------
    ParameterError
        If a frequency is not below the Nyquist frequency of the filters.

    Examples
    --------
    A notch of 40 dB at 5 kHz, sampled at 20 kHz:

    >>> from hdd_servo_ros.bench import FilterParameters, OutputFilters
    >>> from hdd_servo_ros.parameters import from_mapping
    >>> filters = OutputFilters(from_mapping(FilterParameters, {'notch.frequencies': (5000.0,)}), sample_time=5e-5)
    >>> [round(gain, 3) for gain in abs(filters.response([100.0, 4500.0, 5000.0])).tolist()]
    [1.0, 0.846, 0.01]
    >>> round(filters.step(1.0), 3)
    0.91
    """

    def __init__(self, parameters: FilterParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.parameters = parameters
        self._kinds: list[tuple[str, int]] = []
        self.chain: Array = np.zeros((1, _WIDTH))
        self._set(parameters, is_change=False)

    def update(self, parameters: FilterParameters) -> None:
        """Change the filters from the next step on; equal parameters change nothing."""
        if parameters != self.parameters:
            self._set(parameters, is_change=True)

    def _set(self, parameters: FilterParameters, *, is_change: bool) -> None:
        sections = filter_sections(parameters, self.sample_time)
        former = self.chain[1 : 1 + len(self._kinds)]
        chain = np.zeros((1 + len(sections) + len(former) * is_change, _WIDTH))
        chain[0] = self.chain[0]
        chain[0, _COUNT] = len(sections)
        # A new filter starts as if its input had been constant: the last output of the filter before it.
        entered = chain[0, _LAST]
        for row, (kind, coefficients) in enumerate(sections, 1):
            chain[row, :5] = coefficients
            if kind in self._kinds:
                chain[row, _HISTORY] = former[self._kinds.index(kind), _HISTORY]
            else:
                b0, b1, b2, a1, a2 = coefficients
                gain = (b0 + b1 + b2) / (1.0 + a1 + a2)
                chain[row, _HISTORY] = entered, entered, gain * entered, gain * entered
            entered = chain[row, 7]
        fade = math.floor(parameters.fade_time / self.sample_time + 0.5)
        if is_change and fade > 0:
            chain[0, _CHANGED], chain[0, _FORMER] = 1.0, len(former)
            chain[1 + len(sections) :] = former
            if chain[0, _LEFT] > 0.0:
                # The offset of a change that is still fading out goes on from its present size.
                chain[0, _OFFSET] *= chain[0, _LEFT] / chain[0, _FADE]
                chain[0, _LEFT] = fade
        else:
            chain[0, _LEFT] = 0.0
        chain[0, _FADE] = fade
        self.parameters, self.chain = parameters, chain
        self._kinds = [kind for kind, _ in sections]

    def hold(self, value: float) -> None:
        """Set the last input, for a chain without filters that was not called because it passes its input on."""
        self.chain[0, _LAST] = value

    @property
    def is_idle(self) -> bool:
        """Whether the chain passes its input on: no filters, and no change that is fading out."""
        return not self._kinds and not self.chain[0, [_CHANGED, _LEFT]].any()

    @property
    def sos(self) -> Array:
        """Second-order sections as of scipy.signal, shape (n, 6)."""
        sections = self.chain[1 : 1 + len(self._kinds)]
        return np.hstack([sections[:, _B], np.ones((len(sections), 1)), sections[:, _A]])

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response at ``frequencies`` [Hz]."""
        delay = np.exp(-1j * TWO_PI * np.asarray(frequencies, dtype=np.float64) * self.sample_time)
        found: NDArray[np.complex128] = np.ones_like(delay)
        for b0, b1, b2, _, a1, a2 in self.sos.tolist():
            found = found * (b0 + (b1 + b2 * delay) * delay) / (1.0 + (a1 + a2 * delay) * delay)
        return found

    def step(self, value: float) -> float:
        """Return the output for the next input."""
        return filters_step(self.chain, value)
