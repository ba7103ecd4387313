"""The analyzer against scipy's discrete systems, whose output it measures, and against numpy's sums."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer, SignalAnalyzerParameters
from hdd_servo_ros.bench.sweep import plan
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError

T = 2e-5
SCALES = SensorScales(8.0, 5000.0)
SHORT = SignalAnalyzerParameters(
    start_frequency=200.0,
    stop_frequency=15_000.0,
    range_limits=(2000.0,),
    points_per_decade=(6,),
    amplitudes=(0.1, 0.5),
    settle_time=0.01,
    integrate_time=0.01,
    velocity_from=1000.0,
)
# A rigid body on a spring, its position and velocity as a sampled system: um and um/s per V.
SPRING = (
    np.array([[0.0, 1.0], [-((2.0 * np.pi * 900.0) ** 2), -1200.0]]),
    np.array([[0.0], [4e7]]),
    np.eye(2),
    np.zeros((2, 1)),
)
DISCRETE = signal.cont2discrete(SPRING, T)


def frequencies(analyzer):
    return np.array([point.cycles / (point.length * T) for point in analyzer.points])


def excitation(parameters=SHORT):
    analyzer = SignalAnalyzer(parameters, T)
    return analyzer.replay(np.zeros((analyzer.last_tick + 1, 2)), *SCALES)


def outputs(control):
    """The vibrometer's outputs [V]: at each tick what the voltages before have brought about."""
    _, states, _ = signal.dlsim(DISCRETE, control)
    return states[: len(control)] / SCALES


def sampled(frequency):
    z = np.exp(2j * np.pi * frequency * T)
    a, b = DISCRETE[0], DISCRETE[1]
    return np.array([np.linalg.solve(point * np.eye(2) - a, b)[:, 0] for point in z]).T


def measured(ldv, parameters=SHORT):
    analyzer = SignalAnalyzer(parameters, T)
    control = analyzer.replay(ldv, *SCALES)
    return analyzer, control


def test_the_response_is_that_of_the_sampled_system():
    """Position below velocity_from, velocity over j w above; the tolerance covers the remaining transients."""
    control = excitation()
    analyzer, again = measured(outputs(control))
    np.testing.assert_array_equal(again, control)
    found = analyzer.response()
    np.testing.assert_array_equal(found.frequency, frequencies(analyzer))
    position, velocity = sampled(found.frequency)
    expected = np.where(found.frequency < 1000.0, position, velocity / (2j * np.pi * found.frequency))
    np.testing.assert_allclose(found.response, expected, rtol=2e-3)
    np.testing.assert_array_equal(found.by_velocity, found.frequency >= 1000.0)
    np.testing.assert_array_equal(found.amplitude, np.where(found.frequency > 2000.0, 0.5, 0.1))
    assert found.coherence.min() > 0.9999
    assert found.hold == T


def test_each_point_is_the_sum_over_its_whole_cycles():
    """The last point again, by numpy's sums over the recorded voltages."""
    control = excitation()
    ldv = outputs(control)
    analyzer, _ = measured(ldv)
    point = analyzer.points[-1]
    window = slice(len(control) - point.averages * point.length, len(control))
    phase = np.exp(-2j * np.pi * analyzer.response().frequency[-1] * T * np.arange(len(control)))[window]
    velocity = ldv[window, 1] - np.polyval(np.polyfit(np.arange(point.averages * point.length), ldv[window, 1], 1), 0)
    ratio = np.dot(velocity, phase) / np.dot(control[window], phase)
    expected = SCALES.velocity * ratio / (2j * np.pi * analyzer.response().frequency[-1])
    assert analyzer.response().response[-1] == pytest.approx(expected, rel=1e-4)


def test_a_drift_is_taken_out():
    control = excitation()
    ldv = outputs(control)
    still, _ = measured(ldv)
    time = T * np.arange(len(ldv))[:, None]
    drifting, _ = measured(ldv + [0.5, -0.2] + time * [1.5, 0.8])
    np.testing.assert_allclose(drifting.response().response, still.response().response, rtol=1e-9)


