"""Dynamic signal analyzer (modeled on the HP 35670A): open-loop swept sine, one frequency at a time."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.bench.signal_analyzer_parameters import MOST_AVERAGES
from hdd_servo_ros.bench.signal_analyzer_parameters import SignalAnalyzerParameters as SignalAnalyzerParameters
from hdd_servo_ros.bench.sweep import Point, plan
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, zeros

SignalAnalyzerArrays = tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
]


# Constants, and the points (one row per point).
CONSTANTS = layout('time_step', 'overload_level', 'level_reductions')
POINT = layout('cycles', 'length', 'settle', 'averages', 'amplitude', 'band', 'by_velocity')

# Mean of an output over a record of whole cycles, and its correlation with the excitation; in the state, running sums.
CORRELATION = layout('mean_output', 'in_phase', 'quadrature')

# Current point, record of the point, tick of the record; amplitude reduction; outputs at an overload.
STATE = layout(
    'point',
    'segment',
    'tick',
    ('sums', CORRELATION),
    'level',
    'reductions',
    'overloaded',
    'fault',
    'fault_displacement',
    'fault_velocity',
)

# Result of each point (one row per point); amplitude 0 if the point was discarded because of an overload.
RESULT = layout('response_real', 'response_imag', 'coherence', 'amplitude')

ESTIMATE_NAMES = ('t', 'point', 'frequency', 'amplitude', 'real', 'imag', 'coherence')
ESTIMATES = layout(*ESTIMATE_NAMES)


@compiled
def signal_analyzer_step(
    constants: NDArray[np.float64],
    points: NDArray[np.float64],
    state: NDArray[np.float64],
    correlations: NDArray[np.float64],
    results: NDArray[np.float64],
    estimates: NDArray[np.float64],
    *values: Any,
) -> tuple[float, float, float]:
    """
    Return (u, u, 0), where u is the excitation at a tick; see :class:`SignalAnalyzer`.

    Parameters
    ----------
    constants, state, estimates
        Arrays with the layouts ``CONSTANTS``, ``STATE`` and ``ESTIMATES``.
    points
        ``POINT`` of each frequency, shape (n, 7).
    correlations
        ``CORRELATION`` of each measured record of the current point, shape (64, 3).
    results
        ``RESULT`` of each frequency, shape (n, 4).
    *values
        Fields of :class:`ControllerInputs`.
    """
    c, s, found = record(constants, CONSTANTS), record(state, STATE), record(estimates, ESTIMATES)
    inputs = ControllerInputs(*values)
    displacement_volts, velocity_volts = inputs.displacement_volts, inputs.velocity_volts
    found.t = float(inputs.tick) * c.time_step
    # A diverged output must end the run; the reference is not used.
    if not abs(displacement_volts) + abs(velocity_volts) < math.inf or s.fault != 0.0:
        return math.nan, math.nan, math.nan
    index = int(s.point)
    if index >= len(points):
        found.amplitude = 0.0
        return 0.0, 0.0, 0.0
    point = record(points, POINT, index)
    cycles = np.int64(point.cycles)
    length = np.int64(point.length)
    settle = int(point.settle)
    tick = np.int64(s.tick)
    segment = int(s.segment)
    if tick == 0 and segment == 0:
        s.overloaded = 0.0
        if index == 0 or point.band != record(points, POINT, index - 1).band:
            s.level = 1.0
            s.reductions = 0.0
    limit = c.overload_level
    if s.overloaded == 0.0 and (abs(displacement_volts) >= limit or abs(velocity_volts) >= limit):
        s.overloaded = 1.0
        s.fault_displacement = displacement_volts
        s.fault_velocity = velocity_volts
        if s.reductions >= c.level_reductions:
            s.fault = 1.0
            return math.nan, math.nan, math.nan
        s.reductions += 1.0
        s.level *= 0.5
    # With a lead of half a tick, the held cosine has its nominal phase at the middle of each sample.
    turns = float((cycles * (2 * tick + 1)) % (2 * length)) / float(2 * length)
    sine, cosine = sine_cosine_of_turns(turns)
    amplitude = point.amplitude * s.level
    u = amplitude * cosine
    found.point = float(index)
    found.frequency = float(cycles) / (float(length) * c.time_step)
    found.amplitude = amplitude
    sums = s.sums
    if segment >= settle:
        y = inputs.velocity if point.by_velocity != 0.0 else inputs.position
        sums.mean_output += y
        sums.in_phase += y * cosine
        sums.quadrature -= y * sine
    tick += 1
    if tick == length:
        tick = np.int64(0)
        if segment >= settle:
            measured = record(correlations, CORRELATION, segment - settle)
            measured.mean_output = sums.mean_output / float(length)
            measured.in_phase = sums.in_phase / float(length)
            measured.quadrature = sums.quadrature / float(length)
            sums.mean_output = 0.0
            sums.in_phase = 0.0
            sums.quadrature = 0.0
        segment += 1
        if segment == settle + int(point.averages):
            segment = 0
            result = record(results, RESULT, index)
            _conclude(c.time_step, point, correlations, amplitude, result)
            if s.overloaded != 0.0:
                result.amplitude = 0.0
            else:
                found.real = result.response_real
                found.imag = result.response_imag
                found.coherence = result.coherence
            s.point = float(index + 1)
        s.segment = float(segment)
    s.tick = float(tick)
    return u, u, 0.0


@compiled
def _conclude(time_step: float, point: Any, correlations: NDArray[np.float64], amplitude: float, result: Any) -> None:
    """Compute response and coherence of a point from its records, and write them to its result."""
    averages = int(point.averages)
    # The trend of the record means is the drift; it adds i slope/sin to every correlation.
    middle = 0.5 * float(averages - 1)
    above = 0.0
    below = 0.0
    for k in range(averages):
        above += (float(k) - middle) * record(correlations, CORRELATION, k).mean_output
        below += (float(k) - middle) * (float(k) - middle)
    half_turn, _ = sine_cosine_of_turns(0.5 * point.cycles / point.length)
    drift = above / (below * point.length) / half_turn
    real = 0.0
    imag = 0.0
    power = 0.0
    for k in range(averages):
        measured = record(correlations, CORRELATION, k)
        re = 2.0 * measured.in_phase
        im = 2.0 * measured.quadrature - drift
        real += re
        imag += im
        power += re * re + im * im
    real /= float(averages)
    imag /= float(averages)
    coherence = 0.0
    if power > 0.0:
        coherence = min((real * real + imag * imag) * float(averages) / power, 1.0)
    scale = 1.0 / amplitude
    if point.by_velocity != 0.0:
        w = TWO_PI * point.cycles / (point.length * time_step)
        real, imag = imag / w, -real / w
    result.response_real = real * scale
    result.response_imag = imag * scale
    result.coherence = coherence
    result.amplitude = amplitude


@compiled
def _replay(
    constants: NDArray[np.float64],
    points: NDArray[np.float64],
    state: NDArray[np.float64],
    correlations: NDArray[np.float64],
    results: NDArray[np.float64],
    estimates: NDArray[np.float64],
    ldv: NDArray[np.float64],
    displacement_scale: float,
    velocity_scale: float,
    first_tick: int,
    control: NDArray[np.float64],
) -> None:
    """Step through recorded vibrometer outputs, shape (n, 2 or more), and write the excitation, shape (n,)."""
    for tick in range(len(ldv)):
        x, v = ldv[tick, 0], ldv[tick, 1]
        # The fields of ControllerInputs, in order: numba cannot concatenate named tuples.
        inputs = (first_tick + tick, x * displacement_scale, v * velocity_scale, x, v, 0.0, 0.0, 0.0)
        control[tick] = signal_analyzer_step(constants, points, state, correlations, results, estimates, *inputs)[0]


class SignalAnalyzer:
    """
    Swept-sine analyzer used instead of a controller: excites one frequency after another and measures the response.

    At each frequency the analyzer first lets the response settle. It then correlates the vibrometer output with the
    excitation over records of whole cycles. A linear drift of the head is estimated from the record means and removed.
    The excitation is a cosine that starts and ends with whole cycles, with a lead of half a tick. Held over the
    samples, it leaves no net velocity on a rigid body, so a drive without friction does not drift away between the
    points. The coherence is computed over the records.

    If a vibrometer output exceeds ``overload_level``, the point is discarded, and the amplitude is halved for this
    point and the remaining points of the same range. After ``level_reductions`` halvings, another overload sets u to
    NaN, which ends the run; :meth:`fault` returns the reason.

    Parameters
    ----------
    parameters
        Parameters of the sweep.
    sample_time
        T [s].

    Attributes
    ----------
    points
        Points of the sweep, in whole ticks.
    last_tick
        Last tick of the sweep; the excitation is 0 after it.

    Raises
    ------
    ParameterError
        If the highest frequency of the sweep is too high for the sample time.

    Notes
    -----
    Source: thesis section 5.3.

    Examples
    --------
    >>> from hdd_servo_ros.bench import SignalAnalyzer, SignalAnalyzerParameters
    >>> analyzer = SignalAnalyzer(SignalAnalyzerParameters(start_frequency=400.0, stop_frequency=3000.0), 1e-4)
    >>> len(analyzer.points), analyzer.last_tick  # points of the sweep, its last tick
    (36, 16548)
    >>> analyzer.points[0].length  # ticks of a record at the first frequency
    25
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: SignalAnalyzerParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.update(parameters)

    def update(self, parameters: SignalAnalyzerParameters) -> None:
        """Change the parameters and restart the sweep, because two partial sweeps cannot be combined."""
        self.parameters = parameters
        self.points = plan(parameters, self.sample_time)
        self.last_tick = sum(point.ticks for point in self.points) - 1
        self.constants = zeros(CONSTANTS)
        c = record(self.constants, CONSTANTS)
        c.time_step = self.sample_time
        c.overload_level = parameters.overload_level
        c.level_reductions = parameters.level_reductions
        self._point_rows = np.tile(zeros(POINT), (len(self.points), 1))
        for row, point in enumerate(self.points):
            p = record(self._point_rows, POINT, row)
            p.cycles, p.length = point.cycles, point.length
            p.settle, p.averages = point.settle, point.averages
            p.amplitude, p.band = point.amplitude, point.band
            p.by_velocity = self._by_velocity(point)
        self.state = zeros(STATE)
        self._correlations = np.tile(zeros(CORRELATION), (MOST_AVERAGES, 1))
        self._results = np.tile(zeros(RESULT), (len(self.points), 1))
        self.estimates = zeros(ESTIMATES)

    def _frequency(self, point: Point) -> float:
        return point.cycles / (point.length * self.sample_time)

    def _by_velocity(self, point: Point) -> bool:
        return 0.0 < self.parameters.velocity_from <= self._frequency(point)

    @property
    def arrays(self) -> SignalAnalyzerArrays:
        """First arguments of the kernel; the estimates are the last array."""
        return self.constants, self._point_rows, self.state, self._correlations, self._results, self.estimates

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before saturation (the same) and 0 as the feedback part [V]; the reference is not used."""
        return signal_analyzer_step(*self.arrays, *inputs)

    def replay(
        self, ldv: NDArray[np.float64], displacement_scale: float, velocity_scale: float, first_tick: int = 0
    ) -> NDArray[np.float64]:
        """
        Measure from recorded vibrometer outputs.

        Parameters
        ----------
        ldv
            Displacement and velocity output at every tick from ``first_tick`` on [V], shape (n, 2 or more).
        displacement_scale, velocity_scale
            Scales of the vibrometer [um/V], [um/s/V].
        first_tick
            First tick: 0, or the tick after the last one processed.

        Returns
        -------
        ndarray
            Excitation at these ticks [V], shape (n,).
        """
        control: NDArray[np.float64] = np.empty(len(ldv))
        _replay(*self.arrays, ldv, displacement_scale, velocity_scale, first_tick, control)
        return control

    def fault(self) -> str:
        """Return the reason why the sweep cannot continue, or an empty string."""
        s = record(self.state, STATE)
        if s.fault == 0.0:
            return ''
        point = self.points[int(s.point)]
        return (
            f'signal_analyzer: vibrometer overload at {self._frequency(point):.5g} Hz with '
            f'{point.amplitude * s.level:.4g} V, after {int(s.reductions)} halvings: displacement output '
            f'{s.fault_displacement:.4g} V, velocity output {s.fault_velocity:.4g} V, parameter overload_level = '
            f'{self.parameters.overload_level:g} V; lower amplitudes, or keep the head from drifting'
        )

    def _complete(self) -> tuple[tuple[Point, ...], NDArray[np.void]]:
        """Return the completed points, and their ``RESULT``, shape (n,)."""
        done = int(record(self.state, STATE).point)
        return self.points[:done], self._results.view(RESULT)[:done, 0]

    def overloaded_frequencies(self) -> tuple[float, ...]:
        """Return the frequencies [Hz] discarded so far because of an overload."""
        points, results = self._complete()
        discarded = results['amplitude'] == 0.0
        return tuple(self._frequency(point) for point, gone in zip(points, discarded, strict=True) if gone)

    def response(self) -> FrequencyResponse:
        """Return the response measured so far: all completed points that were not discarded."""
        complete, results = self._complete()
        kept = results['amplitude'] > 0.0
        points = [point for point, keep in zip(complete, kept, strict=True) if keep]
        results = results[kept]
        return FrequencyResponse(
            frequency=np.array([self._frequency(point) for point in points]),
            response=results['response_real'] + 1j * results['response_imag'],
            coherence=results['coherence'].copy(),
            amplitude=results['amplitude'].copy(),
            averages=np.array([point.averages for point in points], dtype=np.int64),
            by_velocity=np.array([self._by_velocity(point) for point in points], dtype=np.bool_),
            hold=self.sample_time,
        )
