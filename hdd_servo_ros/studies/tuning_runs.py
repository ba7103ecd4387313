"""
The simulated runs by which controllers are tuned: sines, and steps from rest.

A search makes them one by one in its own process, since each depends on what came out of those before.
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
"""Of the sines [um]."""
FREQUENCIES = (100.0, 200.0)
"""Of the sines by which the PID controller is judged [Hz]."""
TRANSIENT = 2.0
"""What the tables leave out at the start of a run [s]."""
HEIGHTS = (5.0, 0.5)
"""Of the steps by which its overshoot is judged [um]."""
_STEP_TIME = 1e-3
"""When the steps come [s]."""
_STEP_DURATION = 0.05
"""Of a run on a step: enough for the largest overshoot [s]."""

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
    Run a 2 um sine with one controller.

    Parameters
    ----------
    controller
        ``'pid'`` or ``'adaptive_nn'``.
    gains
        Its parameters, over those in ``sections``.
    sections
        Parameters of drive, vibrometer and controller.
    sample_time
        T [s].
    frequency
        Of the sine [Hz].
    duration
        Of the run [s].
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
    """Return the metrics of a run of :func:`run_sine` from ``transient`` [s] on."""
    return metrics_of(run_sine(controller, gains, sections, sample_time, frequency, duration), transient)


def metrics_of(rows: SignalRows, transient: float, unit: float = NANOMETRES) -> TrackingMetrics:
    """Return the metrics of a run from ``transient`` [s] on, errors as of :func:`tracking_metrics` in ``unit``."""
    return tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient, unit)


class Steps:
    """
    Lone steps from rest with the PID controller.

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
        Return the largest overshoot of the head's true position [% of the height]; infinity if the run fails.

        Parameters
        ----------
        gains
            Of the controller.
        limit
            Beyond it, the steps that are left are not run.
        """
        parameters: PidParameters = block_parameters('pid_controller', {**self._own, **gains})
        largest = 0.0
        for at_rest in self._at_rest:
            # A copy takes a third of the time of a new one, whose parameters are checked; both make the same rows.
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
    """Return the sections of drive and vibrometer."""
    return {node: sections.get(node, {}) for node in ('vcm_plant', 'ldv_sensor')}
