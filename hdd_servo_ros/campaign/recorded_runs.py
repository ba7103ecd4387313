"""The recorded runs of a study, as its figures and tables see them."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.metrics import TrackingMetrics, tracking_metrics
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.recording.recorded_run import RecordedRun

_KEPT = 8
"""Runs that stay in memory; 200001 ticks of the adaptive NN controller are 40 MB."""


class RecordedRuns:
    """
    The runs of a study's cases, from their bags alone: ``runs[case]`` is the case's :class:`RecordedRun`.

    Parameters
    ----------
    directory
        Where the runs' folders lie.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._open = functools.lru_cache(_KEPT)(RecordedRun.open)
        self._metrics: dict[tuple[str, float, float], TrackingMetrics] = {}

    def __getitem__(self, case: Case) -> RecordedRun:
        """Return a case's run; errors as of :meth:`RecordedRun.open`."""
        return self._open(self._directory / case.name)

    def parameters(self, case: Case) -> dict[str, dict[str, Any]]:
        """Return the parameters of a case's nodes under their own names, as its ``run.yaml`` has them."""
        nodes = self[case].description['nodes']
        return {name.rsplit('/', 1)[-1]: node['parameters'] for name, node in nodes.items()}

    def metrics(self, case: Case, transient: float, unit: float = 1.0) -> TrackingMetrics:
        """
        Return how well a case tracked.

        Parameters
        ----------
        case
            Which run.
        transient
            Time before which errors do not count [s].
        unit
            Factor from the run's unit of length to that of the errors.
        """
        key = (case.name, transient, unit)
        if key not in self._metrics:
            run = self[case]
            self._metrics[key] = tracking_metrics(
                run.time, run.desired_position, run.position, run.command, transient, unit
            )
        return self._metrics[key]

    def chatter(self, case: Case, transient: float) -> float:
        """Return the rms change of the control from one tick to the next, after the transient [s]."""
        run = self[case]
        return float(np.sqrt(np.mean(np.diff(run.command[run.since(transient)]) ** 2)))
