"""The path from a feedforward to the tracking error, from a model of the drive and the very blocks of the loop."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.feedforward import AccelerometerScales
from hdd_servo_ros.control.feedforward_parameters import FeedforwardModelParameters, FeedforwardParameters
from hdd_servo_ros.control.observer import Observer
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales
from hdd_servo_ros.numerics.transition import held_input_transition

NO_SCALES = SensorScales(0.0, 0.0)
"""Of a sensor without voltages, or where no controller reads them."""
_PULSE = 1e-3
"""Height of the pulse [V]: small, so that what adapts in the controller hardly does."""


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
    model: FeedforwardModelParameters,
    sample_time: float,
    length: int,
    sensor: SensorScales = NO_SCALES,
    observer: Observer | None = None,
) -> NDArray[np.float64]:
    """
    Return the response of the error to a pulse of the feedforward, one sample long, in the closed loop.

    The drive is a rigid body on a spring with viscous friction, without resonances, and its sensor is ideal. The
    controller is stepped as in a run.

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

    Returns
    -------
    ndarray of shape (p,)
        Error per volt [um/V] at each sample from that of the pulse on; element 0 is 0.
    """
    delayed = Dsp(dataclasses.replace(DspParameters(), computation_delay=dsp.computation_delay), sample_time)
    # The second state is velocity times T, which makes both alike in size.
    transition, response = held_input_transition(
        [
            [0.0, 1.0 / sample_time],
            [-model.gain * model.stiffness * sample_time, -model.gain * model.viscous_coefficient],
        ],
        [0.0, model.gain * sample_time],
        sample_time,
    )
    path = np.zeros(length)
    position, travel, held = 0.0, 0.0, 0.0
    for tick in range(length):
        path[tick] = position / _PULSE
        velocity = travel / sample_time
        if observer is not None:
            _, velocity = observer.step(position, held)
        inputs = ControllerInputs(tick, position, velocity, *_volts(sensor, position, velocity), 0.0, 0.0, 0.0)
        u, unsaturated, feedback = controller.step(inputs)
        pulse = _PULSE if tick == 0 else 0.0
        held, _, _ = delayed.step(u + pulse, unsaturated + pulse, feedback)
        position, travel = (
            transition[0][0] * position + transition[0][1] * travel + response[0] * held,
            transition[1][0] * position + transition[1][1] * travel + response[1] * held,
        )
    return path


def _volts(sensor: SensorScales, position: float, velocity: float) -> tuple[float, float]:
    """Return the outputs of an ideal sensor [V], 0 of one without scales."""
    return (
        position / sensor.displacement if sensor.displacement else 0.0,
        velocity / sensor.velocity if sensor.velocity else 0.0,
    )
