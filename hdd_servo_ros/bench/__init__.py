"""Instruments of the bench, without ROS."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.bench.accelerometer import (
        Accelerometer,
        AccelerometerParameters,
    )
    from hdd_servo_ros.bench.dsp import Dsp, DspParameters
    from hdd_servo_ros.bench.ldv import Ldv, LdvParameters
    from hdd_servo_ros.bench.output_filters import FilterParameters, OutputFilters
    from hdd_servo_ros.bench.response import FrequencyResponse, read_csv
    from hdd_servo_ros.bench.servo_sensor import (
        ServoSensor,
        ServoSensorParameters,
    )
    from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer
    from hdd_servo_ros.bench.signal_analyzer_parameters import SignalAnalyzerParameters

__all__ = [
    'Accelerometer',
    'AccelerometerParameters',
    'Dsp',
    'DspParameters',
    'FilterParameters',
    'FrequencyResponse',
    'Ldv',
    'LdvParameters',
    'OutputFilters',
    'ServoSensor',
    'ServoSensorParameters',
    'SignalAnalyzer',
    'SignalAnalyzerParameters',
    'read_csv',
]

__getattr__ = lazily(
    __name__,
    {
        'Accelerometer': '.accelerometer',
        'AccelerometerParameters': '.accelerometer',
        'Dsp': '.dsp',
        'DspParameters': '.dsp',
        'FilterParameters': '.output_filters',
        'FrequencyResponse': '.response',
        'Ldv': '.ldv',
        'LdvParameters': '.ldv',
        'OutputFilters': '.output_filters',
        'ServoSensor': '.servo_sensor',
        'ServoSensorParameters': '.servo_sensor',
        'SignalAnalyzer': '.signal_analyzer',
        'SignalAnalyzerParameters': '.signal_analyzer_parameters',
        'read_csv': '.response',
    },
)
