"""Track error statistics of a run: from its arrays, or block by block for a long run."""

import dataclasses
import weakref
from collections.abc import Mapping

import numpy as np

from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT, OffTrack, off_track
from hdd_servo_ros.analysis.runout import RunoutParts, runout_parts
from hdd_servo_ros.analysis.streamed_periods import StreamedPeriods
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import steady_start
from hdd_servo_ros.reporting.long_figures import long_figures
from hdd_servo_ros.reporting.track_of_run import sectors_of, track_pitch


@dataclasses.dataclass(frozen=True)
class TrackNumbers:
    """
    Track error after the transient.

    Attributes
    ----------
    misregistration
        Three standard deviations [um]; None for one sample.
    largest
        Peak [um].
    parts
        Repeatable and non-repeatable part [um]; None without two known revolutions.
    off_track
        Time off track by limit, a fraction of the track pitch; empty if the pitch is unknown.
    """

    misregistration: float | None
    largest: float
    parts: RunoutParts | None
    off_track: Mapping[float, OffTrack]


_FOUND: weakref.WeakKeyDictionary[RecordedRun, dict[float | None, TrackNumbers]] = weakref.WeakKeyDictionary()


def track_numbers(run: RecordedRun, after: float | None) -> TrackNumbers:
    """Return the statistics of the track error of a run with a disturbance."""
    found = _FOUND.setdefault(run, {})
    if after not in found:
        found[after] = _long(run, after) if run.is_long else _computed(run, after)
    return found[after]


def _computed(run: RecordedRun, after: float | None) -> TrackNumbers:
    error, sectors, pitch = run.track_error[steady_start(run, after) :], sectors_of(run), track_pitch(run)
    limits = [] if pitch is None else [(share, share * pitch) for share in (WRITE_LIMIT, READ_LIMIT)]
    return TrackNumbers(
        misregistration(error) if len(error) > 1 else None,
        float(abs(error).max()),
        runout_parts(error, sectors) if sectors and len(error) >= 2 * sectors else None,
        {share: off_track(error, limit, run.sample_time) for share, limit in limits},
    )


def _long(run: RecordedRun, after: float | None) -> TrackNumbers:
    track = long_figures(run, after).track
    assert track is not None
    samples = run.row_count - steady_start(run, after)
    return TrackNumbers(
        track.size.misregistration,
        track.size.largest,
        None if track.revolutions is None else _parts(track.revolutions),
        {share: OffTrack(off.count / samples, off.longest * run.sample_time) for share, off in track.off_track.items()},
    )


def _parts(revolutions: StreamedPeriods) -> RunoutParts:
    mean = revolutions.waveform
    variance = revolutions.rest_square_sum / (revolutions.period * (revolutions.cycles - 1))
    return RunoutParts(
        sectors=revolutions.period,
        revolutions=revolutions.cycles,
        repeatable=mean,
        repeatable_peak_to_peak=float(np.ptp(mean)),
        repeatable_three_sigma=misregistration(mean),
        non_repeatable_peak_to_peak=revolutions.rest_peak_to_peak,
        non_repeatable_three_sigma=3.0 * float(np.sqrt(variance)),
    )
