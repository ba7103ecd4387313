"""The linear loop of a sampled drive and a controller: response, peak sensitivity and closed-loop poles."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.command_path import driven_by
from hdd_servo_ros.analysis.sampled_drive import SampledDrive, has_presliding_spring
from hdd_servo_ros.analysis.sampled_observer import SampledObserver
from hdd_servo_ros.analysis.sampled_sensor import SampledSensor
from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.observer import ObserverParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales

MAX_SENSITIVITY = 2.0
"""Largest peak sensitivity Ms with a sufficient stability margin."""
AROUND_POLES = np.array([-30.0, -10.0, -4.0, -2.0, -1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0, 2.0, 4.0, 10.0, 30.0])
"""Distances of grid points from a resonance, in half widths."""
REFINEMENTS = 2
"""Number of refinements of the interval around the highest point, each by a factor of sixteen."""


def frequency_grid(sample_time: float, drives: Sequence[SampledDrive] = ()) -> NDArray[np.float64]:
    """
    Return frequencies [Hz] up to Nyquist, dense in the usual range of resonances and around those of ``drives``.

    A mode above Nyquist is included at its aliased frequency.
    """
    nyquist = 0.5 / sample_time
    low = np.geomspace(1e-5 * nyquist, 0.2 * nyquist, 300, endpoint=False)
    around = [_around_poles(drive.poles, sample_time) for drive in drives]
    return np.unique(np.concatenate([low, np.linspace(0.2 * nyquist, nyquist, 800), *around]))


def _around_poles(poles: NDArray[np.complex128], sample_time: float) -> NDArray[np.float64]:
    """Return frequencies [Hz] around the resonance of each pole pair, spaced by its width."""
    upper = poles[poles.imag > 0.0]
    logarithms = np.log(upper) / (2.0 * np.pi * sample_time)
    around = logarithms.imag[:, None] + np.abs(logarithms.real)[:, None] * AROUND_POLES
    return np.asarray(around[(around > 0.0) & (around <= 0.5 / sample_time)])


def _on_circle(frequencies: ArrayLike, sample_time: float) -> NDArray[np.complex128]:
    """Return z = exp(2 pi i f T) of frequencies [Hz]."""
    return np.asarray(np.exp(2j * np.pi * np.asarray(frequencies) * sample_time))


def _neighbors(best: float, grid: NDArray[np.float64], others: NDArray[np.float64]) -> tuple[float, float]:
    """Return the next lower and the next higher frequency, or ``best`` at the ends."""
    # ``grid`` is sorted, ``others`` are not.
    at = int(np.searchsorted(grid, best))
    past = int(np.searchsorted(grid, best, side='right'))
    low = grid[at - 1] if at > 0 else best
    high = grid[past] if past < len(grid) else best
    below, above = others[others < best], others[others > best]
    return float(max(low, below.max(initial=low))), float(min(high, above.min(initial=high)))


def _eigenvalues(matrices: NDArray[np.float64]) -> NDArray[np.complex128]:
    # numpy returns a real array if all eigenvalues are real.
    return np.asarray(np.linalg.eigvals(matrices), dtype=np.complex128)


@dataclasses.dataclass(frozen=True)
class LinearController:
    """
    u = -(k_p + k_i T z/(z - 1)) position - k_d F(z) velocity, with F a first-order low pass.

    The feedback term -k r (thesis eq. 4.16) has k_p = k lambda and k_d = k. Constant estimates subtract sigma_hat from
    k_d and add m_hat lambda to it.
    """

    proportional: float
    derivative: float
    integral: float = 0.0
    bandwidth: float = 0.0
    """Corner frequency of F [Hz]; 0 for F = 1."""
    delay: int = 0
    """Delay of u [samples]."""
    difference: bool = False
    """Whether the velocity is the position difference over T instead of the velocity of the sensor."""

    @classmethod
    def on_r(cls, gain: float, error_filter_lambda: float, integral_gain: float, delay: int = 0) -> 'LinearController':
        """Return u = -gain r [V s/um] for r = e' + lambda e + lambda_i int e dt."""
        return cls(gain * error_filter_lambda, gain, gain * integral_gain, delay=delay)

    def _smoothing(self, sample_time: float) -> float:
        return 1.0 - float(np.exp(-2.0 * np.pi * self.bandwidth * sample_time)) if self.bandwidth > 0.0 else 1.0

    def response(self, frequencies: ArrayLike, sample_time: float) -> NDArray[np.complex128]:
        """Return -u over position [V/um] and over velocity [V s/um], shape (len(frequencies), 2)."""
        return self.response_at(_on_circle(frequencies, sample_time), sample_time)

    def response_at(self, z: NDArray[np.complex128], sample_time: float) -> NDArray[np.complex128]:
        """Return the result of :meth:`response` at points z = exp(2 pi i f T) of the unit circle."""
        smoothing = self._smoothing(sample_time)
        position = self.proportional + self.integral * sample_time * z / (z - 1.0)
        velocity = self.derivative * smoothing / (1.0 - (1.0 - smoothing) / z)
        if self.difference:
            position = position + velocity * (1.0 - 1.0 / z) / sample_time
            velocity = np.zeros_like(velocity)
        response = np.empty((len(z), 2), dtype=np.complex128)
        response[:, 0], response[:, 1] = position, velocity
        if self.delay > 0:
            response *= (z**-self.delay)[:, None]
        return response

    @property
    def is_meaningful(self) -> bool:
        """Whether its gains are usable numbers; those of a diverged run may not be."""
        return all(abs(gain) < 1e100 for gain in (self.proportional, self.derivative, self.integral))

    def closed_loop(self, drive: SampledDrive) -> NDArray[np.float64]:
        """Return the state matrix of the closed loop."""
        n, sample_time = len(drive.a), drive.sample_time
        smoothing = self._smoothing(sample_time)
        # States: the drive, the integral of position, the filtered velocity, the last position, the delayed voltages.
        size = n + 3 + self.delay
        position, velocity = np.zeros(size), np.zeros(size)
        position[:n], velocity[:n] = drive.c[0], drive.c[1]
        if self.difference:
            velocity = position / sample_time
            velocity[n + 2] = -1.0 / sample_time
        integral, filtered = sample_time * position, smoothing * velocity
        integral[n], filtered[n + 1] = 1.0, 1.0 - smoothing
        voltage = -(self.proportional * position + self.integral * integral + self.derivative * filtered)
        matrix = np.zeros((size, size))
        matrix[:n, :n] = drive.a
        # An unused integrator would be a pole at 1.
        matrix[n], matrix[n + 1] = (integral if self.integral != 0.0 else 0.0), filtered
        matrix[n + 2] = position if self.difference else 0.0
        acting = voltage
        if self.delay > 0:
            acting = np.zeros(size)
            acting[n + 3] = 1.0
            for i in range(self.delay - 1):
                matrix[n + 3 + i, n + 4 + i] = 1.0
            matrix[size - 1] = voltage
        matrix[:n] += drive.b @ acting[None, :]
        return matrix

    def closed_loop_radius(self, drive: SampledDrive) -> float:
        """Return the largest magnitude of the closed-loop poles, below 1 if the loop is stable."""
        return float(np.abs(_eigenvalues(self.closed_loop(drive))).max())


