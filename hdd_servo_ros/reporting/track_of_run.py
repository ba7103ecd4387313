"""The track of a recorded run: its pitch, the sectors of a revolution, and shocks of the base."""

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
"""Track pitch of a run that does not say its own [um]: the 25000 tracks per inch of the thesis."""


def track_pitch(run: RecordedRun) -> float | None:
    """Return the track pitch of a run [um]: that of its servo sensor, else the drive's; None in other units."""
    if run.length_unit != 'um':
        return None
    for node in ('servo_sensor', 'vcm_plant'):
        with contextlib.suppress(LookupError):
            return float(run.parameter(node, 'track_pitch'))
    return DEFAULT_PITCH


def why_no_sectors(run: RecordedRun) -> str:
    """Return why a run has no whole number of samples per revolution, empty if it has."""
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
    """Return the spindle of a run; raises LookupError if it has none."""
    names = ('revolutions_per_minute', 'sectors')
    speed, sectors = (run.parameter(DISTURBANCE_GENERATOR, f'spindle.{name}') for name in names)
    return SpindleParameters(revolutions_per_minute=float(speed), sectors=int(sectors))


def sectors_of(run: RecordedRun) -> int:
    """Return the samples, and servo sectors, per revolution; 0 if :func:`why_no_sectors`."""
    return 0 if why_no_sectors(run) else _spindle_of(run).sectors


def shocks_of(run: RecordedRun) -> NDArray[np.float64]:
    """Return the times at which shocks of the base begin [s]; none without `/base_acceleration`."""
    if BASE_ACCELERATION.name not in run:
        return np.empty(0)
    shocks = np.asarray(run.time[0] + shock_times(run.base_acceleration.linear_y, run.sample_time))
    # One that is under way at the first row of a stretch has begun before.
    return shocks[shocks > run.time[0]] if begins_within(run) else shocks


def non_repeatable(signal: NDArray[np.float64], sectors: int) -> NDArray[np.float64]:
    """Return a signal, shape (n,), less what repeats every revolution; as it is if there are not two of ``sectors``."""
    if sectors < 2 or len(signal) < 2 * sectors:
        return signal
    mean = runout_parts(signal, sectors).repeatable
    return np.asarray(signal - mean[np.arange(len(signal)) % sectors])
