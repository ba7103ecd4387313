"""
The sampled drive as the controller drives it, where the command changes within a sample.

The drive is linearized with the shorter sample time of the updates, and the updates of a sample are combined into one
step (lifting). The result is again a drive with one input per sample.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive, sampled_drive
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.drive.plant import PlantParameters, multirate_substeps

Array = NDArray[np.float64]


def driven_by(plant: PlantParameters, sample_time: float, presliding: bool, dsp: DspParameters | None) -> SampledDrive:
    """
    Return the linearized drive with the controller voltage as its input.

    Parameters
    ----------
    plant
        Parameters of the drive.
    sample_time
        T [s].
    presliding
        See :func:`~hdd_servo_ros.analysis.sampled_drive.sampled_drive`.
    dsp
        Command path; None for a command that is held over the sample. Delay, saturation and quantization are left out.
    """
    if dsp is None or not dsp.is_interpolated:
        return sampled_drive(plant, sample_time, presliding)
    count = dsp.updates_per_sample
    substeps = multirate_substeps(plant.substeps_at(sample_time)) // count
    fast = sampled_drive(dataclasses.replace(plant, substeps=substeps), sample_time / count, presliding)
    return lifted(fast, count)


def lifted(fast: SampledDrive, count: int) -> SampledDrive:
    """
    Return a drive over a sample of ``count`` updates, in equal steps to the controller voltage.

    Parameters
    ----------
    fast
        The drive with the sample time of the updates.
    count
        Updates per sample.
    """
    n = len(fast.a)
    # States: the drive, and the controller voltage of the last sample.
    a, b = np.eye(n, n + 1), np.zeros((n, 1))
    mean = np.zeros((1, n + 2))
    for i in range(count):
        part = (i + 1) / count
        a = fast.a @ a
        a[:, n:] += (1.0 - part) * fast.b
        b = fast.a @ b + part * fast.b
        mean[0, n] += (1.0 - part) / count
        mean[0, n + 1] += part / count
    return SampledDrive(
        np.vstack([a, np.zeros((1, n + 1))]),
        np.vstack([b, np.ones((1, 1))]),
        np.hstack([fast.c, np.zeros((len(fast.c), 1))]),
        fast.sample_time * count,
        mean,
    )
