"""The recorded runs of a study, for its figures and tables."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.metrics import TrackingMetrics, tracking_metrics
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.recording.recorded_run import RecordedRun

_KEPT = 8
"""Number of runs in memory; 200001 ticks of the adaptive NN controller take 40 MB."""


class RecordedRuns:
    """
    The recorded runs of a study: ``runs[case]`` is the :class:`RecordedRun` of a case.

    Parameters
    ----------
    directory
        Parent of the run directories.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._open = functools.lru_cache(_KEPT)(RecordedRun.open)
        self._metrics: dict[tuple[str, float, float], TrackingMetrics] = {}

    def __getitem__(self, case: Case) -> RecordedRun:
        """Return the run of a case; raises the errors of :meth:`RecordedRun.open`."""
        return self._open(self._directory / case.name)

    def parameters(self, case: Case) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node of a case by node name, from ``run.yaml``."""
        nodes = self[case].description['nodes']
        return {name.rsplit('/', 1)[-1]: node['parameters'] for name, node in nodes.items()}

    def metrics(self, case: Case, transient: float, unit: float = 1.0) -> TrackingMetrics:
        """
        Return the tracking metrics of a case.

        Parameters
        ----------
        case
            The case.
        transient
            Start of the window [s].
        unit
            Factor from the unit of length of the run to that of the errors.
        """
        key = (case.name, transient, unit)
        if key not in self._metrics:
            run = self[case]
            self._metrics[key] = tracking_metrics(
                run.time, run.desired_position, run.position, run.command, transient, unit
            )
        return self._metrics[key]

    def chatter(self, case: Case, transient: float) -> float:
        """Return the rms change of the command per tick after the transient [s]."""
        run = self[case]
        return float(np.sqrt(np.mean(np.diff(run.command[run.since(transient)]) ** 2)))
