"""Servo sensor and velocity observer in the loop, as a linear filter of position and command."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive
from hdd_servo_ros.control.observer import ObserverParameters, filter_matrices

Array = NDArray[np.float64]


class SampledObserver:
    """
    The velocity estimate of a controller, as a linear filter of measured position and held command.

    The position is the true one: noise, quantization and nonlinearity of the sensor and missing sectors are neglected.

    Parameters
    ----------
    parameters
        The observer.
    sample_time
        Sample time T [s].
    """

    def __init__(self, parameters: ObserverParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        matrices = filter_matrices(parameters, sample_time)
        self._transition, self._input, self._gains = matrices.transition, matrices.response[:, None], matrices.gains
        self._kept = np.eye(2) - self._gains[:, None] @ np.array([[1.0, 0.0]])

    def responses(self, frequencies: ArrayLike) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """
        Return the responses of the velocity to the position [1/s] and to the command held from its tick on [um/s/V].

        Parameters
        ----------
        frequencies
            Frequencies [Hz].
        """
        z = np.exp(2j * np.pi * np.asarray(frequencies, float) * self.sample_time)[:, None, None]
        remembered = np.eye(2) - self._kept @ self._transition / z
        inputs = np.concatenate([self._gains[:, None] + 0.0 * z, self._kept @ self._input / z], axis=2)
        velocity = np.asarray(np.linalg.solve(remembered, inputs)[:, 1], dtype=np.complex128) / self.sample_time
        return velocity[:, 0], velocity[:, 1]

    def after(self, drive: SampledDrive) -> SampledDrive:
        """Return a drive with this observer, whose outputs are position and velocity for the controller."""
        n = len(drive.a)
        position = drive.c[:1]
        corrected = np.hstack([self._gains[:, None] @ position, self._kept])
        a = np.zeros((n + 2, n + 2))
        a[:n, :n] = drive.a
        a[n:] = self._transition @ corrected
        b = self._input
        if drive.mean_voltage is not None:
            a[n:, :n] += self._input @ drive.mean_voltage[:, :-1]
            b = self._input * drive.mean_voltage[0, -1]
        c = np.zeros((2, n + 2))
        c[0, :n] = position
        c[1] = corrected[1] / self.sample_time
        return dataclasses.replace(drive, a=a, b=np.vstack([drive.b, b]), c=c, mean_voltage=None)