class LoopMargins:
    """
    Peak sensitivity and stability of a linear controller with one drive, in presliding and in sliding.

    The loop includes the dynamics of the driver and, if given, of the sensor, as integrated in a run. The computation
    delay and the source of the velocity are properties of the controller.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    sensor
        The vibrometer; None for an ideal sensor.
    scales
        Sensor scales of the controller; None for those of the sensor.
    observer
        Velocity observer of a run with the servo sensor (without ``sensor``). It is a part of the controller, since it
        uses the command.
    dsp
        Command path, of which filters and updates count; None for a command that is held over the sample.

    Attributes
    ----------
    drives
        Drive with sensor, linearized in presliding, where the friction is a spring, and in sliding.
    frequencies, on_circle, responses
        Grid [Hz], z = exp(2 pi i f T), and the responses of measured position [um/V] and velocity [um/s/V] to u.
    """

    def __init__(
        self,
        plant: PlantParameters,
        sample_time: float,
        sensor: LdvParameters | None = None,
        scales: SensorScales | None = None,
        observer: ObserverParameters | None = None,
        dsp: DspParameters | None = None,
    ) -> None:
        self.sample_time = sample_time
        self.rigid_gain = plant.rigid_gain
        states = (True, False) if has_presliding_spring(plant.friction) else (False,)
        self._bare = tuple(driven_by(plant, sample_time, presliding, dsp) for presliding in states)
        found = None if sensor is None else SampledSensor(sensor, sample_time, scales)
        self._sensor = None if found is None or found.is_ideal else found
        self._observer = None if observer is None else SampledObserver(observer, sample_time)
        seen_by = self._sensor or self._observer
        self.drives = tuple(drive if seen_by is None else seen_by.after(drive) for drive in self._bare)
        self.frequencies = frequency_grid(sample_time, self._bare)
        self.on_circle = _on_circle(self.frequencies, sample_time)
        self.responses = tuple(self._response(drive, self.frequencies) for drive in self._bare)

    def _response(self, drive: SampledDrive, frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
        response = drive.response(frequencies)
        if self._observer is not None:
            of_position, _ = self._observer.responses(frequencies)
            return np.asarray(response[:, :1] * np.stack([np.ones_like(of_position), of_position], axis=1))
        if self._sensor is None:
            return response
        return np.asarray((self._sensor.response(frequencies) @ response[:, :, None])[:, :, 0])

    def loop_gain(
        self, controller: LinearController, index: int, frequencies: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the loop gain L with the drive ``drives[index]`` at frequencies [Hz], shape (len(frequencies),)."""
        law = controller.response(frequencies, self.sample_time)
        loop = (law * self._response(self._bare[index], frequencies)).sum(axis=1)
        return np.asarray(loop / self._through(law, frequencies))

    def sensitivity(
        self, controller: LinearController, index: int, frequencies: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the sensitivity S of the position with the drive ``drives[index]``, shape (len(frequencies),)."""
        return np.asarray(1.0 / (1.0 + self.loop_gain(controller, index, frequencies)))

    def path(
        self, controller: LinearController, index: int, frequencies: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """
        Return the response of the measured position to a voltage that is added to the controller output [um/V].

        The voltage is delayed like the command, by ``controller.delay`` samples.
        """
        law = controller.response(frequencies, self.sample_time)
        response = self._response(self._bare[index], frequencies)
        late = _on_circle(frequencies, self.sample_time) ** -controller.delay
        return np.asarray(late * response[:, 0] / (self._through(law, frequencies) + (law * response).sum(axis=1)))

    def _own_command(self, frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the part of the velocity estimate that is due to the command, shape (n, 2) like the responses."""
        own = np.zeros((len(frequencies), 2), dtype=np.complex128)
        if self._observer is not None:
            own[:, 1] = self._observer.responses(frequencies)[1] * self._bare[0].mean_voltage_response(frequencies)
        return own

    def peak_sensitivity(self, controller: LinearController, limit: float = math.inf) -> float:
        """
        Return Ms = ``max |1/(1 + L)|`` over frequency and both drives; infinity if a closed loop is unstable.

        Parameters
        ----------
        controller
            The controller.
        limit
            The first value above it is returned instead of the peak.
        """
        if not controller.is_meaningful:
            return math.inf
        return self._peak(controller, [_eigenvalues(controller.closed_loop(drive)) for drive in self.drives], limit)

    def _peak(self, controller: LinearController, poles: Sequence[NDArray[np.complex128]], limit: float) -> float:
        if max(float(np.abs(found).max()) for found in poles) >= 1.0:
            return math.inf
        law = controller.response_at(self.on_circle, self.sample_time)
        peak = 0.0
        for drive, response, found in zip(self._bare, self.responses, poles, strict=True):
            # nan is propagated and exceeds any limit.
            on_grid = self._sensitivity(law, response, self.frequencies)
            peak = float(np.maximum(peak, self._peak_of(controller, on_grid, drive, found, limit)))
            if peak > limit:
                break
        return peak

    def _peak_of(
        self,
        controller: LinearController,
        values: NDArray[np.float64],
        drive: SampledDrive,
        poles: NDArray[np.complex128],
        limit: float,
    ) -> float:
        """
        Return the peak of one drive: on the grid, around the closed-loop resonances, and refined around the highest.

        ``values`` are ``|S|`` on the grid.
        """

        def sensitivity(frequencies: NDArray[np.float64]) -> NDArray[np.float64]:
            law = controller.response(frequencies, self.sample_time)
            return self._sensitivity(law, self._response(drive, frequencies), frequencies)

        around = _around_poles(poles, self.sample_time)
        near = sensitivity(around)
        on_grid, in_near = int(np.argmax(values)), int(np.argmax(near)) if len(around) else -1
        best, peak = self.frequencies[on_grid], values[on_grid]
        if in_near >= 0 and near[in_near] > peak:
            best, peak = around[in_near], near[in_near]
        low, high = _neighbors(float(best), self.frequencies, around)
        for _ in range(REFINEMENTS):
            if peak > limit:
                break
            finer = np.linspace(low, high, 17)
            frequencies, values = np.append(finer, best), np.append(sensitivity(finer), peak)
            order = np.argsort(frequencies)
            frequencies, values = frequencies[order], values[order]
            at = int(np.argmax(values))
            best, peak = frequencies[at], values[at]
            low, high = frequencies[max(at - 1, 0)], frequencies[min(at + 1, len(frequencies) - 1)]
        return float(peak)

    def _sensitivity(
        self, law: NDArray[np.complex128], response: NDArray[np.complex128], frequencies: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Return ``|S|`` of the position.

        With -u = C_x x + C_v (F x + G u) the controller is (C_x + C_v F)/(1 + C_v G).
        """
        loop = (law * response).sum(axis=1)
        if self._observer is None:
            return np.asarray(1.0 / np.abs(1.0 + loop))
        through = self._through(law, frequencies)
        return np.asarray(np.abs(through / (through + loop)))

    def _through(self, law: NDArray[np.complex128], frequencies: NDArray[np.float64]) -> Any:
        """Return 1 + C_v G, the feedback of the command through the observer; 1 without an observer."""
        if self._observer is None:
            return 1.0
        return 1.0 + (law * self._own_command(frequencies)).sum(axis=1)

    def peak_sensitivities(self, controllers: Sequence[LinearController]) -> NDArray[np.float64]:
        """
        Return Ms of many controllers at once, like :meth:`peak_sensitivity` but only on the grid.

        They may differ only in their gains. Check the highest with :meth:`peak_sensitivity`.

        Raises
        ------
        ValueError
            If other parameters differ.
        """
        if len({dataclasses.replace(law, proportional=0.0, derivative=0.0, integral=0.0) for law in controllers}) > 1:
            raise ValueError('the controllers may differ only in k_p, k_d and k_i')
        peaks = np.full(len(controllers), np.inf)
        used = [index for index, controller in enumerate(controllers) if controller.is_meaningful]
        if used:
            peaks[used] = self._peaks_on_grid([controllers[index] for index in used])
        return peaks

    def _peaks_on_grid(self, controllers: Sequence[LinearController]) -> NDArray[np.float64]:
        gains = np.array([(law.proportional, law.derivative, law.integral) for law in controllers])
        # The loop is linear in the gains.
        none = dataclasses.replace(controllers[0], proportional=0.0, derivative=0.0, integral=0.0)
        units = (
            dataclasses.replace(none, proportional=1.0),
            dataclasses.replace(none, derivative=1.0),
            dataclasses.replace(none, integral=1.0),
        )
        laws = np.array([unit.response_at(self.on_circle, self.sample_time) for unit in units])
        peaks = np.zeros(len(controllers))
        for drive, response in zip(self.drives, self.responses, strict=True):
            matrices = np.array([controller.closed_loop(drive) for controller in controllers])
            radii = np.abs(_eigenvalues(matrices)).max(axis=1)
            differences = 1.0 + gains @ (laws * response).sum(axis=2)
            if self._observer is not None:
                own = gains @ (laws * self._own_command(self.frequencies)).sum(axis=2)
                differences = 1.0 + (differences - 1.0) / (1.0 + own)
            on_grid = (differences.real**2 + differences.imag**2).min(axis=1) ** -0.5
            peaks = np.maximum(peaks, np.where(radii < 1.0, on_grid, np.inf))
        return peaks
