"""The least position error that feedback could have had in a recorded run, with the disturbance that it recorded."""

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
"""Distance of the lines of the recorded disturbance's spectra [Hz]."""
_SHORTEST = 10
"""Segments of that resolution that a record must hold, for spectra that mean something."""


@dataclasses.dataclass(frozen=True)
class RunBound:
    """
    The least error of feedback in a run.

    Attributes
    ----------
    three_sigma
        The least 3 sigma of the track error, repeatable runout left out, of any linear feedback on the sensor's outputs
        with ``max_sensitivity`` [um].
    reached
        3 sigma of the run's own track error, repeatable runout left out [um].
    max_sensitivity
        The limit of the peak sensitivity.
    is_presliding
        Whether the friction counted as a spring, or the drive as sliding.
    """

    three_sigma: float
    reached: float
    max_sensitivity: float
    is_presliding: bool


_FOUND: weakref.WeakKeyDictionary[RecordedRun, dict[int, RunBound]] = weakref.WeakKeyDictionary()


def _controller_node(run: RecordedRun) -> str:
    """Return the node that published `/control`, without namespace; empty if none is known."""
    for name, node in run.description.get('nodes', {}).items():
        if any(topic.rpartition('/')[2] == CONTROL.name for topic in node.get('outputs', ())):
            return kind_of_node(name, node, run.description)
    return ''


def _sensor_node(run: RecordedRun) -> str:
    """Return the node whose outputs the controller reads."""
    return SERVO_SENSOR if run.is_track_following else SENSOR


def why_no_bound(run: RecordedRun, start: int) -> str:
    """Return why the least error of feedback is not known in a run, from row ``start`` on; empty if it is."""
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
        return f'{seconds:g} s after the transient are too short: {_SHORTEST / RESOLUTION:g} s are needed'
    return ''


def run_bound(run: RecordedRun, start: int) -> RunBound | None:
    """
    Return the least error of feedback in a run, None if :func:`why_no_bound`.

    The disturbance's spectra are those that the run has recorded, by Welch's method. The drive is linearized in
    presliding where the head stays within the deflection at which friction breaks away, else in sliding.

    Parameters
    ----------
    run
        A run with a disturbance.
    start
        Row from which it counts.

    Raises
    ------
    ValueError
        If no feedback with that peak sensitivity is found.
    """
    if why_no_bound(run, start):
        return None
    found = _FOUND.setdefault(run, {})
    if start not in found:
        found[start] = _computed(run, start)
    return found[start]


def _computed(run: RecordedRun, start: int) -> RunBound:
    # Late: only these need the compiled blocks.
    from hdd_servo_ros.analysis.feedback_responses import MeasuredDrive
    from hdd_servo_ros.analysis.least_error import DisturbanceSpectra, least_error
    from hdd_servo_ros.analysis.metrics import power_spectral_density
    from hdd_servo_ros.analysis.misregistration import misregistration
    from hdd_servo_ros.analysis.sampled_drive import has_presliding_spring, sampled_drive
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
    linear = sampled_drive(plant, sample_time, is_presliding)
    disturbance = run[DISTURBANCE.name][start:]
    segment = round(1.0 / (RESOLUTION * sample_time))
    frequencies, force = power_spectral_density(non_repeatable(disturbance[:, 0], sectors), sample_time, segment)
    _, track = power_spectral_density(non_repeatable(disturbance[:, 1], sectors), sample_time, segment)
    if run.is_track_following:
        # The position error alone, at no delay of its own.
        drive = MeasuredDrive.of(linear, surroundings.delay, is_relative=True)
        noise = [np.full(len(frequencies), servo_noise_density(sensor, sample_time))]
    else:
        vibrometer = SampledSensor(sensor, sample_time, surroundings.scales)
        drive = MeasuredDrive.of(linear, surroundings.delay, vibrometer, has_velocity=True, is_relative=False)
        noise = list(noise_densities(sensor, sample_time, frequencies).T)
    found = least_error(drive, DisturbanceSpectra(frequencies, force, track, tuple(noise)))
    reached = misregistration(non_repeatable(run.track_error[start:], sectors))
    return RunBound(found.three_sigma, reached, MAX_SENSITIVITY, is_presliding)
