"""Parameters of the dynamic signal analyzer: sweep, measurement at each frequency, and overload limit."""

import dataclasses
import itertools

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

LOWEST = 1e-3
"""Lowest frequency [Hz]."""
MOST_CYCLES = 1e6
"""Upper bound of the settling and of the measured cycles at a frequency."""
LONGEST_TIME = 1e5
"""Upper bound of the settling and of the measuring time at a frequency [s]."""
MOST_AVERAGES = 64
"""Largest number of records per measurement."""


@dataclasses.dataclass(frozen=True)
class SignalAnalyzerParameters(ParameterSet):
    """Parameters of :class:`SignalAnalyzer`; 100 mV at low and 50 mV to 1 V at high frequency (thesis section 5.3)."""

    start_frequency: float = parameter(10.0, 'first frequency of the sweep', unit='Hz', minimum=LOWEST, read_only=True)
    stop_frequency: float = parameter(
        4000.0, 'last frequency of the sweep, at most 0.45/T', unit='Hz', minimum=LOWEST, read_only=True
    )
    range_limits: tuple[float, ...] = parameter(
        (200.0, 1000.0, 4000.0),
        'upper limits of all frequency ranges except the last, in rising order; an empty list for one range',
        unit='Hz',
        above=0.0,
        read_only=True,
    )
    points_per_decade: tuple[int, ...] = parameter(
        (40, 40, 40, 100),
        'frequencies per decade, logarithmically spaced: one element for all ranges, or one element per range',
        minimum=1,
        maximum=10000,
        read_only=True,
    )
    amplitudes: tuple[float, ...] = parameter(
        (0.1, 0.05, 0.3, 1.0),
        'amplitude of the sine: one element for all ranges, or one element per range',
        unit='V',
        above=0.0,
        maximum=10.0,
        read_only=True,
    )
    settle_cycles: float = parameter(
        1.0,
        'minimum number of settling cycles before each measurement',
        unit='cycles',
        minimum=0.0,
        maximum=MOST_CYCLES,
        read_only=True,
    )
    settle_time: float = parameter(
        0.02,
        'minimum settling time before each measurement',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_TIME,
        read_only=True,
    )
    integrate_cycles: float = parameter(
        3.0,
        'minimum number of measured cycles at each frequency',
        unit='cycles',
        minimum=2.0,
        maximum=MOST_CYCLES,
        read_only=True,
    )
    integrate_time: float = parameter(
        0.02,
        'minimum measuring time at each frequency',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_TIME,
        read_only=True,
    )
    averages: int = parameter(
        8,
        'number of records per measurement for the coherence, each of whole cycles; fewer if there are fewer cycles',
        minimum=2,
        maximum=MOST_AVERAGES,
        read_only=True,
    )
    velocity_from: float = parameter(
        400.0,
        'lowest frequency at which the velocity output (divided by j 2 pi f) is used, because it is less noisy there; '
        '0 uses the displacement output at all frequencies',
        unit='Hz',
        minimum=0.0,
        read_only=True,
    )
    overload_level: float = parameter(
        9.5,
        'overload level of both outputs; choose it below the range of the vibrometer and its ADC',
        unit='V',
        above=0.0,
        read_only=True,
    )
    level_reductions: int = parameter(
        4,
        'maximum number of amplitude halvings per range; each overload discards its point and halves the amplitude, '
        'one more overload ends the run',
        minimum=0,
        maximum=20,
        read_only=True,
    )
    plot: bool = parameter(True, 'write a plot of the response in addition to the CSV file')

    def check_together(self) -> None:
        """Check the combinations of parameters; raise :class:`ParameterError` if one is invalid."""
        if self.stop_frequency < self.start_frequency:
            raise ParameterError(
                'stop_frequency', self.stop_frequency, f'at least start_frequency = {self.start_frequency:g} [Hz]'
            )
        if any(left >= right for left, right in itertools.pairwise(self.range_limits)):
            raise ParameterError('range_limits', self.range_limits, 'a list in rising order [Hz]')
        ranges = len(self.range_limits) + 1
        for name in ('points_per_decade', 'amplitudes'):
            value = getattr(self, name)
            if len(value) not in (1, ranges):
                raise ParameterError(name, value, f'1 element, or {ranges} elements, one per range of range_limits')
