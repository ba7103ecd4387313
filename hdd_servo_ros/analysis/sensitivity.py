"""The linear loop around the sampled drive: the controller's response, peak sensitivity and closed-loop poles."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive, sampled_drive
from hdd_servo_ros.drive.plant import PlantParameters

MAX_SENSITIVITY = 2.0
"""Largest peak sensitivity Ms of a sound loop."""


def frequency_grid(sample_time: float) -> NDArray[np.float64]:
    """Return frequencies [Hz] from 3 Hz to just below Nyquist, dense where the sampled resonances lie."""
    nyquist = 0.5 / sample_time
    return np.concatenate(
        [np.geomspace(3.0, 0.2 * nyquist, 250, endpoint=False), np.linspace(0.2 * nyquist, 0.9999 * nyquist, 800)]
    )


@dataclasses.dataclass(frozen=True)
class LinearController:
    """
    u = -(k_p + k_i T z/(z - 1)) position - k_d F(z) velocity, with F a first-order low pass.

    -k r of (4.16) is k_p = k lambda, k_d = k; sigma_hat and m_hat, taken as constants, subtract sigma_hat from k_d and
    add m_hat lambda to it.
    """

    proportional: float
    derivative: float
    integral: float = 0.0
    bandwidth: float = 0.0
    """Corner frequency of F [Hz], 0 for F = 1."""
    delay: int = 0
    """Samples by which u comes late."""

    @classmethod
    def on_r(cls, gain: float, error_filter_lambda: float, integral_gain: float, delay: int = 0) -> 'LinearController':
        """Return u = -gain r [V s/um] for r = e' + lambda e + lambda_i int e dt."""
        return cls(gain * error_filter_lambda, gain, gain * integral_gain, delay=delay)

    def _smoothing(self, sample_time: float) -> float:
        return 1.0 - float(np.exp(-2.0 * np.pi * self.bandwidth * sample_time)) if self.bandwidth > 0.0 else 1.0

    def response(self, frequencies: ArrayLike, sample_time: float) -> NDArray[np.complex128]:
        """Return -u over position [V/um] and over velocity [V s/um], shape (len(frequencies), 2)."""
        z = np.exp(2j * np.pi * np.asarray(frequencies) * sample_time)
        smoothing = self._smoothing(sample_time)
        position = self.proportional + self.integral * sample_time * z / (z - 1.0)
        velocity = self.derivative * smoothing / (1.0 - (1.0 - smoothing) / z)
        return np.asarray(np.stack([position, velocity], axis=1) * (z**-self.delay)[:, None])

    def closed_loop_radius(self, drive: SampledDrive) -> float:
        """Return the largest magnitude of the closed loop's poles, below 1 if it is stable."""
        n = len(drive.a)
        smoothing = self._smoothing(drive.sample_time)
        # States: the drive, the integral of position, the filtered velocity, the late voltages.
        size = n + 2 + self.delay
        position, velocity = np.zeros(size), np.zeros(size)
        position[:n], velocity[:n] = drive.c[0], drive.c[1]
        integral, filtered = drive.sample_time * position, smoothing * velocity
        integral[n], filtered[n + 1] = 1.0, 1.0 - smoothing
        voltage = -(self.proportional * position + self.integral * integral + self.derivative * filtered)
        matrix = np.zeros((size, size))
        matrix[:n, :n] = drive.a
        # An integral that nothing uses would count as a pole at 1.
        matrix[n], matrix[n + 1] = (integral if self.integral > 0.0 else 0.0), filtered
        acting = voltage
        if self.delay > 0:
            acting = np.zeros(size)
            acting[n + 2] = 1.0
            for i in range(self.delay - 1):
                matrix[n + 2 + i, n + 3 + i] = 1.0
            matrix[size - 1] = voltage
        matrix[:n] += drive.b @ acting[None, :]
        return float(np.abs(np.linalg.eigvals(matrix)).max())


class LoopMargins:
    """
    Peak sensitivity and stability of a linear controller on one drive, in presliding and in sliding.

    The dynamics of the drive's driver are in the loop; the lag of a sensor is not.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    """

    def __init__(self, plant: PlantParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.rigid_gain = plant.rigid_gain
        self.frequencies = frequency_grid(sample_time)
        self.drives = tuple(sampled_drive(plant, sample_time, presliding) for presliding in (True, False))
        self.responses = tuple(drive.response(self.frequencies) for drive in self.drives)

    def peak_sensitivity(self, controller: LinearController) -> float:
        """Return Ms = max |1/(1 + L)| over frequency and over both drives; infinity if a closed loop is unstable."""
        law = controller.response(self.frequencies, self.sample_time)
        peaks = [float(np.abs(1.0 / (1.0 + (law * response).sum(axis=1))).max()) for response in self.responses]
        if max(controller.closed_loop_radius(drive) for drive in self.drives) >= 1.0:
            return float('inf')
        return max(peaks)
