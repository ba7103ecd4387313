"""The recorded runs of a study, as its figures and tables see them."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from hdd_servo_ros.loop.metrics import TrackingMetrics, tracking_metrics
from hdd_servo_ros.recording.bag_reader import Signals, read_signals
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.studies.case import Case

_KEPT = 8
"""Runs whose signals stay in memory; 200001 ticks of the adaptive NN controller are 43 MB."""


class RecordedRuns:
    """
    Signals and metrics of cases, from their bags alone.

    Parameters
    ----------
    directory
        Where the runs' folders lie.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._read = functools.lru_cache(_KEPT)(read_signals)
        self._metrics: dict[tuple[str, float, float], TrackingMetrics] = {}

    def signals(self, case: Case) -> Signals:
        """Return the signals of a case's run; errors as of :func:`read_signals`."""
        return self._read(self._directory / case.name)

    def run_yaml(self, case: Case) -> dict[str, Any]:
        """Return what ``run.yaml`` says of a case's run."""
        return read_run_yaml(self._directory / case.name)

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
            signals = self.signals(case)
            self._metrics[key] = tracking_metrics(
                signals.time, signals.reference[:, 0], signals.head[:, 0], signals.control[:, 0], transient, unit
            )
        return self._metrics[key]

    def chatter(self, case: Case, transient: float) -> float:
        """Return the rms change of the control from one tick to the next, after the transient [s]."""
        signals = self.signals(case)
        control = signals.control[signals.time >= transient, 0]
        return float(np.sqrt(np.mean(np.diff(control) ** 2)))
