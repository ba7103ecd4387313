"""The figures that a report gives of a run, from its bag."""

import dataclasses
import math
from fractions import Fraction
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.metrics import (
    control_effort,
    is_stepwise,
    loop_area,
    power_spectral_density,
    repeatable_parts,
    step_response,
    tracking_metrics,
)
from hdd_servo_ros.analysis.misregistration import misregistration_from_spectrum
from hdd_servo_ros.analysis.period import repeat, sine_period
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.summary import OPEN_LOOP, SIGNAL_ANALYZER, transient_of

REFERENCE_GENERATOR = 'reference_generator'


@dataclasses.dataclass(frozen=True)
class Metric:
    """One figure of a run."""

    name: str
    label: str
    value: float
    unit: str


def shown_unit(unit: str) -> str:
    """Return a unit as it is written for people."""
    return unit.replace('um', 'µm')


def tracks(run: RecordedRun) -> bool:
    """Return whether the run has an error: a head that was to follow a reference."""
    return 'reference' in run and 'head' in run and run.controller not in OPEN_LOOP


def reference_period(run: RecordedRun) -> float | None:
    """
    Return the period of the reference at the end of the run [samples], None if it is not periodic or not known.

    The reference's parameters tell it; without ``run.yaml``, or with a reference from a node that is not ours, the
    samples of `/reference` in the part of the run that counts do.
    """
    if run.controller == SIGNAL_ANALYZER:
        return None

    def said(name: str) -> Any:
        return run.parameter(REFERENCE_GENERATOR, name)

    try:
        waveform, frequency = said('waveform'), float(said('frequency'))
        if waveform == 'multisine':
            ratios = [Fraction(ratio).limit_denominator(1000) for ratio in said('component_frequencies') if ratio > 0.0]
            # The greatest common divisor of fractions.
            frequency *= math.gcd(*(ratio.numerator for ratio in ratios)) / math.lcm(
                *(ratio.denominator for ratio in ratios)
            )
        elif waveform not in ('sine', 'square'):
            return None
    except LookupError:
        return _period_of_samples(run)
    return 1.0 / (frequency * run.sample_time) if frequency > 0.0 else None


def _period_of_samples(run: RecordedRun) -> float | None:
    seconds = _sine_of_samples(run)
    if seconds is not None:
        return seconds / run.sample_time
    if 'reference' not in run:
        return None
    samples = repeat(run.desired_position[steady_start(run) :])
    return None if samples is None else float(samples)


def _sine_of_samples(run: RecordedRun) -> float | None:
    """Return the period of the sine that `/reference` is [s], None if it is none."""
    if 'reference' not in run:
        return None
    rows = run.reference[steady_start(run) :]
    return sine_period(rows[:, 0], rows[:, 2])


def follows_sine(run: RecordedRun) -> bool:
    """Return whether the reference at the end of the run is a sine."""
    if run.controller == SIGNAL_ANALYZER:
        return False
    try:
        return bool(run.parameter(REFERENCE_GENERATOR, 'waveform') == 'sine')
    except LookupError:
        return _sine_of_samples(run) is not None


def left_out(run: RecordedRun, after: float | None = None) -> list[str]:
    """Return what a report of this run leaves out that reports of others hold, and why, a line each."""
    lines = []
    if not run.description:
        lines.append(
            'there is no run.yaml: how the run ended, its controller, its parameters and saturation are not known'
        )
    missing = [f'/{name}' for name in ('head', 'reference') if name not in run]
    if missing and run.controller not in OPEN_LOOP:
        lines.append(f'no tracking error and what follows from it: the bag holds no {" and no ".join(missing)}')
    if 'control' not in run:
        lines.append('no figures of the control: the bag holds no /control')
    if tracks(run) and not is_stepwise(run.desired_position):
        period = reference_period(run)
        if period is None:
            lines.append('no repeatable parts, areas and hysteresis: no period of the reference is known')
            return lines
        samples, whole = len(run.ticks) - steady_start(run, after), _whole_periods(period).numerator
        if samples < 2 * whole:
            what = 'repeatable parts and areas' if samples < whole and follows_sine(run) else 'repeatable parts'
            lines.append(
                f'no {what}: {samples * run.sample_time:g} s count, and the periods of the reference that make whole '
                f'samples take {whole * run.sample_time:g} s'
            )
    return lines


def _whole_periods(period: float) -> Fraction:
    """Return a period as whole samples over the fewest periods that make them."""
    return Fraction(period).limit_denominator(1000)


