"""Error and command statistics of a run: from its arrays, or block by block for a long run."""

import dataclasses

import numpy as np

from hdd_servo_ros.analysis.metrics import (
    StepResponse,
    control_effort,
    is_stepwise,
    loop_area,
    power_spectral_density,
    repeatable_parts,
    tracking_metrics,
)
from hdd_servo_ros.analysis.misregistration import misregistration_from_spectrum
from hdd_servo_ros.messages.topics import CONTROL
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import edge_responses, steady_start
from hdd_servo_ros.reporting.long_figures import long_figures
from hdd_servo_ros.reporting.reference_period import control_cycles, reference_period


@dataclasses.dataclass(frozen=True)
class ErrorNumbers:
    """
    Position error after the transient, in the unit of errors.

    Attributes
    ----------
    rms, largest, mean, misregistration
        Root mean square, peak, mean, and three standard deviations.
    misregistration_from_spectrum
        Three standard deviations from the power spectral density; None for fewer than three samples, or if not
        requested.
    parts
        Root mean square of the repeatable and of the non-repeatable part; None if they are unknown.
    """

    rms: float
    largest: float
    mean: float
    misregistration: float
    misregistration_from_spectrum: float | None
    parts: tuple[float, float] | None


def error_numbers(run: RecordedRun, after: float | None, *, spectrum: bool = True) -> ErrorNumbers:
    """Return the statistics of the position error of a run that follows a reference."""
    return _long_error(run, after) if run.is_long else _error(run, after, spectrum)


def _error(run: RecordedRun, after: float | None, spectrum: bool) -> ErrorNumbers:
    start = steady_start(run, after)
    control = run.command if CONTROL.name in run else np.zeros(len(run.ticks))
    tracking = tracking_metrics(
        run.time,
        run.desired_position,
        run.relative_position,
        control,
        transient=float(run.time[start]),
        unit=run.error_factor,
    )
    error = run.error_factor * run.position_error[start:]
    of_spectrum = None
    if spectrum and len(error) > 2:
        of_spectrum = misregistration_from_spectrum(*power_spectral_density(error, run.sample_time))
    period, parts = reference_period(run), None
    if period is not None and len(error) >= 2.0 * period:
        try:
            found = repeatable_parts(error, period)
        except ValueError:
            # In a short run, the periods that take an integer number of samples may be too long.
            pass
        else:
            parts = found.repeatable_rms, found.non_repeatable_rms
    return ErrorNumbers(tracking.rms_error, tracking.max_error, tracking.mean_error, tracking.tmr, of_spectrum, parts)


def _long_error(run: RecordedRun, after: float | None) -> ErrorNumbers:
    error = long_figures(run, after).error
    assert error is not None
    periods, size = error.periods, error.size
    parts = None
    if periods is not None:
        parts = float(np.sqrt(np.mean(np.square(periods.mean_period)))), periods.rest_rms
    return ErrorNumbers(
        size.rms, size.largest, size.mean, size.misregistration, error.misregistration_from_spectrum, parts
    )


@dataclasses.dataclass(frozen=True)
class ControlNumbers:
    """
    Command of a run.

    Attributes
    ----------
    peak
        Peak over the whole run [V].
    rms
        Root mean square after the transient [V].
    variation
        Total variation after the transient: sum of the magnitudes of all changes per tick [V].
    areas
        Loop area of the command, and of its feedback part, over the position per cycle of a sine; None without one.
    """

    peak: float
    rms: float
    variation: float
    areas: tuple[float, float] | None


def control_numbers(run: RecordedRun, after: float | None) -> ControlNumbers:
    """Return the statistics of the command of a run."""
    if run.is_long:
        control = long_figures(run, after).control
        assert control is not None
        areas = control.areas if control.cycles else None
        return ControlNumbers(control.peak, control.size.rms, control.variation.total, areas)
    start = steady_start(run, after)
    effort = control_effort(run.command[start:])
    rows, cycles = control_cycles(run, start)
    areas = None
    if cycles:
        part = slice(rows.start, None)
        whole, feedback = (loop_area(run.position[part], force[part], cycles) for force in (run.command, run.feedback))
        areas = whole, feedback
    return ControlNumbers(float(np.abs(run.command).max()), effort.rms, effort.total_variation, areas)


def has_stepwise_reference(run: RecordedRun, after: float | None = None) -> bool:
    """Return whether the reference is constant except for a few steps."""
    return long_figures(run, after).is_stepwise if run.is_long else is_stepwise(run.desired_position)


def responses_to_edges(run: RecordedRun, after: float | None = None) -> StepResponse | None:
    """Return the responses to the edges of a stepwise reference; None for a constant one."""
    if run.is_long:
        return long_figures(run, after).steps
    try:
        return edge_responses(run)
    except ValueError:
        return None
