"""An identified transfer function: zeros, poles, leading gain, and modes."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

ComplexArray = NDArray[np.complex128]


@dataclasses.dataclass(frozen=True)
class Mode:
    """
    A pole with its partial fraction r/(s - p); a complex pole represents its pair.

    Attributes
    ----------
    pole
        Pole p [rad/s].
    residue
        Residue r, in the unit of the response times rad/s.
    """

    pole: complex
    residue: complex

    @property
    def frequency(self) -> float:
        """Natural frequency ``|p|/(2 pi)`` [Hz]."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio ``-Re p/|p|``; 1 for a real stable pole, 0 for an integrator, negative for an unstable pole."""
        return -self.pole.real / abs(self.pole) if self.pole else 0.0


@dataclasses.dataclass(frozen=True)
class Model:
    """
    A transfer function with zeros, poles and leading gain, as in ``scipy.signal.ZerosPolesGain``.

    Attributes
    ----------
    zeros, poles
        Complex zeros and poles [rad/s], shapes (m,) and (n,); integrators are poles at 0 and come first.
    leading
        Leading gain b_m/a_n (thesis eq. 3.21).
    error
        Root mean square over the points of ``|fit - data|/deviation``: 0.01 is 1 % if the deviation is the magnitude.

    Examples
    --------
    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import Model
    >>> model = Model(zeros=np.array([]), poles=np.array([0.0, -10.0]), leading=20.0, error=0.0)
    >>> f'{abs(model.response(1.0)):.3f}', model.rigid_gain(1)
    ('0.270', 2.0)
    """

    zeros: ComplexArray
    poles: ComplexArray
    leading: float
    error: float

    def response(self, frequency: ArrayLike) -> ComplexArray:
        """Return the response at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        value = np.full(s.shape, complex(self.leading))
        # Alternating factors, so that no intermediate product overflows a float64.
        for i, pole in enumerate(self.poles):
            value = value / (s - pole)
            if i < len(self.zeros):
                value = value * (s - self.zeros[i])
        return value

    def rigid_gain(self, order: int = 2) -> float:
        """
        Return the gain K of the rigid body in K/s^2 R(s) with R(0) = 1.

        Parameters
        ----------
        order
            Number of the smallest poles that belong to the rigid body: 2 for a double integrator, with or without a
            spring; 0 gives the static gain.
        """
        modes = self.poles[np.argsort(np.abs(self.poles), kind='stable')][order:]
        return float((self.leading * np.prod(-self.zeros) / np.prod(-modes)).real)

    def modes(self) -> list[Mode]:
        """Return the real poles and those in the upper half plane by frequency, without integrators."""
        found = []
        for i, pole in enumerate(self.poles):
            if pole == 0.0 or pole.imag < 0.0:
                continue
            residue = self.leading * np.prod(pole - self.zeros) / np.prod(pole - np.delete(self.poles, i))
            found.append(Mode(complex(pole), complex(residue)))
        return sorted(found, key=lambda mode: mode.frequency)
