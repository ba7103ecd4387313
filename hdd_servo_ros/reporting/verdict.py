"""The verdict on a run: it tracks, does not track, diverged, or was saturated."""

import dataclasses
import math

from hdd_servo_ros.messages.errors import NOT_FINITE
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import may_have_seeks
from hdd_servo_ros.reporting.run_sums import RunSums, sums_of

TRACKS, ARRIVES = 'tracks', 'arrives'
DOES_NOT_TRACK = 'does not track'
DIVERGED = 'diverged'
"""Verdict on a run whose error grew without bound."""
TRACKING_SHARE = 0.5
"""A run tracks if its rms error is below this fraction of that of a head at rest at the reference's mean."""
DIVERGED_SPANS = 3.0
"""A run diverged if its error exceeds the span of the reference by this factor; a head at rest stays within 1."""
SATURATED_SHARE = 0.5
"""A run is saturated if more than this fraction of the command or sensor samples is clipped."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    Verdict on a run, in addition to its status.

    Attributes
    ----------
    text
        ``tracks``, ``does not track``, ``arrives``, ``does not arrive``, ``diverged`` or ``saturated n %``.
    tracks
        Whether the run tracks, or all its seeks arrive.
    detail
        The violated criterion; empty for a run that tracks.
    """

    text: str
    tracks: bool = False
    detail: str = ''

    @property
    def in_table(self) -> str:
        """The verdict for a table, highlighted if the run does not track."""
        return in_table(self.text)

    @property
    def in_words(self) -> str:
        """The verdict with its criterion."""
        return f'{self.text} ({self.detail})' if self.detail else self.text


def in_table(text: str) -> str:
    """Return the verdict for a table, highlighted if the run does not track; empty without a verdict."""
    return text if text in ('', TRACKS, ARRIVES) else f'! {text}'


def verdict(sums: RunSums, reason: str = '') -> Verdict | None:
    """
    Return the verdict on a run; samples before the end of the transient are ignored.

    A run that its controller ended with a fault, such as an overload, is judged only by its signals.

    In this order: a run that failed on a signal that is not finite, or whose error is not finite or above
    :data:`DIVERGED_SPANS` times the span of the reference, diverged. A run with more than :data:`SATURATED_SHARE` of
    the command or sensor samples clipped was saturated. A run whose rms error is not below
    :data:`TRACKING_SHARE` times the rms of the reference about its mean does not track. If the reference is constant
    after the transient, its distance from the first head position replaces that rms.

    Parameters
    ----------
    sums
        Sums over the signals of the run.
    reason
        Reason of a failed run.

    Returns
    -------
    Verdict or None
        None without a task: no reference, a controller that follows no reference, or a reference that never leaves the
        first head position.
    """
    unit, factor = shown(sums.units.error), sums.units.error_factor
    if NOT_FINITE in reason:
        return Verdict(DIVERGED, detail=reason)
    if sums.has_error:
        if not (math.isfinite(sums.rms_error) and math.isfinite(sums.peak_error)):
            return Verdict(DIVERGED, detail='the error is not finite')
        if 0.0 < DIVERGED_SPANS * sums.reference_span < sums.peak_error:
            return Verdict(
                DIVERGED,
                detail=f'error up to {factor * sums.peak_error:.4g} {unit}, more than {DIVERGED_SPANS:g} times '
                f"the reference's span of {factor * sums.reference_span:.4g} {unit}",
            )
    for name, count in sums.saturated_late.items():
        share = count / sums.late_samples if sums.late_samples else 0.0
        if share > SATURATED_SHARE:
            return Verdict(f'saturated {100.0 * share:.0f} %', detail=name)
    if not sums.has_error:
        return None
    moved = sums.late_reference.span > 0.0
    scale = sums.late_reference.rms_about(None if moved else sums.first_position)
    if scale == 0.0:
        return None
    if sums.rms_error < TRACKING_SHARE * scale:
        return Verdict(TRACKS, tracks=True)
    kind = 'rms about its mean' if moved else "distance from the head's first position"
    return Verdict(
        DOES_NOT_TRACK,
        detail=f'rms error {factor * sums.rms_error:.4g} {unit}, not below {TRACKING_SHARE:g} times the '
        f"reference's {kind} of {factor * scale:.4g} {unit}",
    )


def verdict_of(run: RecordedRun, after: float | None = None) -> Verdict | None:
    """
    Return the verdict on a recorded run; ``after`` is the start of the window [s], None for the default.

    A run with seeks that neither diverged nor was saturated is judged by its seeks: ``arrives`` or ``does not arrive``.
    For a long run, the seeks of its last stretch are used; see :func:`~hdd_servo_ros.reporting.long_runs.stretch_of`.
    """
    found = verdict(sums_of(run, after), run.reason)
    if found is None or not (found.tracks or found.text == DOES_NOT_TRACK):
        return found
    if not may_have_seeks(run):
        return found
    # Imported late: it needs more modules than other verdicts.
    from hdd_servo_ros.reporting.seek_report import has_seeks, lost_seeks
    from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks

    part = part_with_seeks(run)
    if not has_seeks(part):
        return found
    lost = lost_seeks(part)
    return Verdict('does not arrive', detail=lost) if lost else Verdict(ARRIVES, tracks=True)
