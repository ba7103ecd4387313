"""The dynamic signal analyzer: an open-loop swept sine, one frequency at a time, and what it measures (HP 35670A)."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log, sine_cosine_of_turns
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

SignalAnalyzerArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

# Where the constants of signal_analyzer_step stand; the points follow, POINT_CONSTANTS each.
TIME_STEP, COUNT, LIMIT, REDUCTIONS, POINTS = range(5)
CYCLES, LENGTH, SETTLE, AVERAGES, AMPLITUDE, BAND, BY_VELOCITY = range(7)
POINT_CONSTANTS = 7

# Its state; behind it the records of the point, three numbers each, then the results, four numbers a point.
POINT, SEGMENT, PLACE, MEAN, REAL, IMAG, LEVEL, REDUCED, SPOILT, FAULT, FAULT_X, FAULT_V = range(12)
RECORDS = 12
MOST_AVERAGES = 64
RESULTS = RECORDS + 3 * MOST_AVERAGES
RESULT_NUMBERS = 4

ESTIMATE_NAMES = ('t', 'point', 'frequency', 'amplitude', 'real', 'imag', 'coherence')
T, AT_POINT, AT_FREQUENCY, AT_AMPLITUDE, LAST_REAL, LAST_IMAG, LAST_COHERENCE = range(7)

HIGHEST = 0.45
"""Highest frequency over the sampling rate."""
LOWEST = 1e-3
"""Lowest frequency [Hz]."""
MOST_CYCLES = 1e6
"""Upper bound of what is waited for and measured at a frequency [cycles]."""
LONGEST_TIME = 1e5
"""The same [s]."""


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


@dataclasses.dataclass(frozen=True)
class Point:
    """
    One frequency of a sweep, in whole ticks: records of ``length`` ticks hold ``cycles`` whole cycles.

    Attributes
    ----------
    cycles, length
        Of a record.
    settle
        Records that are not measured.
    averages
        Records that are.
    amplitude
        [V].
    band
        Number of its range of amplitudes.
    """

    cycles: int
    length: int
    settle: int
    averages: int
    amplitude: float
    band: int

    @property
    def ticks(self) -> int:
        """Ticks that the point takes."""
        return (self.settle + self.averages) * self.length


def plan(parameters: SignalAnalyzerParameters, sample_time: float) -> tuple[Point, ...]:
    """
    Return the points of a sweep.

    Each frequency is moved to the nearest at which so many whole cycles take whole ticks: the correlation over a record
    is then exact, and neither the mean nor another harmonic leaks into it.

    Raises
    ------
    ParameterError
        If the sweep goes too high for the sample time [s].
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
            continue  # the same whole ticks again
        points.append(Point(cycles, length, settle, averages, _of_range(p.amplitudes, band), band))
    return tuple(points)


def _wanted(parameters: SignalAnalyzerParameters) -> Iterator[tuple[float, int]]:
    """Iterate over the frequencies [Hz] and their ranges, from the first frequency to the last, both included."""
    first, last = log(parameters.start_frequency), log(parameters.stop_frequency)
    place = first
    while True:
        # Kept clear of rounding, so that a whole number of steps ends on stop_frequency.
        if place > last - 1e-9:
            place = last
        frequency = exp(place)
        yield frequency, sum(frequency > limit * (1.0 + 1e-9) for limit in parameters.range_limits)
        if place == last:
            return
        above = sum(frequency >= limit * (1.0 - 1e-9) for limit in parameters.range_limits)
        place += log(10.0) / _of_range(parameters.points_per_decade, above)


def _of_range(values: tuple[float, ...], band: int) -> float:
    return values[band if len(values) > 1 else 0]