def steady_start(run: RecordedRun, after: float | None = None) -> int:
    """
    Return the row from which the run counts as steady.

    Parameters
    ----------
    run
        The run.
    after
        Time before which nothing counts [s]; None for the first half of the run, 2 s at most.
    """
    start = run.since(transient_of(run.duration) if after is None else after).start
    changes = [change.tick for change in run.parameter_changes if change.node.endswith(f'/{REFERENCE_GENERATOR}')]
    # A reference that was changed later starts anew then.
    return max(start, int(np.searchsorted(run.ticks, changes[-1]))) if changes and after is None else int(start)


def run_metrics(run: RecordedRun, after: float | None = None) -> list[Metric]:
    """
    Return the metrics of a run; those that its reference or its topics do not allow are left out.

    Parameters
    ----------
    run
        The run.
    after
        As of :func:`steady_start`.

    Raises
    ------
    ValueError
        If nothing lies after that time.
    """
    start = steady_start(run, after)
    if start >= len(run.ticks):
        raise ValueError(f'{run.path}: nothing after {after} s: the run ends at {run.duration:g} s')
    found: list[Metric] = []
    if tracks(run):
        found += _tracking(run, start)
        if is_stepwise(run.desired_position):
            found += _steps(run)
    if 'control' in run:
        found += _control(run, start)
    return found


def _tracking(run: RecordedRun, start: int) -> list[Metric]:
    unit, factor = run.error_unit, run.error_factor
    control = run.command if 'control' in run else np.zeros(len(run.ticks))
    tracking = tracking_metrics(
        run.time, run.desired_position, run.position, control, transient=float(run.time[start]), unit=factor
    )
    error = factor * run.error[start:]
    found = [
        Metric('rms_error', 'rms error', tracking.rms_error, unit),
        Metric('max_error', 'max error', tracking.max_error, unit),
        Metric('mean_error', 'mean error', tracking.mean_error, unit),
        Metric('tmr', 'TMR, 3 sigma', tracking.tmr, unit),
    ]
    if len(error) > 2:
        tmr = misregistration_from_spectrum(*power_spectral_density(error, run.sample_time))
        found.append(Metric('tmr_of_spectrum', 'TMR from the spectrum', tmr, unit))
    period = reference_period(run)
    if period is not None and len(error) >= 2.0 * period:
        try:
            parts = repeatable_parts(error, period)
        except ValueError:
            # A frequency for which many periods make a whole number of samples, in a short run.
            return found
        found.append(Metric('repeatable_error', 'repeatable error, rms', parts.repeatable_rms, unit))
        found.append(Metric('non_repeatable_error', 'non-repeatable error, rms', parts.non_repeatable_rms, unit))
    return found


def _steps(run: RecordedRun) -> list[Metric]:
    try:
        response = step_response(run.time, run.desired_position, run.position)
    except ValueError:
        # A reference that stands still.
        return []
    worst, median = response.worst(), response.median()
    found = [Metric('edges', 'edges of the reference', float(len(response)), '')]
    for name, label, unit, factor in (
        ('overshoot', 'overshoot', '%', 1.0),
        ('settling_time', '2 % settling time', 'ms', 1e3),
        ('steady_error', 'steady error', run.error_unit, run.error_factor),
    ):
        found.append(Metric(f'worst_{name}', f'{label}, worst', factor * worst[name], unit))
        if len(response) > 1:
            found.append(Metric(f'median_{name}', f'{label}, median', factor * median[name], unit))
    return found


def _control(run: RecordedRun, start: int) -> list[Metric]:
    unit = run.control_unit
    effort = control_effort(run.command[start:])
    seconds = max(len(run.command) - 1 - start, 1) * run.sample_time
    found = [
        Metric('peak_control', 'peak control, whole run', float(np.abs(run.command).max()), unit),
        Metric('rms_control', 'rms control', effort.rms, unit),
        Metric('control_variation', 'variation of the control', effort.total_variation / seconds, f'{unit}/s'),
    ]
    period = reference_period(run)
    if period is not None and 'head' in run and follows_sine(run):
        samples = _whole_periods(period)
        cycles = (len(run.ticks) - start) // samples.numerator * samples.denominator
        if cycles:
            rows = slice(len(run.ticks) - cycles // samples.denominator * samples.numerator, None)
            area_unit = f'{run.length_unit} {unit}'
            for name, label, force in (
                ('control_loop_area', 'area of the control over the position', run.command[rows]),
                ('feedback_loop_area', "area of the control's feedback part", run.feedback[rows]),
            ):
                found.append(Metric(name, label, loop_area(run.position[rows], force, cycles), area_unit))
    return found
