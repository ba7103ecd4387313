"""The path from a feedforward to the tracking error, from a model of the drive and the blocks of the loop."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_model import NO_SCALES, RigidModel, SampledModel, ideal_outputs
from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.feedforward import AccelerometerScales
from hdd_servo_ros.control.feedforward_parameters import FeedforwardParameters
from hdd_servo_ros.control.observer import Observer
from hdd_servo_ros.control.runout import path_length
from hdd_servo_ros.control.runout_parameters import RunoutParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales

_PULSE = 1e-3
"""Height of the pulse [V]: small, so that the controller hardly adapts."""


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
    Return the data of a feedforward in addition to its parameters: the path and the sensor scales.

    Parameters
    ----------
    parameters
        Parameters of the feedforward; unset scales are those of the sensors.
    controller
        A controller at rest, created for this purpose; it is stepped.
    dsp, accelerometer
        The DSP block after the controller, and the accelerometers.
    sample_time
        T [s].
    sensor
        Scales of the sensor, for a controller that reads its voltages.
    observer
        Velocity observer at rest, created for this purpose; None for a sensor that measures velocity.
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
        A controller at rest, created for this purpose; it is stepped.
    dsp
        The DSP block, of which delay, filters and updates are used.
    model
        The drive.
    sample_time
        T [s].
    length
        Number of samples p.
    sensor
        Scales of the sensor, for a controller that reads its voltages.
    observer
        Velocity observer at rest; it is stepped. None to use the velocity of the drive.
    is_observed
        Whether the observer receives the pulse with the command. In a run it does not receive the vibration
        feedforward, which cancels a force that is unknown to it too.
    resonances
        b2, b1, b0 and a2, a1, a0 of each section (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0), concatenated.

    Returns
    -------
    ndarray of shape (p,)
        Error per volt [um/V] at each sample, starting at the pulse; element 0 is 0.
    """
    path_to_drive = Dsp(dsp.without_converter, sample_time)
    count = dsp.updates_per_sample if dsp.is_filtered else 1
    drive = SampledModel(model, *resonances, sample_time / count)
    path = np.zeros(length)
    held = 0.0
    pulse_tick = dsp.computation_delay + 1
    for tick in range(length):
        position, velocity = drive.output()
        path[tick] = position / _PULSE
        if observer is not None:
            is_hidden = tick == pulse_tick and not is_observed
            _, velocity = observer.step(position, held - _PULSE if is_hidden else held)
        inputs = ControllerInputs(tick, position, velocity, *ideal_outputs(sensor, position, velocity), 0.0, 0.0, 0.0)
        u, unsaturated, feedback = controller.step(inputs)
        pulse = _PULSE if tick == 0 else 0.0
        first, _, _ = path_to_drive.step(u + pulse, unsaturated + pulse, feedback)
        held = path_to_drive.mean_voltage(first)
        for voltage in path_to_drive.voltages(first)[:count]:
            drive.step(voltage)
    return path


def runout_path(
    parameters: RunoutParameters,
    controller: Controller,
    dsp: DspParameters,
    sample_time: float,
    sensor: SensorScales = NO_SCALES,
    observer: Observer | None = None,
) -> NDArray[np.float64]:
    """
    Return the path for the cancellation of repeatable runout, shape (p,); see :func:`feedforward_path`.

    Raises
    ------
    ParameterError
        If the sample time T [s] does not match the parameters.
    """
    length = path_length(parameters, sample_time)
    model = parameters.model
    resonances = model.numerators, model.denominators
    return feedforward_path(
        controller, dsp, model, sample_time, length, sensor, observer, is_observed=True, resonances=resonances
    )