def test_the_excitation_leaves_a_free_body_where_it_was():
    """Over each point the held cosine has no mean, and its integral, the velocity, has none either."""
    control = excitation()
    velocity = np.cumsum(control)
    ends = np.cumsum([point.ticks for point in SignalAnalyzer(SHORT, T).points])
    for start, end in itertools.pairwise([0, *ends]):
        amplitude = np.abs(control[start:end]).max()
        assert abs(control[start:end].sum()) < 1e-9 * amplitude * (end - start)
        # trapezoids: the velocity runs straight while the voltage is held
        steps = velocity[start:end] - 0.5 * control[start:end]
        assert abs(steps.sum()) < 1e-9 * amplitude * (end - start) ** 2


def test_the_coherence_predicts_the_spread():
    control = excitation()
    ldv = outputs(control)
    rng = np.random.default_rng(5)
    quiet, _ = measured(ldv)
    scores = []
    for _ in range(20):
        noisy, _ = measured(ldv + rng.normal(size=ldv.shape) * [5e-3, 2e-2])
        found = noisy.response()
        scores.append(np.abs(found.response / quiet.response().response - 1.0) / found.relative_deviation())
    assert 0.8 < np.sqrt(np.median(np.square(scores)) / math.log(2.0)) < 1.25
    assert noisy.response().coherence.min() < 0.995