@compiled
def signal_analyzer_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    *values: Any,
) -> tuple[float, float, float]:
    """Return (u, u, 0), the excitation of ``tick``; see :class:`SignalAnalyzer`."""
    inputs = ControllerInputs(*values)
    displacement_volts, velocity_volts = inputs.displacement_volts, inputs.velocity_volts
    estimates[T] = float(inputs.tick) * constants[TIME_STEP]
    # What has diverged must be seen to; the reference plays no part here.
    if not abs(displacement_volts) + abs(velocity_volts) < math.inf or state[FAULT] != 0.0:
        return math.nan, math.nan, math.nan
    point = int(state[POINT])
    if point >= int(constants[COUNT]):
        estimates[AT_AMPLITUDE] = 0.0
        return 0.0, 0.0, 0.0
    at = POINTS + POINT_CONSTANTS * point
    cycles = np.int64(constants[at + CYCLES])
    length = np.int64(constants[at + LENGTH])
    place = np.int64(state[PLACE])
    segment = int(state[SEGMENT])
    settle = int(constants[at + SETTLE])
    if place == 0 and segment == 0:
        state[SPOILT] = 0.0
        if point == 0 or constants[at + BAND] != constants[at + BAND - POINT_CONSTANTS]:
            state[LEVEL] = 1.0
            state[REDUCED] = 0.0
    limit = constants[LIMIT]
    if state[SPOILT] == 0.0 and (abs(displacement_volts) >= limit or abs(velocity_volts) >= limit):
        state[SPOILT] = 1.0
        state[FAULT_X] = displacement_volts
        state[FAULT_V] = velocity_volts
        if state[REDUCED] >= constants[REDUCTIONS]:
            state[FAULT] = 1.0
            return math.nan, math.nan, math.nan
        state[REDUCED] += 1.0
        state[LEVEL] *= 0.5
    # Half a tick ahead, the held cosine turns about the middle of each sample.
    turns = float((cycles * (2 * place + 1)) % (2 * length)) / float(2 * length)
    sine, cosine = sine_cosine_of_turns(turns)
    amplitude = constants[at + AMPLITUDE] * state[LEVEL]
    u = amplitude * cosine
    estimates[AT_POINT] = float(point)
    estimates[AT_FREQUENCY] = float(cycles) / (float(length) * constants[TIME_STEP])
    estimates[AT_AMPLITUDE] = amplitude
    if segment >= settle:
        y = inputs.velocity if constants[at + BY_VELOCITY] != 0.0 else inputs.position
        state[MEAN] += y
        state[REAL] += y * cosine
        state[IMAG] -= y * sine
    place += 1
    if place == length:
        place = np.int64(0)
        if segment >= settle:
            record = RECORDS + 3 * (segment - settle)
            for i in range(3):
                state[record + i] = state[MEAN + i] / float(length)
                state[MEAN + i] = 0.0
        segment += 1
        if segment == settle + int(constants[at + AVERAGES]):
            segment = 0
            _conclude(constants, state, estimates, point, amplitude)
            state[POINT] = float(point + 1)
        state[SEGMENT] = float(segment)
    state[PLACE] = float(place)
    return u, u, 0.0


@compiled
def _conclude(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    point: int,
    amplitude: float,
) -> None:
    """Turn the records of a point into its response and coherence."""
    at = POINTS + POINT_CONSTANTS * point
    averages = int(constants[at + AVERAGES])
    length = constants[at + LENGTH]
    # The trend of the records' means, over whole cycles each, is the drift; it adds i slope/sin to every correlation.
    middle = 0.5 * float(averages - 1)
    above = 0.0
    below = 0.0
    for k in range(averages):
        above += (float(k) - middle) * state[RECORDS + 3 * k]
        below += (float(k) - middle) * (float(k) - middle)
    half_turn, _ = sine_cosine_of_turns(0.5 * constants[at + CYCLES] / length)
    drift = above / (below * length) / half_turn
    real = 0.0
    imag = 0.0
    power = 0.0
    for k in range(averages):
        re = 2.0 * state[RECORDS + 3 * k + 1]
        im = 2.0 * state[RECORDS + 3 * k + 2] - drift
        real += re
        imag += im
        power += re * re + im * im
    real /= float(averages)
    imag /= float(averages)
    coherence = 0.0
    if power > 0.0:
        coherence = min((real * real + imag * imag) * float(averages) / power, 1.0)
    scale = 1.0 / amplitude
    if constants[at + BY_VELOCITY] != 0.0:
        w = TWO_PI * constants[at + CYCLES] / (length * constants[TIME_STEP])
        real, imag = imag / w, -real / w
    result = RESULTS + RESULT_NUMBERS * point
    state[result] = real * scale
    state[result + 1] = imag * scale
    state[result + 2] = coherence
    # No amplitude marks a point that an overload has spoilt.
    state[result + 3] = 0.0 if state[SPOILT] != 0.0 else amplitude
    if state[SPOILT] == 0.0:
        estimates[LAST_REAL] = state[result]
        estimates[LAST_IMAG] = state[result + 1]
        estimates[LAST_COHERENCE] = coherence


@compiled
def _replay(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    ldv: NDArray[np.float64],
    displacement_scale: float,
    velocity_scale: float,
    control: NDArray[np.float64],
) -> None:
    """Step through recorded outputs of the vibrometer, shape (n, 2 or more), and write the excitation, shape (n,)."""
    for tick in range(len(ldv)):
        x, v = ldv[tick, 0], ldv[tick, 1]
        # The fields of ControllerInputs, in their order: numba joins no named tuple to another.
        inputs = (tick, x * displacement_scale, v * velocity_scale, x, v, 0.0, 0.0, 0.0)
        control[tick] = signal_analyzer_step(constants, state, estimates, *inputs)[0]


