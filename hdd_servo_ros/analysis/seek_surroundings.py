"""Data of the seek law in addition to its parameters: plans, delay, sensor limit, and initial values."""

import math
from collections.abc import Callable

from hdd_servo_ros.analysis.initial_values import RigidDrive, initial_value_gains
from hdd_servo_ros.analysis.seek_plans import seek_plans
from hdd_servo_ros.bench.dsp import Dsp
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.observer import Observer, ObserverParameters
from hdd_servo_ros.control.seek import SeekSurroundings, no_plans
from hdd_servo_ros.control.seek_parameters import SeekParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError


def seek_surroundings(
    parameters: SeekParameters,
    make_controller: Callable[[], Controller],
    sample_time: float,
    dsp: Dsp,
    scales: SensorScales,
    sensor: LdvParameters | None,
    observer: ObserverParameters | None = None,
) -> SeekSurroundings:
    """
    Return the data of the seek law in addition to its parameters.

    Parameters
    ----------
    parameters
        Parameters of the seek law.
    make_controller
        Returns the following controller at rest, in its state at a switch.
    sample_time
        Sample time T [s].
    dsp
        The DSP block, with the limit of the drive.
    scales
        Sensor scales of the controller.
    sensor
        The vibrometer; None for a sensor without a velocity limit.
    observer
        Velocity observer, for a sensor without velocity.

    Raises
    ------
    ParameterError
        If the command is interpolated within the sample.
    """
    limit = math.inf if sensor is None else sensor.levels()[1] * sensor.velocity_scale
    constants = None if observer is None else Observer(observer, sample_time).arrays[0]
    delay = dsp.parameters.computation_delay
    if dsp.parameters.is_interpolated:
        raise ParameterError(
            'dsp.interpolation',
            dsp.parameters.interpolation,
            f"hold with seek.method '{parameters.method}', whose plans assume a constant voltage over each sample",
        )
    if parameters.method == 'final_state':
        plans = seek_plans(parameters, sample_time)
        return SeekSurroundings(plans, delay, limit, dsp.limit, observer=constants)
    model = parameters.model
    # Its friction is fed forward, so that the bristles do not act as a spring.
    drive = RigidDrive(model.gain, 0.0, model.viscous_coefficient)
    fade_time = parameters.switch.fade_time
    gains = initial_value_gains(make_controller, drive, fade_time, sample_time, dsp=dsp.parameters, sensor=scales)
    bias_gains = (gains.error, gains.velocity, gains.gap)
    return SeekSurroundings(no_plans(), delay, limit, dsp.limit, bias_gains, constants)
