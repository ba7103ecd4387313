"""The period of the reference of a run."""

import math
from fractions import Fraction
from typing import Any

from hdd_servo_ros.analysis.period import repeat, sine_period
from hdd_servo_ros.messages.topics import HEAD, REFERENCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import REFERENCE_GENERATOR, SIGNAL_ANALYZER, steady_start
from hdd_servo_ros.reporting.long_runs import stretch_of


def reference_period(run: RecordedRun) -> float | None:
    """
    Return the period of the reference at the end of the run [samples]; None if it is not periodic or unknown.

    It is read from the parameters of the reference. Without ``run.yaml``, or with an external reference, it is
    estimated from `/reference` after the transient.
    """
    if run.controller == SIGNAL_ANALYZER:
        return None

    def parameter(name: str) -> Any:
        return run.parameter(REFERENCE_GENERATOR, name)

    try:
        waveform, frequency = parameter('waveform'), float(parameter('frequency'))
        if waveform == 'multisine':
            components = parameter('component_frequencies')
            ratios = [Fraction(ratio).limit_denominator(1000) for ratio in components if ratio > 0.0]
            # Greatest common divisor of fractions.
            frequency *= math.gcd(*(ratio.numerator for ratio in ratios)) / math.lcm(
                *(ratio.denominator for ratio in ratios)
            )
        elif waveform not in ('sine', 'square'):
            return None
    except LookupError:
        return _period_of_samples(run)
    return 1.0 / (frequency * run.sample_time) if frequency > 0.0 else None


def follows_sine(run: RecordedRun) -> bool:
    """Return whether the reference at the end of the run is a sine."""
    if run.controller == SIGNAL_ANALYZER:
        return False
    try:
        return bool(run.parameter(REFERENCE_GENERATOR, 'waveform') == 'sine')
    except LookupError:
        return _sine_of_samples(run) is not None


def whole_periods(period: float) -> Fraction:
    """Return a period as the fraction of an integer number of samples over the fewest periods."""
    return Fraction(period).limit_denominator(1000)


def control_cycles(run: RecordedRun, start: int) -> tuple[range, int]:
    """
    Return the rows from ``start`` that make complete cycles of a sine, and the number of cycles.

    Both are empty if the head does not follow a sine of known period.
    """
    period = reference_period(run)
    if period is None or HEAD.name not in run or not follows_sine(run):
        return range(0), 0
    samples = whole_periods(period)
    cycles = (run.row_count - start) // samples.numerator * samples.denominator
    return range(run.row_count - cycles // samples.denominator * samples.numerator, run.row_count), cycles


def _period_of_samples(run: RecordedRun) -> float | None:
    seconds = _sine_of_samples(run)
    if seconds is not None:
        return seconds / run.sample_time
    if REFERENCE.name not in run:
        return None
    run = stretch_of(run)
    samples = repeat(run.desired_position[steady_start(run) :])
    return None if samples is None else float(samples)


def _sine_of_samples(run: RecordedRun) -> float | None:
    """Return the period of `/reference` [s]; None if it is not a sine."""
    if REFERENCE.name not in run:
        return None
    run = stretch_of(run)
    rows = run.reference[steady_start(run) :]
    return sine_period(rows[:, 0], rows[:, 2])
