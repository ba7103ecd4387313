"""A sampled model of the drive and an ideal sensor, for constants that are computed before a run."""

from collections.abc import Sequence
from typing import Protocol

from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.numerics.transition import held_input_transition

NO_SCALES = SensorScales(0.0, 0.0)
"""Scales of a sensor without voltages, or without a controller that reads them."""


class RigidModel(Protocol):
    """A model of the drive in presliding, without its resonances."""

    @property
    def gain(self) -> float:
        """Acceleration of the head per volt [um/s^2/V]."""

    @property
    def stiffness(self) -> float:
        """Stiffness of the pivot friction [V/um]."""

    @property
    def viscous_coefficient(self) -> float:
        """Viscous coefficient of the pivot friction [V s/um]."""


class SampledModel:
    """
    A model of the drive with u held over each sample, initially at rest at 0, with a fixed order of operations.

    The states are position and velocity times T of the rigid body, then two per resonance: with (b2 s^2 + b1 s + b0)/
    (s^2 + a1 s + a0) = b2 + ((b1 - b2 a1) s + b0 - b2 a0)/(s^2 + a1 s + a0), the response q of the last fraction with a
    numerator of 1/T^2, and its derivative times T.

    Parameters
    ----------
    model
        The rigid body.
    numerators, denominators
        Coefficients b2, b1, b0 and a2, a1, a0 of the resonances in series, concatenated.
    sample_time
        Sample time T [s].
    """

    def __init__(
        self, model: RigidModel, numerators: Sequence[float], denominators: Sequence[float], sample_time: float
    ) -> None:
        self._sample_time, rate = sample_time, 1.0 / sample_time
        size = 2 + 2 * (len(numerators) // 3)
        dynamics = [[0.0] * size for _ in range(size)]
        dynamics[0][1] = rate
        dynamics[1][0] = -model.gain * model.stiffness * sample_time
        dynamics[1][1] = -model.gain * model.viscous_coefficient
        inputs = [0.0] * size
        inputs[1] = model.gain * sample_time
        shown = [0.0] * size
        shown[0] = 1.0
        for i in range(0, len(numerators), 3):
            a2, a1, a0 = denominators[i : i + 3]
            b2, b1, b0, a1, a0 = numerators[i] / a2, numerators[i + 1] / a2, numerators[i + 2] / a2, a1 / a2, a0 / a2
            q, rate_of_q = 2 + 2 * (i // 3), 3 + 2 * (i // 3)
            dynamics[q][rate_of_q] = rate
            dynamics[rate_of_q] = [value * rate for value in shown]
            dynamics[rate_of_q][q] -= a0 * sample_time
            dynamics[rate_of_q][rate_of_q] -= a1
            shown = [b2 * value for value in shown]
            shown[q] += (b0 - b2 * a0) * sample_time * sample_time
            shown[rate_of_q] += (b1 - b2 * a1) * sample_time
        self._position = shown
        # The velocity times T; it has no direct term of the voltage, which first changes the velocity of the body.
        columns = zip(*dynamics, strict=True)
        self._travel = [0.0, 1.0] if size == 2 else [_product(shown, column) * sample_time for column in columns]
        self._transition, self._response = held_input_transition(dynamics, inputs, sample_time)
        self._states = [0.0] * size

    def start(self, position: float, velocity: float) -> None:
        """Set position [um] and velocity [um/s] of the rigid body, with its resonances at rest."""
        self._states[:2] = position, velocity * self._sample_time

    def output(self) -> tuple[float, float]:
        """Return position [um] and velocity [um/s] of the head."""
        return _product(self._position, self._states), _product(self._travel, self._states) / self._sample_time

    def step(self, control: float) -> None:
        """Advance by one sample with a held voltage."""
        self._states = [
            _product(row, self._states) + response * control
            for row, response in zip(self._transition, self._response, strict=True)
        ]


def _product(row: Sequence[float], states: Sequence[float]) -> float:
    total = 0.0
    for factor, state in zip(row, states, strict=True):
        total += factor * state
    return total


def ideal_outputs(sensor: SensorScales, position: float, velocity: float) -> tuple[float, float]:
    """Return the outputs of an ideal sensor [V]; 0 for a sensor without scales."""
    return (
        position / sensor.displacement if sensor.displacement else 0.0,
        velocity / sensor.velocity if sensor.velocity else 0.0,
    )
