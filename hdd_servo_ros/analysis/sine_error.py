"""Error of a linear controller on a sine, estimated without a run."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.analysis.sensitivity import LinearController
from hdd_servo_ros.drive.plant import PlantParameters

HARMONICS = 15
"""Number of harmonics of the reference that are used, if they are below Nyquist."""
_NOISE_FREQUENCIES = 500
"""Number of points of the integral over the noise."""


def command_harmonics(command: ArrayLike, frequency: float, sample_time: float) -> NDArray[np.float64]:
    """
    Return the amplitudes of the harmonics of a periodic command.

    Parameters
    ----------
    command
        Command u over an integer number of periods [V], shape (n,).
    frequency
        Frequency of the reference [Hz].
    sample_time
        Sample time T [s].

    Returns
    -------
    numpy.ndarray
        Amplitudes [V] at 1, 2, ... times the frequency: ``HARMONICS`` of them, or fewer up to Nyquist.
    """
    u = np.asarray(command, dtype=np.float64)
    multiples = np.arange(1, HARMONICS + 1) * frequency
    multiples = multiples[multiples < 0.5 / sample_time]
    waves = np.exp(-2j * np.pi * sample_time * np.outer(multiples, np.arange(len(u))))
    return np.abs(2.0 * waves @ u / len(u))


class SineErrors:
    """
    Estimator of the mean squared error of a linear controller on given sines.

    A linear controller C has the error e = -u/C. The u that a drive needs to follow a sine, including friction, hardly
    depends on the controller as long as it tracks, so that u is taken from one run. The motion due to sensor noise in
    sliding is added.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        Sample time T [s].
    commands
        Amplitudes of u for each sine, from :func:`command_harmonics`, by frequency [Hz].
    displacement_noise, velocity_noise
        White sensor noise per sample, rms [um], [um/s].
    """

    def __init__(
        self,
        plant: PlantParameters,
        sample_time: float,
        commands: Mapping[float, NDArray[np.float64]],
        displacement_noise: float,
        velocity_noise: float,
    ) -> None:
        self._sample_time = sample_time
        self._harmonics = {
            frequency: np.arange(1, len(amplitudes) + 1) * frequency for frequency, amplitudes in commands.items()
        }
        self._commands = commands
        self._noise = np.array([displacement_noise, velocity_noise])
        # Midpoints, so that their mean is the mean up to Nyquist.
        self._frequencies = (np.arange(_NOISE_FREQUENCIES) + 0.5) * 0.5 / (sample_time * _NOISE_FREQUENCIES)
        self._drive = sampled_drive(plant, sample_time, presliding=False).response(self._frequencies)

    def mean_squares(self, controller: LinearController) -> dict[float, float]:
        """Return the mean squared error [um^2] of a stable loop, by frequency."""
        noise = self._mean_square_of_noise(controller)
        return {frequency: noise + self._mean_square(controller, frequency) for frequency in self._commands}

    def _mean_square(self, controller: LinearController, frequency: float) -> float:
        multiples = self._harmonics[frequency]
        law = controller.response(multiples, self._sample_time)
        whole = law[:, 0] + 2j * np.pi * multiples * law[:, 1]
        return float(0.5 * np.sum((self._commands[frequency] / np.abs(whole)) ** 2))

    def _mean_square_of_noise(self, controller: LinearController) -> float:
        law = controller.response(self._frequencies, self._sample_time)
        moved = self._drive[:, 0] / (1.0 + (law * self._drive).sum(axis=1))
        return float((np.abs(moved[:, None] * law * self._noise) ** 2).sum(axis=1).mean())
