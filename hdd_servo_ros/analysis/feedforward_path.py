"""The path from a feedforward to the tracking error, from a model of the drive and the very blocks of the loop."""

import dataclasses
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.feedforward import AccelerometerScales
from hdd_servo_ros.control.feedforward_parameters import FeedforwardParameters
from hdd_servo_ros.control.observer import Observer
from hdd_servo_ros.control.runout import path_length
from hdd_servo_ros.control.runout_parameters import RunoutParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales
from hdd_servo_ros.numerics.transition import held_input_transition

NO_SCALES = SensorScales(0.0, 0.0)
"""Of a sensor without voltages, or where no controller reads them."""
_PULSE = 1e-3
"""Height of the pulse [V]: small, so that what adapts in the controller hardly does."""


class RigidModel(Protocol):
    """A model of the drive in presliding, without its resonances."""

    @property
    def gain(self) -> float:
        """Acceleration of the head per volt [um/s^2/V]."""

    @property
    def stiffness(self) -> float:
        """Of the pivot's friction [V/um]."""

    @property
    def viscous_coefficient(self) -> float:
        """Of the pivot's friction [V s/um]."""


def feedforward_knowledge(
    parameters: FeedforwardParameters,
    controller: Controller,
    dsp: DspParameters,
    accelerometer: AccelerometerParameters,
    sample_time: float,
    sensor: SensorScales = NO_SCALES,
    observer: Observer | None = None,
) -> tuple[NDArray[np.float64], AccelerometerScales]:
    """
    Return what a feedforward has to know beside its parameters: the path, and how it reads the sensors.

    Parameters
    ----------
    parameters
        The feedforward's; scales that they do not give are those of the sensors.
    controller
        A controller at rest, made for this alone; it is stepped.
    dsp, accelerometer
        What lies behind the controller, and the sensors.
    sample_time
        T [s].
    sensor
        Scales of the sensor, for a controller that reads its voltages.
    observer
        What gives the controller its velocity, at rest and made for this alone; None for a sensor that does.
    """
    model = parameters.model
    scales = AccelerometerScales(
        model.sensitivity or accelerometer.sensitivity, model.separation or accelerometer.separation
    )
    return feedforward_path(controller, dsp, model, sample_time, parameters.path_length, sensor, observer), scales


def feedforward_path(
    controller: Controller,
    dsp: DspParameters,
    model: RigidModel,
    sample_time: float,
    length: int,
    sensor: SensorScales = NO_SCALES,
    observer: Observer | None = None,
    *,
    is_observed: bool = False,
    resonances: tuple[Sequence[float], Sequence[float]] = ((), ()),
) -> NDArray[np.float64]:
    """
    Return the response of the error to a pulse of the feedforward, one sample long, in the closed loop.

    The drive is a rigid body on a spring with viscous friction, with ``resonances`` in series, and its sensor is
    ideal. The controller is stepped as in a run.

    Parameters
    ----------
    controller
        A controller at rest, made for this alone; it is stepped.
    dsp
        What lies behind it; of this the computation delay counts.
    model
        The drive.
    sample_time
        T [s].
    length
        Number of samples p.
    sensor
        Scales of the sensor, for a controller that reads its voltages.
    observer
        What gives the controller its velocity, at rest; it is stepped. None for the drive's own velocity.
    is_observed
        Whether the observer gets the pulse with the command: in a run it does not get the feedforward against
        vibration, which is to cancel a force that it does not know of either.
    resonances
        b2, b1, b0 and a2, a1, a0 of each section (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0), one after the other.

    Returns
    -------
    ndarray of shape (p,)
        Error per volt [um/V] at each sample from that of the pulse on; element 0 is 0.
    """
    delayed = Dsp(dataclasses.replace(DspParameters(), computation_delay=dsp.computation_delay), sample_time)
    drive = _SampledModel(model, *resonances, sample_time)
    path = np.zeros(length)
    held = 0.0
    pulse_tick = dsp.computation_delay + 1
    for tick in range(length):
        position, velocity = drive.output()
        path[tick] = position / _PULSE
        if observer is not None:
            is_hidden = tick == pulse_tick and not is_observed
            _, velocity = observer.step(position, held - _PULSE if is_hidden else held)
        inputs = ControllerInputs(tick, position, velocity, *_volts(sensor, position, velocity), 0.0, 0.0, 0.0)
        u, unsaturated, feedback = controller.step(inputs)
        pulse = _PULSE if tick == 0 else 0.0
        held, _, _ = delayed.step(u + pulse, unsaturated + pulse, feedback)
        drive.step(held)
    return path


class _SampledModel:
    """
    The model with u held over each sample, by plain arithmetic in a fixed order.

    The states are position and velocity times T of the rigid body, then two per resonance: with (b2 s^2 + b1 s + b0)/
    (s^2 + a1 s + a0) = b2 + ((b1 - b2 a1) s + b0 - b2 a0)/(s^2 + a1 s + a0), the response q of the last fraction with a
    numerator of 1/T^2, and its derivative times T.
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
        # The velocity times T; no voltage reaches it, as it passes the velocity of the body first.
        columns = zip(*dynamics, strict=True)
        self._travel = [0.0, 1.0] if size == 2 else [_product(shown, column) * sample_time for column in columns]
        self._transition, self._response = held_input_transition(dynamics, inputs, sample_time)
        self._states = [0.0] * size

    def output(self) -> tuple[float, float]:
        """Return position [um] and velocity [um/s] of the head."""
        return _product(self._position, self._states), _product(self._travel, self._states) / self._sample_time

    def step(self, control: float) -> None:
        """Advance by a sample over which a voltage is held."""
        self._states = [
            _product(row, self._states) + response * control
            for row, response in zip(self._transition, self._response, strict=True)
        ]


def _product(row: Sequence[float], states: Sequence[float]) -> float:
    total = 0.0
    for factor, state in zip(row, states, strict=True):
        total += factor * state
    return total


def runout_path(
    parameters: RunoutParameters,
    controller: Controller,
    dsp: DspParameters,
    sample_time: float,
    sensor: SensorScales = NO_SCALES,
    observer: Observer | None = None,
) -> NDArray[np.float64]:
    """
    Return the path that the cancellation of repeatable runout needs, shape (p,); see :func:`feedforward_path`.

    Raises
    ------
    ParameterError
        If T [s] does not go with the parameters.
    """
    length = path_length(parameters, sample_time)
    model = parameters.model
    resonances = model.numerators, model.denominators
    return feedforward_path(
        controller, dsp, model, sample_time, length, sensor, observer, is_observed=True, resonances=resonances
    )


def _volts(sensor: SensorScales, position: float, velocity: float) -> tuple[float, float]:
    """Return the outputs of an ideal sensor [V], 0 of one without scales."""
    return (
        position / sensor.displacement if sensor.displacement else 0.0,
        velocity / sensor.velocity if sensor.velocity else 0.0,
    )
