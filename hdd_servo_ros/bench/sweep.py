"""Plan of a swept sine: its frequencies, and duration in whole ticks and amplitude at each frequency."""

import dataclasses
import math
from collections.abc import Iterator

from hdd_servo_ros.bench.signal_analyzer_parameters import SignalAnalyzerParameters
from hdd_servo_ros.numerics.elementary import exp, log
from hdd_servo_ros.parameters import ParameterError

HIGHEST = 0.45
"""Highest frequency, relative to the sampling rate."""


@dataclasses.dataclass(frozen=True)
class Point:
    """
    One frequency of a sweep, in whole ticks: a record of ``length`` ticks contains ``cycles`` whole cycles.

    Attributes
    ----------
    cycles, length
        Cycles and ticks per record.
    settle
        Number of settling records, before the measurement.
    averages
        Number of measured records.
    amplitude
        Amplitude of the excitation [V].
    band
        Number of its frequency range.
    """

    cycles: int
    length: int
    settle: int
    averages: int
    amplitude: float
    band: int

    @property
    def ticks(self) -> int:
        """Duration of the point [ticks]."""
        return (self.settle + self.averages) * self.length


def plan(parameters: SignalAnalyzerParameters, sample_time: float) -> tuple[Point, ...]:
    """
    Return the points of a sweep.

    Each frequency is moved to the nearest one at which the whole cycles of a record take a whole number of ticks. The
    correlation over a record is then exact: neither the mean nor another harmonic leaks into it.

    Raises
    ------
    ParameterError
        If the highest frequency of the sweep is too high for the sample time [s].
    """
    p = parameters
    if p.stop_frequency * sample_time > HIGHEST:
        allowed = f'at most {HIGHEST / sample_time:g} Hz at sample_time = {sample_time!r} s'
        raise ParameterError('stop_frequency', p.stop_frequency, allowed)
    points: list[Point] = []
    for frequency, band in _wanted(p):
        cycles_measured = math.ceil(max(p.integrate_cycles, p.integrate_time * frequency) - 1e-9)
        averages = min(p.averages, cycles_measured)
        cycles = -(-cycles_measured // averages)
        length = math.floor(cycles / (frequency * sample_time) + 0.5)
        settle_time = max(p.settle_cycles / frequency, p.settle_time)
        settle = math.ceil(settle_time / (length * sample_time) - 1e-9)
        if points and cycles * points[-1].length <= points[-1].cycles * length:
            continue  # same number of whole ticks as the previous point
        points.append(Point(cycles, length, settle, averages, _of_range(p.amplitudes, band), band))
    return tuple(points)


def _wanted(parameters: SignalAnalyzerParameters) -> Iterator[tuple[float, int]]:
    """Yield the frequencies [Hz] and their ranges, from the first frequency to the last, both included."""
    first, last = log(parameters.start_frequency), log(parameters.stop_frequency)
    logarithm = first
    while True:
        # The margin against rounding makes a whole number of steps end at stop_frequency.
        if logarithm > last - 1e-9:
            logarithm = last
        frequency = exp(logarithm)
        yield frequency, sum(frequency > limit * (1.0 + 1e-9) for limit in parameters.range_limits)
        if logarithm == last:
            return
        above = sum(frequency >= limit * (1.0 - 1e-9) for limit in parameters.range_limits)
        logarithm += log(10.0) / _of_range(parameters.points_per_decade, above)


def _of_range(values: tuple[float, ...], band: int) -> float:
    return values[band if len(values) > 1 else 0]
