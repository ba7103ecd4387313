"""
All closed loops of a sampled drive with stabilizing linear feedback, affine in a stable Q (Youla).

The controller is a state observer with state feedback. A stable filter Q of the innovations (measured minus expected
outputs) adds to its u. Every stabilizing controller has this form, and each closed-loop response is T1 + T2 Q T3. Boyd
and Barratt, Linear Controller Design, 1991, chapters 7 and 10.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive
from hdd_servo_ros.analysis.sampled_sensor import SampledSensor

Array = NDArray[np.float64]
Response = NDArray[np.complex128]

_BANDWIDTH = 0.08
"""Bandwidth of the initial controller as a fraction of the sampling frequency; Q corrects it."""


@dataclasses.dataclass(frozen=True)
class MeasuredDrive:
    """
    x_{k+1} = A x_k + b (u_k - f_k), true position p x_k, measured signals C x_k: drive, sensor and computation delay.

    Attributes
    ----------
    a, b
        Shapes (n, n) and (n, 1).
    position
        Output row of the true head position, shape (n,).
    measured
        One row per measured signal, shape (m, n); the first is the position.
    sample_time
        T [s].
    is_relative
        Whether the position is relative to the track center (servo sectors) or to the base (vibrometer).
    """

    a: Array
    b: Array
    position: Array
    measured: Array
    sample_time: float
    is_relative: bool = True

    @classmethod
    def of(
        cls,
        drive: SampledDrive,
        delay: int = 0,
        sensor: SampledSensor | None = None,
        *,
        has_velocity: bool = False,
        is_relative: bool = True,
    ) -> 'MeasuredDrive':
        """
        Return the model of a drive for feedback design.

        Parameters
        ----------
        drive
            The drive, with ideal outputs.
        delay
            Delay of u [samples]. It also delays the disturbance, which does not matter for a stationary process.
        sensor
            The vibrometer; None for an ideal one.
        has_velocity
            Whether the velocity is also measured.
        is_relative
            See the attribute.
        """
        seen = drive if sensor is None else sensor.after(drive)
        n = len(seen.a)
        a, b = np.zeros((n + delay, n + delay)), np.zeros((n + delay, 1))
        a[:n, :n] = seen.a
        if delay == 0:
            b[:n] = seen.b
        else:
            a[:n, [n]], b[-1] = seen.b, 1.0
            a[range(n, n + delay - 1), range(n + 1, n + delay)] = 1.0
        position, measured = np.zeros(n + delay), np.zeros((1 + has_velocity, n + delay))
        position[: len(drive.a)] = drive.c[0]
        measured[:, :n] = seen.c[: 1 + has_velocity]
        return cls(a, b, position, measured, drive.sample_time, is_relative)


@dataclasses.dataclass(frozen=True)
class Channel:
    """
    Response to one input on a grid of f frequencies: ``at_zero`` + ``from_correction`` Q ``innovations``.

    The shapes are (f,), (f,) and (f, m).
    """

    at_zero: Response
    from_correction: Response
    innovations: Response


class FeedbackResponses:
    """
    The affine closed-loop responses of a drive.

    Parameters
    ----------
    drive
        The drive.
    frequencies
        Frequency grid [Hz], shape (f,).

    Attributes
    ----------
    sensitivity
        Sensitivity S = 1/(1 + L), from a voltage added to u to the sum, for the loop opened at u.
    error_of_force
        Response of the position error [um] to the force f [V].
    error_of_track
        Response of the position error to the displacement of the track center [um/um].
    error_of_noise
        Response of the position error to the noise on each measured signal.
    """

    def __init__(self, drive: MeasuredDrive, frequencies: Array) -> None:
        self._drive = drive
        self._z = np.exp(2j * np.pi * frequencies * drive.sample_time)
        self._feedback, self._observer = _initial_controller(drive)
        n, m = len(drive.a), len(drive.measured)
        self._controlled, self._estimated = (
            drive.a + drive.b @ self._feedback,
            drive.a - self._observer @ drive.measured,
        )
        # Responses of the states to the correction, and to minus the estimation error.
        self._of_correction = self._resolvent(self._controlled, drive.b)[:, :, 0]
        nothing, none = np.zeros((n, 1)), np.zeros(m)
        self.sensitivity = self._channel(drive.b, none, self._feedback[0], 1.0, is_voltage=True)
        self.error_of_force = self._channel(-drive.b, none, drive.position, 0.0)
        seen = -np.eye(m)[0] if drive.is_relative else none
        self.error_of_track = self._channel(nothing, seen, drive.position, -1.0)
        self.error_of_noise = tuple(self._channel(nothing, unit, drive.position, 0.0) for unit in np.eye(m))

    def _resolvent(self, matrix: Array, right: Array) -> Response:
        shifted = self._z[:, None, None] * np.eye(len(matrix)) - matrix
        return np.asarray(np.linalg.solve(shifted, np.broadcast_to(right, (len(self._z), *right.shape))))

    def _channel(
        self, into_states: Array, into_measured: Array, out: Array, direct: float, *, is_voltage: bool = False
    ) -> Channel:
        """Return the response of the output ``out`` to an input; u is an output of the estimated states."""
        drive = self._drive
        kick = into_states - self._observer @ into_measured[:, None]
        error = self._resolvent(self._estimated, kick)
        innovations = error[:, :, 0] @ drive.measured.T + into_measured
        # (zI - A - BF) x = B_w w - B F (x - xh) + B v
        driven = into_states - drive.b @ (self._feedback @ error)
        states = np.linalg.solve(self._z[:, None, None] * np.eye(len(drive.a)) - self._controlled, driven)[:, :, 0]
        at_zero = direct + states @ out - (error[:, :, 0] @ out if is_voltage else 0.0)
        from_correction = self._of_correction @ out + (1.0 if is_voltage else 0.0)
        return Channel(at_zero, from_correction, innovations)


def _initial_controller(drive: MeasuredDrive) -> tuple[Array, Array]:
    """Return state feedback F and observer gain L of a stable loop, with bandwidths of :data:`_BANDWIDTH`."""
    from scipy.linalg import solve_discrete_are

    z = np.exp(2j * np.pi * _BANDWIDTH)
    at_bandwidth = np.linalg.solve(z * np.eye(len(drive.a)) - drive.a, drive.b)[:, 0]
    weight = np.array([[abs(drive.position @ at_bandwidth) ** 2]])
    cost = solve_discrete_are(drive.a, drive.b, np.outer(drive.position, drive.position), weight)
    feedback = -np.linalg.solve(drive.b.T @ cost @ drive.b + weight, drive.b.T @ cost @ drive.a)
    noise = np.diag(np.abs(drive.measured @ at_bandwidth) ** 2)
    spread = solve_discrete_are(drive.a.T, drive.measured.T, drive.b @ drive.b.T, noise)
    observer = drive.a @ spread @ drive.measured.T @ np.linalg.inv(drive.measured @ spread @ drive.measured.T + noise)
    return feedback, observer
