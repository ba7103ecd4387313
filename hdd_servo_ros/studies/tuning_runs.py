"""
Simulated runs for the tuning of controllers: sines, and steps from rest.

A search simulates them one by one in its own process, because each point depends on the results of earlier ones.
"""

import copy
import math
from collections.abc import Mapping

import numpy as np

from hdd_servo_ros.analysis.metrics import NANOMETRES, TrackingMetrics, step_response, tracking_metrics
from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.simulation.experiment import Experiment

AMPLITUDE = 2.0
"""Amplitude of the sines [um]."""
FREQUENCIES = (100.0, 200.0)
"""Frequencies of the sines on which the PID controller is tuned [Hz]."""
TRANSIENT = 2.0
"""Transient at the start of a run, which the tables ignore [s]."""
HEIGHTS = (5.0, 0.5)
"""Heights of the steps on which the overshoot is measured [um]."""
_STEP_TIME = 1e-3
"""Time of the steps [s]."""
_STEP_DURATION = 0.05
"""Duration of a run with a step: enough for the largest overshoot [s]."""

Sections = Mapping[str, Mapping[str, object]]


def run_sine(
    controller: str,
    gains: Mapping[str, object],
    sections: Sections,
    sample_time: float,
    frequency: float,
    duration: float,
) -> SignalRows:
    """
    Run a 2 µm sine with one controller.

    Parameters
    ----------
    controller
        ``'pid'`` or ``'adaptive_nn'``.
    gains
        Parameters that override those in ``sections``.
    sections
        Parameters of drive, vibrometer and controller.
    sample_time
        T [s].
    frequency
        Frequency of the sine [Hz].
    duration
        Duration of the run [s].
    """
    node = f'{controller}_controller'
    parameters = {
        **bench_of(sections),
        'reference_generator': {'waveform': 'sine', 'amplitude': AMPLITUDE, 'frequency': frequency},
        node: {**sections.get(node, {}), **gains},
    }
    return Experiment(sample_time, controller, parameters).run(0, round(duration / sample_time) + 1)


def track(
    controller: str,
    gains: Mapping[str, object],
    sections: Sections,
    sample_time: float,
    frequency: float,
    duration: float,
    transient: float,
) -> TrackingMetrics:
    """Return the metrics of a run of :func:`run_sine` after the transient [s]."""
    return metrics_of(run_sine(controller, gains, sections, sample_time, frequency, duration), transient)


def metrics_of(rows: SignalRows, transient: float, unit: float = NANOMETRES) -> TrackingMetrics:
    """Return the metrics of a run after the transient [s], with errors in ``unit``; see :func:`tracking_metrics`."""
    return tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient, unit)


class Steps:
    """
    Single steps from rest with the PID controller.

    Parameters
    ----------
    sections
        Parameters of drive, vibrometer and controller.
    sample_time
        T [s].
    """

    def __init__(self, sections: Sections, sample_time: float) -> None:
        self._ticks = round(_STEP_DURATION / sample_time) + 1
        self._own = sections.get('pid_controller', {})
        self._at_rest = [
            Experiment(
                sample_time,
                'pid',
                {
                    **bench_of(sections),
                    'reference_generator': {'waveform': 'step', 'amplitude': height, 'start_time': _STEP_TIME},
                    'pid_controller': self._own,
                },
            )
            for height in HEIGHTS
        ]

    def overshoot(self, gains: Mapping[str, object], limit: float = math.inf) -> float:
        """
        Return the largest overshoot of the true head position [% of the height]; infinity if the run fails.

        Parameters
        ----------
        gains
            Gains of the controller.
        limit
            Once the overshoot exceeds this limit, the remaining steps are skipped [%].
        """
        parameters: PidParameters = block_parameters('pid_controller', {**self._own, **gains})
        largest = 0.0
        for at_rest in self._at_rest:
            # Copying takes a third of the time of a new experiment, which checks its parameters; the rows are equal.
            experiment = copy.deepcopy(at_rest)
            experiment.update('pid_controller', {PidParameters: parameters})
            rows = experiment.run(0, self._ticks)
            if not np.isfinite(rows.head).all():
                return math.inf
            step = step_response(rows.time, rows.reference[:, 0], rows.head[:, 0])
            largest = max(largest, float(step.overshoot[0]))
            if largest > limit:
                break
        return largest


def bench_of(sections: Sections) -> dict[str, Mapping[str, object]]:
    """Return the sections of the drive and the vibrometer."""
    return {node: sections.get(node, {}) for node in ('vcm_plant', 'ldv_sensor')}
