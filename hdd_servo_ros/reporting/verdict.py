"""Whether a run did what it was to do: it tracks, does not track, diverged, or was saturated."""

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
"""The verdict of a run whose error grew without bounds."""
TRACKING_SHARE = 0.5
"""A run tracks if its rms error is below this share of that of a head that rests at the reference's mean."""
DIVERGED_SPANS = 3.0
"""A run has diverged if its error exceeds the reference's span this many times; a head at rest stays within one."""
SATURATED_SHARE = 0.5
"""A run counts as saturated if more than this share of the samples of the command or of a sensor output is clipped."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """
    Judgment of a run, beyond how it ended.

    Attributes
    ----------
    text
        ``tracks``, ``does not track``, ``arrives``, ``does not arrive``, ``diverged`` or ``saturated n %``.
    tracks
        Whether the run tracks, or all its seeks arrive, without reservations.
    detail
        By what criterion it does not; empty for a run that tracks.
    """

    text: str
    tracks: bool = False
    detail: str = ''

    @property
    def in_table(self) -> str:
        """The verdict in a table, marked where the run does not track."""
        return in_table(self.text)

    @property
    def in_words(self) -> str:
        """The verdict with its criterion."""
        return f'{self.text} ({self.detail})' if self.detail else self.text


def in_table(text: str) -> str:
    """Return the text of a verdict as tables have it, marked where the run does not track; empty for no verdict."""
    return text if text in ('', TRACKS, ARRIVES) else f'! {text}'


def verdict(sums: RunSums, reason: str = '') -> Verdict | None:
    """
    Judge a run; what it did before the end of its transient does not count.

    A controller that ended the run by a fault of its own, such as a sensor's overload, is judged by the signals alone.

    In this order: a run that failed since a signal was not finite, whose error is not finite or is larger than
    :data:`DIVERGED_SPANS` times the span of the reference, diverged. One with more than :data:`SATURATED_SHARE` of the
    samples of the command or of a sensor output clipped was saturated. One whose rms error is not smaller than
    :data:`TRACKING_SHARE` times the reference's own rms about its mean does not track. Where the reference stands still
    after the transient, its distance from the head's first position replaces that rms.

    Parameters
    ----------
    sums
        Of the signals of the run.
    reason
        Why the run ended, if it failed.

    Returns
    -------
    Verdict or None
        None where nothing is to be tracked: without a reference, with a controller that follows none, or with a
        reference that never leaves the head's first position.
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
    Judge a recorded run; ``after`` is the time before which errors do not count [s], None for the usual one.

    A run with seeks that neither diverged nor was saturated is judged by them: ``arrives`` or ``does not arrive``. Of a
    long run those of its last stretch count; see :func:`~hdd_servo_ros.reporting.long_runs.stretch_of`.
    """
    found = verdict(sums_of(run, after), run.reason)
    if found is None or not (found.tracks or found.text == DOES_NOT_TRACK):
        return found
    if not may_have_seeks(run):
        return found
    # Late: it needs more than a verdict does otherwise.
    from hdd_servo_ros.reporting.seek_report import has_seeks, lost_seeks
    from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks

    part = part_with_seeks(run)
    if not has_seeks(part):
        return found
    lost = lost_seeks(part)
    return Verdict('does not arrive', detail=lost) if lost else Verdict(ARRIVES, tracks=True)
