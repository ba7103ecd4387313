"""
The sampled drive as the controller drives it, where the command is filtered or changes within a sample.

The drive is linearized with the shorter sample time of the updates, and the updates of a sample are combined into one
step (lifting). The result is again a drive with one input per sample.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive, sampled_drive
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.bench.output_filters import OutputFilters
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
    if dsp is None or not dsp.is_filtered:
        return sampled_drive(plant, sample_time, presliding)
    count = dsp.updates_per_sample
    if count > 1:
        plant = dataclasses.replace(plant, substeps=multirate_substeps(plant.substeps_at(sample_time)) // count)
    fast = sampled_drive(plant, sample_time / count, presliding)
    filters = OutputFilters(dsp.filters, sample_time / count)
    return lifted(fast, filters.sos, count, is_linear=dsp.is_interpolated)


def lifted(fast: SampledDrive, sos: Array, count: int, *, is_linear: bool) -> SampledDrive:
    """
    Return a drive downstream of filters over a sample of ``count`` updates.

    Parameters
    ----------
    fast
        The drive with the sample time of the updates.
    sos
        Second-order sections of the filters, as of scipy.signal, shape (m, 6).
    count
        Updates per sample.
    is_linear
        Whether the controller voltage is reached in equal steps from the last one, instead of held.
    """
    n, m = len(fast.a), 2 * len(sos)
    # States: the drive, two per section, and with interpolation the controller voltage of the last sample. Each signal
    # is a row over the states at the start of the sample and the controller voltage.
    size = n + m + is_linear
    rows = np.eye(size, size + 1)
    drive, memories = rows[:n], rows[n : n + m].reshape(-1, 2, size + 1)
    voltage = np.eye(1, size + 1, size)
    previous = np.eye(1, size + 1, size - 1) if is_linear else voltage
    total = np.zeros((1, size + 1))
    for i in range(count):
        signal = previous + (i + 1) / count * (voltage - previous)
        for memory, (b0, b1, b2, _, a1, a2) in zip(memories, sos.tolist(), strict=True):
            output = b0 * signal + memory[0]
            memory[0], memory[1] = b1 * signal - a1 * output + memory[1], b2 * signal - a2 * output
            signal = output
        total = total + signal
        drive = fast.a @ drive + fast.b @ signal
    following = np.vstack([drive, memories.reshape(-1, size + 1), *([voltage] if is_linear else [])])
    return SampledDrive(
        following[:, :size],
        following[:, size:],
        np.hstack([fast.c, np.zeros((len(fast.c), size - n))]),
        fast.sample_time * count,
        total / count,
    )
