"""What a seek part has to know beside its parameters: plans, delay, the sensor's limit, and initial values."""

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
    Return what a seek part has to know beside its parameters.

    Parameters
    ----------
    parameters
        The seek part's.
    make_controller
        Returns the following controller at rest, as it is at a switch.
    sample_time
        T [s].
    dsp
        What lies behind the controller, with the limit of the drive.
    scales
        How the controller reads the sensor.
    sensor
        The vibrometer; None for a sensor whose velocity has no limit.
    observer
        What gives the velocity of a sensor that has none.
    """
    limit = math.inf if sensor is None else sensor.levels()[1] * sensor.velocity_scale
    constants = None if observer is None else Observer(observer, sample_time).arrays[0]
    delay = dsp.parameters.computation_delay
    if parameters.method == 'final_state':
        plans = seek_plans(parameters, sample_time)
        return SeekSurroundings(plans, delay, limit, dsp.limit, observer=constants)
    model = parameters.model
    # Its friction is fed forward, so that the bristles are no spring.
    drive = RigidDrive(model.gain, 0.0, model.viscous_coefficient)
    fade_time = parameters.switch.fade_time
    gains = initial_value_gains(make_controller, drive, fade_time, sample_time, dsp=dsp.parameters, sensor=scales)
    bias_gains = (gains.error, gains.velocity, gains.gap)
    return SeekSurroundings(no_plans(), delay, limit, dsp.limit, bias_gains, constants)
