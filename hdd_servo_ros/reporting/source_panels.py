"""Contribution of each source to the position error of a run: metrics and a bar plot."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.panel import COLORS, GRAY, Panel, Trace

REST = 'rest'


@dataclasses.dataclass(frozen=True)
class ErrorBySource:
    """
    The track error of a run by source.

    Attributes
    ----------
    total
        3 sigma with all sources, in the unit of lengths.
    contributions
        3 sigma by source, in the unit of lengths; negative for a source that reduces the error. ``rest`` is the part
        that no single source explains.
    """

    total: float
    contributions: Mapping[str, float]


def source_metrics(run: RecordedRun, found: ErrorBySource) -> list[Metric]:
    """Return one metric per source."""
    return [
        Metric(
            f'error_from_{source.replace(" ", "_").replace(".", "_")}',
            f'track error from {"no source alone" if source == REST else source}, 3 sigma',
            run.error_factor * value,
            run.error_unit,
        )
        for source, value in found.contributions.items()
    ]


def source_panel(run: RecordedRun, found: ErrorBySource) -> Panel:
    """Return the bar plot of the total and the contributions."""
    bars = {'all': found.total, **found.contributions}
    traces = [
        Trace(
            name,
            np.array([float(index)]),
            np.array([run.error_factor * value]),
            GRAY if name in ('all', REST) else COLORS[index % len(COLORS)],
            barred=True,
        )
        for index, (name, value) in enumerate(bars.items())
    ]
    return Panel(
        'error_by_source',
        'Track error by source: root of the difference of the variances with and without it',
        '',
        f'3 sigma [{shown(run.error_unit)}]',
        tuple(traces),
        categories=tuple(name.replace(' ', '\n').replace('.', '\n') for name in bars),
    )
