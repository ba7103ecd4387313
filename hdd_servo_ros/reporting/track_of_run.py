"""The track of a recorded run: pitch, sectors per revolution, and shocks of the base."""

import contextlib

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.off_track import shock_times
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.disturbance.spindle import SpindleParameters
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR
from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.long_runs import begins_within

DEFAULT_PITCH = 1.016
"""Default track pitch [um]: the 25000 tracks per inch of the thesis."""


def track_pitch(run: RecordedRun) -> float | None:
    """Return the track pitch [um] of the servo sensor, otherwise of the drive; None in other units."""
    if run.length_unit != 'um':
        return None
    for node in ('servo_sensor', 'vcm_plant'):
        with contextlib.suppress(LookupError):
            return float(run.parameter(node, 'track_pitch'))
    return DEFAULT_PITCH


def why_no_sectors(run: RecordedRun) -> str:
    """Return why the number of samples per revolution is not an integer; empty if it is."""
    try:
        spindle = _spindle_of(run)
    except LookupError:
        return f'run.yaml has no spindle of {DISTURBANCE_GENERATOR}'
    if not spindle.sectors:
        return f'{DISTURBANCE_GENERATOR} has spindle.sectors = 0'
    try:
        spindle.require_synchronous(run.sample_time, 'runout')
    except ParameterError as error:
        return str(error)
    return ''


def _spindle_of(run: RecordedRun) -> SpindleParameters:
    """Return the spindle of a run; raises LookupError without a spindle."""
    names = ('revolutions_per_minute', 'sectors')
    speed, sectors = (run.parameter(DISTURBANCE_GENERATOR, f'spindle.{name}') for name in names)
    return SpindleParameters(revolutions_per_minute=float(speed), sectors=int(sectors))


def sectors_of(run: RecordedRun) -> int:
    """Return the samples (servo sectors) per revolution; 0 if this is not an integer."""
    return 0 if why_no_sectors(run) else _spindle_of(run).sectors


def shocks_of(run: RecordedRun) -> NDArray[np.float64]:
    """Return the start times of shocks of the base [s]; empty without `/base_acceleration`."""
    if BASE_ACCELERATION.name not in run:
        return np.empty(0)
    shocks = np.asarray(run.time[0] + shock_times(run.base_acceleration.linear_y, run.sample_time))
    # A shock in progress at the first row of a stretch started earlier.
    return shocks[shocks > run.time[0]] if begins_within(run) else shocks


def non_repeatable(signal: NDArray[np.float64], sectors: int) -> NDArray[np.float64]:
    """Return a signal, shape (n,), without its repeatable part; unchanged for fewer than two revolutions."""
    if sectors < 2 or len(signal) < 2 * sectors:
        return signal
    mean = runout_parts(signal, sectors).repeatable
    return np.asarray(signal - mean[np.arange(len(signal)) % sectors])
