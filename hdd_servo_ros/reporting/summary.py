"""A run in a few lines."""

from pathlib import Path
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.metrics import tracking_metrics
from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.reporting.saturation import saturation_line

NOT_ADAPTED = ('t', 'r', 'e')
"""What stands among the estimates without being one: time and errors."""
SIGNAL_ANALYZER = 'signal_analyzer'
OPEN_LOOP = ('open_loop', SIGNAL_ANALYZER)
"""Controllers with which the head is to follow nothing: there is no error."""
LONGEST_TRANSIENT = 2.0
"""What counts as transient in a long run [s]; in a short one it is the first half."""


def transient_of(duration: float) -> float:
    """Return the time before which errors do not count [s]."""
    return min(0.5 * duration, LONGEST_TRANSIENT)


def summary(signals: Signals, run: dict[str, Any], directory: Path) -> str:
    """
    Return the summary of a run.

    Parameters
    ----------
    signals
        From :func:`read_signals`.
    run
        Content of ``run.yaml``.
    directory
        Where the run lies.
    """
    length, volt = run.get('length_unit', 'um'), run.get('control_unit', 'V')
    error_unit, factor = ('nm', 1e3) if length == 'um' else (length, 1.0)
    duration = float(signals.time[-1])
    metrics = tracking_metrics(
        signals.time,
        signals.reference[:, 0],
        signals.head[:, 0],
        signals.control[:, 0],
        transient=transient_of(duration),
        unit=factor,
    )
    ticks = len(signals.time)
    lines = [
        ('run', f'{run["status"]}' + (f': {run["reason"]}' if run['reason'] else '')),
        ('controller', f'{run["controller"]}, drive {run["frame_id"]}'),
        (
            'tracking error',
            f'{metrics.rms_error:.4g} {error_unit} rms, {metrics.max_error:.4g} {error_unit} max '
            f'(after {metrics.transient:g} s)',
        ),
        ('peak control', f'{metrics.peak_control:.4g} {volt}'),
        ('estimates', _estimates(signals) + ' (at the end)'),
        ('ticks', f'{ticks} of {run["sample_time"]:g} s, 0 to {ticks - 1}'),
        ('messages', f'{ticks * len(LOOP_TOPICS)} on {len(LOOP_TOPICS)} topics, {ticks} each'),
    ]
    if run['controller'] in OPEN_LOOP:
        lines = [line for line in lines if line[0] != 'tracking error']
    saturation = saturation_line(signals, run)
    if saturation:
        lines.append(('saturation', saturation))
    if run.get('real_time_factor'):
        lines.append(('real-time factor', f'{run["real_time_factor"]:.3g}'))
    lines.append(('run folder', str(directory)))
    width = max(len(name) for name, _ in lines)
    return '\n'.join(f'{name:>{width}}  {text}' for name, text in lines)


def _estimates(signals: Signals) -> str:
    shown = [
        f'{name} {values[-1]:.4g}'
        for name, values in signals.estimates.items()
        if name not in NOT_ADAPTED and np.any(values != values[0])
    ]
    return ', '.join(shown) or 'none'
