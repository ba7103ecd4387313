"""Metrics and tables of the seeks of a run, and of seek times over length."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.off_track import READ_LIMIT, WRITE_LIMIT
from hdd_servo_ros.analysis.seek_metrics import SeekResponse, access_times, returns_to_earlier_modes
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.long_runs import begins_within
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.seeks_of_run import (
    bound_curve,
    modes_of,
    responses_of,
    seeks_of,
    time_optimal_times,
    tolerance_of,
)

LIMITS = (WRITE_LIMIT, READ_LIMIT)
"""Largest off-track fractions of the track pitch for writing and reading."""
_MILLI = 1e3
_MOST_LINES = 200
"""Rows of the table of seeks on the page; ``metrics.yaml`` has all seeks."""


def why_no_seek_metrics(run: RecordedRun) -> str:
    """Return why the metrics of seeks are omitted; empty if they are present, or the run has no seeks."""
    if seeks_of(run) and tolerance_of(run) is None:
        return f'the track pitch is in um, and this drive is in {run.length_unit}'
    return ''


def _responses(run: RecordedRun, of_pitch: float = WRITE_LIMIT) -> list[SeekResponse]:
    """Return the seek responses for a tolerance in track pitches; empty without seeks or a known pitch."""
    tolerance = tolerance_of(run, of_pitch)
    return [] if tolerance is None or not seeks_of(run) else responses_of(run, tolerance)


def seek_line(run: RecordedRun) -> str:
    """Return a summary line about the seeks of a run; empty without seeks."""
    responses, tolerance = _responses(run), tolerance_of(run)
    if not responses or tolerance is None:
        return ''
    times = [response.seek_time for response in responses]
    arrived = sum(response.has_arrived for response in responses)
    within = f'within {run.error_factor * tolerance:.4g} {shown(run.error_unit)}'
    if not arrived:
        return f'none of {len(responses)} arrives {within}{_where(run)}'
    median, worst = _MILLI * _median(times), _MILLI * max(times)
    slowest = f'worst {worst:.4g} ms' if arrived == len(responses) else f'{len(responses) - arrived} do not arrive'
    return f'{arrived} of {len(responses)} arrive {within}, median {median:.4g} ms, {slowest}{_where(run)}'


def _where(run: RecordedRun) -> str:
    """Return the part of the run as text; empty for the whole run."""
    return f' (from {run.time[0]:g} s on)' if begins_within(run) else ''


def has_seeks(run: RecordedRun) -> bool:
    """Return whether a run has seeks with a known tolerance."""
    return bool(_responses(run))


def lost_seeks(run: RecordedRun) -> str:
    """Return a line about the seeks that do not arrive; empty if all arrive."""
    responses = _responses(run)
    lost = [response for response in responses if not response.has_arrived]
    if not lost:
        return ''
    first = lost[0]
    left = ', which leaves the tolerance again' if first.first_arrival < math.inf else ''
    return (
        f'{len(lost)} of {len(responses)} seeks do not arrive within {100.0 * WRITE_LIMIT:g} % of the track pitch and '
        f'stay, first that of {first.seek.length:+.4g} um at {first.time:g} s{left}{_where(run)}'
    )


def _median(values: list[float]) -> float:
    """Return the median; infinite if at least half of the values are."""
    ordered = sorted(values)
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return 0.5 * (low + high) if high < math.inf else math.inf


def _worst(values: list[float]) -> float:
    """Return the largest value; infinite if one is unknown."""
    return max(math.inf if math.isnan(value) else value for value in values)


def seek_metrics(run: RecordedRun) -> list[Metric]:
    """Return the metrics of the seeks; empty without seeks or a known track pitch."""
    responses = _responses(run)
    if not responses:
        return []
    unit, factor, volt = run.error_unit, run.error_factor, run.control_unit
    found = [
        Metric('seeks', 'seeks', float(len(responses)), ''),
        Metric('seeks_arrived', 'seeks that arrive', float(sum(response.has_arrived for response in responses)), ''),
    ]
    for of_pitch in LIMITS:
        percent = f'{100.0 * of_pitch:g}'
        times = [_MILLI * response.seek_time for response in _responses(run, of_pitch)]
        for kind, value in (('median', _median(times)), ('worst', max(times))):
            label = f'seek time, within {percent} % of pitch, {kind}'
            found.append(Metric(f'{kind}_seek_time_{percent}', label, value, 'ms'))

    def worst(name: str, label: str, number: Callable[[SeekResponse], float], unit: str) -> None:
        found.append(Metric(name, f'{label}, worst', _worst([number(response) for response in responses]), unit))

    worst('seek_settling', 'settling part of a seek', lambda response: _MILLI * response.settling_time, 'ms')
    worst('seek_overshoot', 'overshoot of a seek', lambda response: factor * response.overshoot, unit)
    worst('residual_peak', 'residual vibration, peak', lambda response: factor * response.residual_peak, unit)
    worst('residual_rms', 'residual vibration, rms', lambda response: factor * response.residual_rms, unit)
    worst('seek_peak_control', 'peak control of a seek', lambda response: response.peak_control, volt)
    worst('seek_rms_control', 'rms control of a seek', lambda response: response.rms_control, volt)
    worst('seek_peak_jerk', 'peak jerk of a seek', lambda response: response.peak_jerk, f'{run.length_unit}/s^3')
    worst('seek_rms_jerk', 'rms jerk of a seek', lambda response: response.rms_jerk, f'{run.length_unit}/s^3')
    optimal = time_optimal_times(run, [response.seek for response in responses])
    if optimal is not None:
        times = [response.seek_time / time for response, time in zip(responses, optimal.tolist(), strict=True)]
        found.append(Metric('seek_time_over_optimal', 'seek time over T*, worst', max(times), ''))
    modes = modes_of(run)
    if modes is not None:
        returns = returns_to_earlier_modes(modes, seeks_of(run))
        found.append(Metric('mode_returns', 'returns to an earlier mode', float(len(returns)), ''))
    return found


def seeks_as_rows(run: RecordedRun) -> list[dict[str, float]]:
    """
    Return one row of values per seek, with the units in the names.

    Times refer to a tolerance of 10 % of the track pitch, unless the name states another. An undefined time is
    infinite, another undefined value is nan.
    """
    responses = _responses(run)
    tolerance = tolerance_of(run)
    if not responses or tolerance is None:
        return []
    optimal = time_optimal_times(run, [response.seek for response in responses])
    curve = bound_curve(run, tolerance)
    factor, unit = run.error_factor, run.error_unit
    rows = []
    for index, (response, reading) in enumerate(zip(responses, _responses(run, READ_LIMIT), strict=True)):
        row = {
            'start_s': response.time,
            'from_um': response.seek.origin,
            'to_um': response.seek.target,
            'first_arrival_ms': _MILLI * response.first_arrival,
            'seek_time_ms': _MILLI * response.seek_time,
            'seek_time_15_ms': _MILLI * reading.seek_time,
            'settling_ms': _MILLI * response.settling_time,
            f'overshoot_{unit}': factor * response.overshoot,
            f'residual_peak_{unit}': factor * response.residual_peak,
            f'residual_rms_{unit}': factor * response.residual_rms,
            'residual_frequency_Hz': response.residual_frequency,
            f'peak_control_{run.control_unit}': response.peak_control,
            f'rms_control_{run.control_unit}': response.rms_control,
            'peak_jerk_um_s3': response.peak_jerk,
            'rms_jerk_um_s3': response.rms_jerk,
        }
        if optimal is not None:
            row['over_time_optimal'] = response.seek_time / float(optimal[index])
        if curve is not None:
            row['over_fastest'] = response.seek_time / curve.fastest_at(abs(response.seek.length))
        rows.append({name: float(value) for name, value in row.items()})
    return rows


def access_times_as_rows(run: RecordedRun) -> list[dict[str, float]]:
    """Return one row per range of lengths: number of seeks, arrivals, median and worst time, and bounds."""
    responses, tolerance = _responses(run), tolerance_of(run)
    if not responses or tolerance is None:
        return []
    curve = bound_curve(run, tolerance)
    rows = []
    for part in access_times(responses):
        row = {
            'shortest_um': part.shortest,
            'longest_um': part.longest,
            'seeks': float(part.count),
            'arrived': float(part.arrived),
            'median_ms': _MILLI * part.median,
            'worst_ms': _MILLI * part.worst,
        }
        if curve is not None:
            row['time_optimal_of_longest_ms'] = _MILLI * float(
                np.exp(np.interp(np.log(part.longest), np.log(curve.lengths), np.log(curve.time_optimal)))
            )
            row['fastest_of_longest_ms'] = _MILLI * curve.fastest_at(part.longest)
        rows.append(row)
    return rows


def seek_tables(run: RecordedRun) -> dict[str, list[list[str]]]:
    """Return the tables of a report by title, each with a header row; empty without seeks."""
    seeks, title = seeks_as_rows(run), 'seeks'
    if len(seeks) > _MOST_LINES:
        title = f'the {_MOST_LINES} slowest of {len(seeks)} seeks'
        slowest = sorted(seeks, key=lambda row: row['seek_time_ms'])[-_MOST_LINES:]
        seeks = sorted(slowest, key=lambda row: row['start_s'])
    tables = {'access times over length': access_times_as_rows(run), title: seeks}
    return {name: _lines(rows) for name, rows in tables.items() if rows}


def _lines(rows: list[dict[str, float]]) -> list[list[str]]:
    head = [_heading(name) for name in rows[0]]
    return [head, *([_text(name, value) for name, value in row.items()] for row in rows)]


def _heading(name: str) -> str:
    words, _, unit = name.rpartition('_')
    if unit in ('s', 'ms', 'um', 'nm', 'Hz', 'V'):
        return f'{words.replace("_", " ")} [{shown(unit)}]'
    if name.endswith('_um_s3'):
        return f'{name.removesuffix("_um_s3").replace("_", " ")} [{shown("um/s^3")}]'
    return name.replace('_', ' ')


def _text(name: str, value: float) -> str:
    if math.isinf(value):
        return '! never' if name.endswith('_ms') else '! infinite'
    return '' if math.isnan(value) else f'{value:.4g}'


def for_yaml(run: RecordedRun) -> dict[str, Any]:
    """Return the entries about seeks in ``metrics.yaml``; empty without seeks."""
    if not _responses(run):
        return {}
    return {'seeks': seeks_as_rows(run), 'access_times': access_times_as_rows(run)}
