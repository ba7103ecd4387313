"""Parameters of the dynamic signal analyzer: its sweep, what it measures at each frequency, and its overload limit."""

import dataclasses
import itertools

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

LOWEST = 1e-3
"""Lowest frequency [Hz]."""
MOST_CYCLES = 1e6
"""Upper bound of what is waited for and measured at a frequency [cycles]."""
LONGEST_TIME = 1e5
"""The same [s]."""
MOST_AVERAGES = 64
"""Largest number of records into which a measurement is cut."""


@dataclasses.dataclass(frozen=True)
class SignalAnalyzerParameters(ParameterSet):
    """Parameters of :class:`SignalAnalyzer`; 100 mV at low and 50 mV to 1 V at high frequency, as in section 5.3."""

    start_frequency: float = parameter(10.0, 'first frequency of the sweep', unit='Hz', minimum=LOWEST, read_only=True)
    stop_frequency: float = parameter(
        4000.0, 'last frequency of the sweep; at most 0.45/T', unit='Hz', minimum=LOWEST, read_only=True
    )
    range_limits: tuple[float, ...] = parameter(
        (200.0, 1000.0, 4000.0),
        'upper ends of the ranges of frequency but the last, rising; empty for one range',
        unit='Hz',
        above=0.0,
        read_only=True,
    )
    points_per_decade: tuple[int, ...] = parameter(
        (40, 40, 40, 100),
        'frequencies in a decade, evenly spaced in its logarithm: one number for all ranges, or one for each',
        minimum=1,
        maximum=10000,
        read_only=True,
    )
    amplitudes: tuple[float, ...] = parameter(
        (0.1, 0.05, 0.3, 1.0),
        'amplitude of the sine: one number for all ranges, or one for each',
        unit='V',
        above=0.0,
        maximum=10.0,
        read_only=True,
    )
    settle_cycles: float = parameter(
        1.0,
        'cycles before each measurement that are not measured',
        unit='cycles',
        minimum=0.0,
        maximum=MOST_CYCLES,
        read_only=True,
    )
    settle_time: float = parameter(
        0.02,
        'time before each measurement that is not measured, at least',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_TIME,
        read_only=True,
    )
    integrate_cycles: float = parameter(
        3.0, 'cycles that are measured, at least', unit='cycles', minimum=2.0, maximum=MOST_CYCLES, read_only=True
    )
    integrate_time: float = parameter(
        0.02,
        'time that is measured at each frequency, at least',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_TIME,
        read_only=True,
    )
    averages: int = parameter(
        8,
        'number of records, of whole cycles each, into which a measurement is cut for the coherence; fewer where there '
        'are fewer cycles',
        minimum=2,
        maximum=MOST_AVERAGES,
        read_only=True,
    )
    velocity_from: float = parameter(
        400.0,
        "frequency from which the vibrometer's velocity output is read, over j 2 pi f, since it is the less noisy one "
        'there; 0 reads the displacement output throughout',
        unit='Hz',
        minimum=0.0,
        read_only=True,
    )
    overload_level: float = parameter(
        9.5,
        'magnitude of either output from which it counts as overloaded; below the range of the vibrometer and its '
        'converter',
        unit='V',
        above=0.0,
        read_only=True,
    )
    level_reductions: int = parameter(
        4,
        'how often the amplitude of a range is halved after an overload, which costs the point it happens in; one more '
        'overload ends the run',
        minimum=0,
        maximum=20,
        read_only=True,
    )
    plot: bool = parameter(True, 'whether to draw the response beside its CSV')

    def check_together(self) -> None:
        """Check the rules that tie several parameters together; raises :class:`ParameterError`."""
        if self.stop_frequency < self.start_frequency:
            raise ParameterError(
                'stop_frequency', self.stop_frequency, f'at least start_frequency = {self.start_frequency:g} [Hz]'
            )
        if any(left >= right for left, right in itertools.pairwise(self.range_limits)):
            raise ParameterError('range_limits', self.range_limits, 'rising [Hz]')
        ranges = len(self.range_limits) + 1
        for name in ('points_per_decade', 'amplitudes'):
            value = getattr(self, name)
            if len(value) not in (1, ranges):
                raise ParameterError(name, value, f'1 element, or {ranges} for the ranges that range_limits makes')
