"""The summary of a run in a few lines."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.reporting.evaluation import transient_of
from hdd_servo_ros.reporting.run_sums import RunSums
from hdd_servo_ros.reporting.saturation import saturation_line
from hdd_servo_ros.reporting.verdict import Verdict, verdict


def summary(
    source: Signals | RunSums,
    description: Mapping[str, Any],
    directory: Path | None = None,
    judged: Verdict | None = None,
) -> str:
    """
    Return the summary of a run.

    Parameters
    ----------
    source
        The signals of the whole run, or their :class:`RunSums`.
    description
        Content of ``run.yaml``, or for an unrecorded run its known part: ``status``, ``reason``, ``controller``,
        ``frame_id``, ``sample_time`` and ``nodes``. Lines without data are omitted.
    directory
        Directory of the run, if it was recorded.
    judged
        Verdict that replaces the one from the sums.

    Raises
    ------
    ValueError
        If the run has no samples.
    """
    if isinstance(source, Signals):
        sums = RunSums(description, transient_of(source.duration))
        sums.add(source)
    else:
        sums = source
    if not sums.samples:
        raise ValueError('a run without samples has no summary')
    units, topics = sums.units, len(description.get('topics', ()))
    lines = [
        ('run', _outcome(judged or verdict(sums, description.get('reason', '')), description)),
        ('controller', f'{description.get("controller", "unknown")}, drive {description.get("frame_id", "unknown")}'),
    ]
    if sums.has_error:
        unit, factor = shown(units.error), units.error_factor
        rms, peak = factor * sums.rms_error, factor * sums.peak_error
        name = 'track error' if sums.is_track_following else 'tracking error'
        lines.append((name, f'{rms:.4g} {unit} rms, {peak:.4g} {unit} max (after {sums.transient:g} s)'))
    if sums.control.count:
        lines.append(('peak control', f'{sums.control.largest:.4g} {shown(units.control)} (whole run)'))
    estimates = ', '.join(f'{name} {value:.4g}' for name, value in sums.estimates.items())
    lines.append(('estimates', f'{estimates or "none"} (at the end)'))
    lines.append(
        ('ticks', f'{sums.samples} of {description["sample_time"]:g} s, {sums.first_tick} to {sums.last_tick}')
    )
    if topics:
        lines.append(('messages', f'{sums.samples * topics} on {topics} topics, {sums.samples} each'))
    if sums.saturated:
        lines.append(('saturation', saturation_line(sums.saturated, sums.samples)))
    if description.get('real_time_factor'):
        lines.append(('real-time factor', f'{description["real_time_factor"]:.3g}'))
    if directory is not None:
        lines.append(('run folder', str(directory)))
    width = max(len(name) for name, _ in lines)
    return '\n'.join(f'{name:>{width}}  {text}' for name, text in lines)


def _outcome(judged: Verdict | None, description: Mapping[str, Any]) -> str:
    """Return status, reason and verdict of the run."""
    status, reason = description.get('status', 'unknown'), description.get('reason', '')
    text = f'{status}: {reason}' if reason else str(status)
    if judged is None:
        return text
    return f'{text}, {judged.text}' if judged.tracks else f'{text}, but {judged.in_words}'
