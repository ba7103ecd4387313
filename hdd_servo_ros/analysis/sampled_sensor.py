"""The vibrometer in the loop as a linear filter, computed from its step, and the measurement noise."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive
from hdd_servo_ros.bench.ldv import LDV, Ldv, LdvParameters
from hdd_servo_ros.bench.servo_sensor import ServoSensorParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.numerics.records import record

Array = NDArray[np.float64]


class SampledSensor:
    """
    The measured position and velocity of a controller, as a linear filter.

    Noise, output range, ADC and drop-outs are neglected, since they are not linear.

    Parameters
    ----------
    sensor
        The vibrometer.
    sample_time
        Sample time T [s].
    scales
        Sensor scales of the controller; None for those of the sensor.
    """

    def __init__(self, sensor: LdvParameters, sample_time: float, scales: SensorScales | None = None) -> None:
        self.sample_time = sample_time
        used = scales or SensorScales(sensor.displacement_scale, sensor.velocity_scale)
        gains = np.array([used.displacement / sensor.displacement_scale, used.velocity / sensor.velocity_scale])
        self._taps = _taps(sensor, sample_time) * gains[:, None]
        # Coefficients of the low pass y_k = decay y_{k-1} + last x_{k-1} + now x_k; zeros without a low pass.
        c = record(Ldv(sensor, sample_time).arrays[0], LDV)
        has_filter = c.filter_decay > 0.0
        self._decay, self._last = float(c.filter_decay), float(c.filter_last)
        self._now = float(c.filter_now) if has_filter else 1.0

    @property
    def is_ideal(self) -> bool:
        """Whether position and velocity are unchanged."""
        return len(self._taps) == 1 and bool(np.all(self._taps[0] == np.eye(2))) and self._decay == 0.0

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the response of measured to true position and velocity [Hz], shape (len(frequencies), 2, 2)."""
        z = np.exp(2j * np.pi * np.asarray(frequencies) * self.sample_time)
        powers = z[:, None] ** -np.arange(len(self._taps))
        low_pass = (self._now + self._last / z) / (1.0 - self._decay / z)
        return np.asarray(np.einsum('fk,kij->fij', powers, self._taps) * low_pass[:, None, None])

    def after(self, drive: SampledDrive) -> SampledDrive:
        """Return a drive with this sensor, whose outputs are the measured signals of the controller."""
        if self.is_ideal:
            return drive
        n, past = len(drive.a), len(self._taps) - 1
        # States: the drive, the motion of the previous ticks, and the low pass of both outputs.
        low_pass = n + 2 * past
        size = low_pass + 2 * (self._decay > 0.0)
        a, b, seen = np.zeros((size, size)), np.zeros((size, 1)), np.zeros((2, size))
        a[:n, :n], b[:n] = drive.a, drive.b
        seen[:, :n] = self._taps[0] @ drive.c
        for k in range(past):
            rows = slice(n + 2 * k, n + 2 * k + 2)
            seen[:, rows] = self._taps[k + 1]
            if k == 0:
                a[rows, :n] = drive.c
            else:
                a[rows, n + 2 * k - 2 : n + 2 * k] = np.eye(2)
        c = self._now * seen
        if self._decay > 0.0:
            c[:, low_pass:] = np.eye(2)
            a[low_pass:] = self._decay * c + self._last * seen
        return dataclasses.replace(drive, a=a, b=b, c=c)


def noise_densities(sensor: LdvParameters, sample_time: float, frequencies: ArrayLike) -> Array:
    """
    Return the one-sided spectral densities of the noise on measured position and velocity.

    Parameters
    ----------
    sensor
        The vibrometer; quantization by its ADC counts as white noise with 1/12 of the squared step.
    sample_time
        T [s].
    frequencies
        Frequencies [Hz], shape (f,).

    Returns
    -------
    ndarray
        Densities [um^2/Hz] and [(um/s)^2/Hz], shape (f, 2).
    """
    c = record(Ldv(sensor, sample_time).arrays[0], LDV)
    volts = np.array([c.displacement_noise, c.velocity_noise]) * c.has_noise
    z = np.exp(2j * np.pi * np.asarray(frequencies) * sample_time)
    shape = np.abs((c.noise_step if c.noise_decay > 0.0 else 1.0) / (1.0 - c.noise_decay / z)) ** 2
    scales = np.array([sensor.displacement_scale, sensor.velocity_scale])
    return np.asarray(2.0 * sample_time * scales**2 * (volts**2 * shape[:, None] + c.output.step**2 / 12.0))


def servo_noise_density(sensor: ServoSensorParameters, sample_time: float) -> float:
    """
    Return the one-sided density of the white noise on the position of a servo sensor [um^2/Hz].

    Quantization counts as white noise with 1/12 of the squared step. Nonlinearity and missing sectors are neglected.
    """
    step = sensor.track_pitch / 2.0**sensor.bits if sensor.bits else 0.0
    return 2.0 * sample_time * (sensor.noise**2 + step**2 / 12.0)


def _taps(sensor: LdvParameters, sample_time: float) -> Array:
    """Return the response to position and velocity k ticks ago, without the low pass, shape (k, 2, 2)."""
    plain = dataclasses.replace(
        sensor,
        displacement_scale=1.0,
        velocity_scale=1.0,
        noise=False,
        dropout_rate=0.0,
        demodulator_bandwidth=0.0,
        output_range=0.0,
        adc_bits=0,
    )
    columns = []
    for kick in np.eye(2):
        block = Ldv(plain, sample_time)
        block.step(0, 0.0, 0.0)
        motions = [kick, *np.zeros((len(block.history) - 1, 2))]
        columns.append([block.step(tick + 1, *motion) for tick, motion in enumerate(motions)])
    taps = np.array(columns).transpose(1, 2, 0)
    used = np.flatnonzero(taps.any(axis=(1, 2)))
    return np.asarray(taps[: used[-1] + 1])
