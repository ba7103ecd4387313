"""Recorded acceleration from a CSV file, resampled to the ticks of a run."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.table import read_table
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.parameters import ParameterError

INTERPOLATIONS = ('linear', 'hold')

LONGEST = 86_400.0
"""Longest recording [s]; it is kept in memory at the sample time of the run."""
_SLACK = 1e-9
"""Tolerance of a recorded time, as a fraction of a sample."""


def read_recording(parameter: str, path: str, quantity: str) -> NDArray[np.float64]:
    """
    Return times [s] and accelerations from a CSV file, shape (n, 2).

    Parameters
    ----------
    parameter
        Name of the parameter with the path, for error messages.
    path
        CSV file with the columns time and acceleration; the times must increase.
    quantity
        Quantity of the second column with its unit, for error messages.

    Raises
    ------
    ParameterError
        If the file cannot be read, or has fewer than two rows, a non-finite number, or times that do not increase.
    """
    rows = read_table(parameter, path, ['time [s]', quantity], 2)
    for number, (before, after) in enumerate(itertools.pairwise(rows), start=2):
        if not after[0] > before[0]:
            allowed = f'a CSV file with increasing times; row {number} has {after[0]!r} s after {before[0]!r} s'
            raise ParameterError(parameter, path, allowed)
    span = rows[-1][0] - rows[0][0]
    if not span <= LONGEST:
        raise ParameterError(parameter, path, f'a recording of at most {LONGEST:g} s; its duration is {span:g} s')
    return np.array(rows)


def at_ticks(recording: NDArray[np.float64], interpolation: str, sample_time: float) -> NDArray[np.float64]:
    """
    Return a recording resampled at T [s], from its first time up to its last time.

    Parameters
    ----------
    recording
        Times [s] and accelerations, shape (n, 2).
    interpolation
        ``linear`` interpolates between two rows; ``hold`` uses the last row that is not later.
    sample_time
        T [s].
    """
    span = float(recording[-1, 0]) - float(recording[0, 0])
    samples = np.zeros(math.floor(span / sample_time + _SLACK) + 1)
    _sample(recording, interpolation == 'linear', sample_time, samples)
    return samples


@compiled
def _sample(recording: NDArray[np.float64], is_linear: bool, sample_time: float, samples: NDArray[np.float64]) -> None:
    row = 0
    last = len(recording) - 1
    for i in range(len(samples)):
        time = recording[0, 0] + float(i) * sample_time
        while row < last and recording[row + 1, 0] <= time + _SLACK * sample_time:
            row += 1
        samples[i] = recording[row, 1]
        if is_linear and row < last:
            part = (time - recording[row, 0]) / (recording[row + 1, 0] - recording[row, 0])
            samples[i] += max(part, 0.0) * (recording[row + 1, 1] - recording[row, 1])