class SignalAnalyzer:
    """
    A swept sine in a controller's place: u = A cos at one frequency after the other, and the response to it.

    At each frequency it waits, then correlates the vibrometer's output with the excitation over records of whole
    cycles. A linear drift of the head is found from the records' means and taken out. The excitation is a cosine that
    starts and ends with whole cycles, half a tick ahead: held over the samples it leaves a rigid body no net velocity,
    so that a drive without friction does not run away between the points. The coherence is that of the records.

    An output of the vibrometer beyond ``overload_level`` spoils the point: its amplitude and that of the points behind
    it in the same range of amplitudes are halved. After ``level_reductions`` such halvings u is not a number, which
    ends the run, and :meth:`fault` says why.

    Parameters
    ----------
    parameters
        The sweep.
    sample_time
        T [s].

    Attributes
    ----------
    points
        The sweep in whole ticks.
    last_tick
        The last tick of the sweep; the excitation is 0 behind it.

    Raises
    ------
    ParameterError
        If the sweep goes too high for the sample time.
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: SignalAnalyzerParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.update(parameters)

    def update(self, parameters: SignalAnalyzerParameters) -> None:
        """Take other parameters and begin the sweep anew: half of one sweep and half of another mean nothing."""
        self.parameters = parameters
        self.points = plan(parameters, self.sample_time)
        self.last_tick = sum(point.ticks for point in self.points) - 1
        count = len(self.points)
        constants = np.zeros(POINTS + POINT_CONSTANTS * count)
        constants[:POINTS] = self.sample_time, count, parameters.overload_level, parameters.level_reductions
        for i, point in enumerate(self.points):
            by_velocity = self._by_velocity(point)
            constants[POINTS + POINT_CONSTANTS * i :][:POINT_CONSTANTS] = (
                point.cycles,
                point.length,
                point.settle,
                point.averages,
                point.amplitude,
                point.band,
                by_velocity,
            )
        self.constants: NDArray[np.float64] = constants
        self.state: NDArray[np.float64] = np.zeros(RESULTS + RESULT_NUMBERS * count)
        self.estimates: NDArray[np.float64] = np.zeros(len(ESTIMATE_NAMES))

    def _frequency(self, point: Point) -> float:
        return point.cycles / (point.length * self.sample_time)

    def _by_velocity(self, point: Point) -> bool:
        return 0.0 < self.parameters.velocity_from <= self._frequency(point)

    @property
    def arrays(self) -> SignalAnalyzerArrays:
        """The arrays that the kernel takes first: constants, state, estimates."""
        return self.constants, self.state, self.estimates

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u again, and 0 for its feedback part [V]; the reference plays no part."""
        return signal_analyzer_step(*self.arrays, *inputs)

    def replay(self, ldv: NDArray[np.float64], displacement_scale: float, velocity_scale: float) -> NDArray[np.float64]:
        """
        Measure from recorded outputs of the vibrometer.

        Parameters
        ----------
        ldv
            Displacement and velocity output at every tick from 0 on [V], shape (n, 2 or more).
        displacement_scale, velocity_scale
            The vibrometer's scales [um/V], [um/s/V].

        Returns
        -------
        ndarray
            The excitation at these ticks [V], shape (n,).
        """
        control: NDArray[np.float64] = np.empty(len(ldv))
        _replay(*self.arrays, ldv, displacement_scale, velocity_scale, control)
        return control

    def fault(self) -> str:
        """Return why the sweep cannot go on, empty while it can."""
        if self.state[FAULT] == 0.0:
            return ''
        point = self.points[int(self.state[POINT])]
        return (
            f'signal_analyzer: the vibrometer reads {self.state[FAULT_X]:.4g} V of displacement and '
            f'{self.state[FAULT_V]:.4g} V of velocity at {self._frequency(point):.5g} Hz with '
            f'{point.amplitude * self.state[LEVEL]:.4g} V, after {int(self.state[REDUCED])} halvings: beyond parameter '
            f'overload_level = {self.parameters.overload_level:g} V; lower amplitudes, or keep the head from drifting'
        )

    def spoilt(self) -> tuple[float, ...]:
        """Return the frequencies whose points an overload has spoilt, so far [Hz]."""
        done = int(self.state[POINT])
        amplitudes = self.state[RESULTS + 3 :: RESULT_NUMBERS][:done]
        return tuple(
            self._frequency(point)
            for point, amplitude in zip(self.points, amplitudes, strict=False)
            if amplitude == 0.0
        )

    def response(self) -> FrequencyResponse:
        """Return what has been measured so far: every point that is complete and not spoilt."""
        done = int(self.state[POINT])
        results = self.state[RESULTS:].reshape(-1, RESULT_NUMBERS)[:done]
        good = results[:, 3] > 0.0
        points = [point for point, wanted in zip(self.points, good, strict=False) if wanted]
        results = results[good]
        return FrequencyResponse(
            frequency=np.array([self._frequency(point) for point in points]),
            response=results[:, 0] + 1j * results[:, 1],
            coherence=results[:, 2].copy(),
            amplitude=results[:, 3].copy(),
            averages=np.array([point.averages for point in points], dtype=np.int64),
            by_velocity=np.array([self._by_velocity(point) for point in points], dtype=np.bool_),
            hold=self.sample_time,
        )
