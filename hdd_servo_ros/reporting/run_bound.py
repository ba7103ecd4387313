"""Lower bound of the error under linear feedback, for the recorded disturbance of a run."""

import dataclasses
import weakref

import numpy as np

from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.graph.recorded_nodes import kind_by_name, kind_of_node
from hdd_servo_ros.messages.topics import CONTROL, DISTURBANCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.run_sensitivity import (
    PLANT,
    SENSOR,
    SERVO_SENSOR,
    loop_surroundings,
    parameters_at_start,
)
from hdd_servo_ros.reporting.track_of_run import non_repeatable, sectors_of, shocks_of

RESOLUTION = 10.0
"""Resolution of the spectra of the recorded disturbance [Hz]."""
_SHORTEST = 10
"""Smallest number of segments of that resolution for a meaningful spectrum."""


@dataclasses.dataclass(frozen=True)
class RunBound:
    """
    Lower bound of the error under linear feedback.

    Attributes
    ----------
    three_sigma
        Lower bound of the 3 sigma track error without repeatable runout, for any linear feedback on the sensor outputs
        with ``max_sensitivity`` [um].
    reached
        3 sigma track error of the run without repeatable runout [um].
    max_sensitivity
        The limit of the peak sensitivity.
    is_presliding
        Whether the drive was linearized in presliding (as a spring) or in sliding.
    """

    three_sigma: float
    reached: float
    max_sensitivity: float
    is_presliding: bool


_FOUND: weakref.WeakKeyDictionary[RecordedRun, dict[int, RunBound]] = weakref.WeakKeyDictionary()


def _controller_node(run: RecordedRun) -> str:
    """Return the node that published `/control`, without namespace; empty if it is unknown."""
    for name, node in run.description.get('nodes', {}).items():
        if any(topic.rpartition('/')[2] == CONTROL.name for topic in node.get('outputs', ())):
            return kind_of_node(name, node, run.description)
    return ''


def _sensor_node(run: RecordedRun) -> str:
    """Return the sensor node that the controller reads."""
    return SERVO_SENSOR if run.is_track_following else SENSOR


def why_no_bound(run: RecordedRun, start: int) -> str:
    """Return why the lower bound from row ``start`` on is unknown; empty if it is known."""
    if DISTURBANCE.name not in run:
        return f'the run has no /{DISTURBANCE.name}'
    nodes = parameters_at_start(run)
    controller = _controller_node(run)
    sensor = _sensor_node(run)
    missing = [name for name in (PLANT, sensor) if name not in nodes]
    if missing:
        return f'run.yaml has no parameters of {" and ".join(missing)}'
    if not controller:
        return f'run.yaml names no node that publishes /{CONTROL.name}'
    changed = {kind_by_name(run.description, change.node) for change in run.parameter_changes} & {PLANT, sensor}
    if changed:
        return f'parameters of {" and ".join(sorted(changed))} were changed during the run'
    if (shocks_of(run) >= run.time[start]).any():
        return 'shocks have no stationary spectrum'
    if not run[DISTURBANCE.name][start:, :2].any():
        return f'/{DISTURBANCE.name} is 0'
    seconds = (len(run.ticks) - start) * run.sample_time
    if seconds < _SHORTEST / RESOLUTION:
        return f'{seconds:g} s after the transient are too short; expected at least {_SHORTEST / RESOLUTION:g} s'
    return ''


def run_bound(run: RecordedRun, start: int) -> RunBound | None:
    """
    Return the lower bound of the error under linear feedback; None if :func:`why_no_bound` has a reason.

    The spectra of the recorded disturbance are estimated by Welch's method. The drive is linearized in presliding if
    the head stays within the breakaway deflection of the friction, otherwise in sliding.

    Parameters
    ----------
    run
        A run with a disturbance.
    start
        First row of the window.

    Raises
    ------
    ValueError
        If no feedback with that peak sensitivity exists.
    """
    if why_no_bound(run, start):
        return None
    found = _FOUND.setdefault(run, {})
    if start not in found:
        found[start] = _computed(run, start)
    return found[start]


def _computed(run: RecordedRun, start: int) -> RunBound:
    # Imported late: only these need the compiled blocks.
    from hdd_servo_ros.analysis.command_path import driven_by
    from hdd_servo_ros.analysis.feedback_responses import MeasuredDrive
    from hdd_servo_ros.analysis.least_error import DisturbanceSpectra, least_error
    from hdd_servo_ros.analysis.metrics import power_spectral_density
    from hdd_servo_ros.analysis.misregistration import misregistration
    from hdd_servo_ros.analysis.sampled_drive import has_presliding_spring
    from hdd_servo_ros.analysis.sampled_sensor import SampledSensor, noise_densities, servo_noise_density
    from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY

    sample_time, sectors = run.sample_time, sectors_of(run)
    surroundings = loop_surroundings(run, _controller_node(run))
    node = _sensor_node(run)
    plant, sensor = surroundings.plant, block_parameters(node, parameters_at_start(run)[node])
    friction = plant.friction
    is_presliding = has_presliding_spring(friction) and (
        float(np.ptp(run.position[start:])) <= 2.0 * friction.coulomb_level / friction.stiffness
    )
    linear = driven_by(plant, sample_time, is_presliding, surroundings.dsp)
    disturbance = run[DISTURBANCE.name][start:]
    segment = round(1.0 / (RESOLUTION * sample_time))
    frequencies, force = power_spectral_density(non_repeatable(disturbance[:, 0], sectors), sample_time, segment)
    _, track = power_spectral_density(non_repeatable(disturbance[:, 1], sectors), sample_time, segment)
    if run.is_track_following:
        # Only the position error, without additional delay.
        drive = MeasuredDrive.of(linear, surroundings.delay, is_relative=True)
        noise = [np.full(len(frequencies), servo_noise_density(sensor, sample_time))]
    else:
        vibrometer = SampledSensor(sensor, sample_time, surroundings.scales)
        drive = MeasuredDrive.of(linear, surroundings.delay, vibrometer, has_velocity=True, is_relative=False)
        noise = list(noise_densities(sensor, sample_time, frequencies).T)
    found = least_error(drive, DisturbanceSpectra(frequencies, force, track, tuple(noise)))
    reached = misregistration(non_repeatable(run.track_error[start:], sectors))
    return RunBound(found.three_sigma, reached, MAX_SENSITIVITY, is_presliding)