def test_step_and_replay_are_the_same_to_the_bit():
    control = excitation()
    ldv = outputs(control)
    replayed, _ = measured(ldv)
    stepped = SignalAnalyzer(SHORT, T)
    for tick, (x, v) in enumerate(ldv.tolist()):
        assert stepped.step(SCALES.inputs(tick, x, v, 9.0, 9.0, 9.0)) == (control[tick], control[tick], 0.0)
    assert [array.tobytes() for array in stepped.arrays[:-1]] == [array.tobytes() for array in replayed.arrays[:-1]]
    assert stepped.step(SCALES.inputs(len(ldv), 0.0, 0.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    names = dict(zip(stepped.estimate_names, stepped.estimates.tolist(), strict=True))
    last = stepped.response()
    assert names['t'] == len(ldv) * T
    assert names['amplitude'] == 0.0
    assert complex(names['real'], names['imag']) == last.response[-1]
    assert names['coherence'] == last.coherence[-1]
    assert names['frequency'] == last.frequency[-1]


def overloaded(ticks, parameters=SHORT):
    analyzer = SignalAnalyzer(parameters, T)
    ldv = np.zeros((analyzer.last_tick + 1, 2))
    ldv[ticks, 0] = -9.6
    return analyzer, analyzer.replay(ldv, *SCALES)


def test_an_overload_halves_the_amplitude_and_costs_the_point():
    plain = excitation()
    points = SignalAnalyzer(SHORT, T).points
    first = points[0].ticks
    analyzer, control = overloaded([first + 10, first + 11, first + 500])
    np.testing.assert_array_equal(control[: first + 10], plain[: first + 10])
    ends = np.cumsum([point.ticks for point in points])
    second_range = ends[sum(point.band == 0 for point in points) - 1]
    np.testing.assert_array_equal(control[first + 10 : second_range], 0.5 * plain[first + 10 : second_range])
    np.testing.assert_array_equal(control[second_range:], plain[second_range:])
    assert analyzer.overloaded_frequencies() == (frequencies(analyzer)[1],)
    np.testing.assert_array_equal(analyzer.response().frequency, np.delete(frequencies(analyzer), 1))
    assert analyzer.response().amplitude[1] == 0.05
    assert analyzer.fault() == ''


def test_too_many_overloads_end_the_run_with_a_reason():
    parameters = SignalAnalyzerParameters(**{**vars(SHORT), 'level_reductions': 1})
    first = SignalAnalyzer(SHORT, T).points[0].ticks
    analyzer, control = overloaded([5, first + 7], parameters)
    assert np.isfinite(control[: first + 7]).all()
    assert np.isnan(control[first + 7 :]).all()
    assert 'displacement output -9.6 V' in analyzer.fault()
    assert 'with 0.05 V, after 1 halvings' in analyzer.fault()
    assert 'overload_level = 9.5 V' in analyzer.fault()
    assert len(analyzer.response().frequency) == 0


def test_non_finite_values_are_not_hidden():
    analyzer = SignalAnalyzer(SHORT, T)
    for inputs in ((math.nan, 0.0), (0.0, math.inf)):
        assert math.isnan(analyzer.step(SCALES.inputs(0, *inputs, 0.0, 0.0, 0.0))[0])
    assert analyzer.fault() == ''


@settings(max_examples=60)
@given(
    st.floats(1.0, 3000.0),
    st.floats(1.0, 20.0),
    st.integers(1, 50),
    st.sampled_from([1e-5, 2e-5, 5e-5, 1e-4]),
    st.integers(2, 20),
)
def test_any_plan_is_of_whole_ticks_and_rises(start, ratio, points_per_decade, sample_time, averages):
    stop = min(start * ratio, 0.45 / sample_time)
    parameters = SignalAnalyzerParameters(
        start_frequency=start, stop_frequency=stop, points_per_decade=(points_per_decade,), averages=averages
    )
    points = plan(parameters, sample_time)
    found = np.array([point.cycles / (point.length * sample_time) for point in points])
    assert np.all(np.diff(found) > 0.0)
    # Half a tick in a record is the rounding.
    for frequency, point in zip(found, points, strict=True):
        rounding = 0.5 / point.length * (1.0 + 1e-6)
        assert start * (1.0 - rounding) <= frequency <= stop * (1.0 + rounding)
        measured_time = point.averages * point.length * sample_time
        assert measured_time >= max(3.0 / frequency, 0.02) * (1.0 - 2.0 * rounding)
        assert point.settle * point.length * sample_time >= max(1.0 / frequency, 0.02) * (1.0 - 2.0 * rounding)
        assert 2 <= point.averages <= averages
    assert len(points) <= 2 + points_per_decade * math.log10(stop / start)
    assert len(points) >= 0.5 * points_per_decade * math.log10(stop / start)


def test_each_range_has_its_density():
    points = plan(
        SignalAnalyzerParameters(
            start_frequency=100.0, stop_frequency=10_000.0, range_limits=(1000.0,), points_per_decade=(10, 30),
            amplitudes=(0.1,),
        ),
        T,
    )  # fmt: skip
    assert [point.band for point in points] == [0] * 11 + [1] * 30
    assert {point.amplitude for point in points} == {0.1}


@pytest.mark.parametrize(
    ('changed', 'message'),
    [
        ({'stop_frequency': 5.0}, 'stop_frequency: 5.0; expected at least start_frequency'),
        ({'range_limits': (2000.0, 1000.0)}, 'range_limits: (2000.0, 1000.0); expected a list in rising order'),
        ({'amplitudes': (0.1, 0.2, 0.3)}, 'amplitudes: (0.1, 0.2, 0.3); expected 1 element, or 2'),
        ({'start_frequency': 0.0}, 'start_frequency: 0.0; expected a finite number at least 0.001 [Hz]'),
        ({'settle_time': 1e300}, 'settle_time: 1e+300;'),
        ({'integrate_cycles': 1e300}, 'integrate_cycles: 1e+300;'),
        ({'points_per_decade': ()}, 'points_per_decade: (); expected 1 element, or 2'),
    ],
)
def test_bad_parameters_are_rejected_by_name(changed, message):
    with pytest.raises(ParameterError) as rejected:
        SignalAnalyzerParameters(**{**vars(SHORT), **changed})
    assert message in str(rejected.value)


def test_a_sweep_too_high_for_the_sample_time_is_rejected():
    with pytest.raises(ParameterError) as rejected:
        SignalAnalyzer(SHORT, 1e-4)
    assert 'stop_frequency: 15000.0; expected at most 4500 Hz at sample_time = 0.0001 s' in str(rejected.value)
