"""
Plans of final-state control: voltages that move the sampled drive with all its modes from rest to rest.

Final-state control finds the input of N samples that moves a sampled model from one state to another and minimizes a
norm (Totani and Nishimura, Trans. SICE 30(3), 1994; Hirata and others for disk drives). Here the rigid body
must be at rest on the target after N samples, and the residual vibration of the modes is minimized for the nominal
drive and for drives with lower and higher frequencies. A plan can then be shorter than the order of the model, which
matters for seeks of a few samples.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_drive import SampledDrive, sampled_drive
from hdd_servo_ros.control.seek import SeekPlans
from hdd_servo_ros.control.seek_parameters import SeekModelParameters, SeekParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.transition import held_input_transition
from hdd_servo_ros.parameters import ParameterError

Array = NDArray[np.float64]

SHORTEST = 3
"""Samples of the shortest plan: one to move, one to stop, and one to reduce the vibration."""
MOST_SAMPLES = 1000
"""Samples of the longest plan; the time to compute plans grows with the cube, here to some seconds."""
VIBRATION_TIME = 1.2e-3
"""Time after a plan in which vibration counts [s]; the modes of the default drive decay by 70 % in it."""
_ALL_UP_TO = 24
"""Up to this length there is a plan per number of samples; longer plans differ by a sixteenth."""
_VIBRATION_WEIGHT = 100.0
"""
Weight of the vibration [V/um] relative to the changes of the voltage.

A lower weight gives plans of ten samples ten times the vibration; with a higher weight, long plans are not smooth.
"""
_DIGITS = 10
"""Digits of the rounded plans: results of LAPACK differ in the last bits between machines."""
_MODEL_DIGITS = 12


def seek_plans(parameters: SeekParameters, sample_time: float) -> SeekPlans:
    """
    Return the model of the seek law and its plans, from rest to rest over 1 µm.

    Parameters
    ----------
    parameters
        Parameters of the seek law, of which the model and the duration of the longest plan are used.
    sample_time
        Sample time T [s].

    Raises
    ------
    ParameterError
        If the longest plan has more than :data:`MOST_SAMPLES` samples.
    """
    if parameters.longest_plan > (MOST_SAMPLES + 0.5) * sample_time:
        allowed = f'at most {MOST_SAMPLES * sample_time:g} s at T = {sample_time:g} s, {MOST_SAMPLES} samples'
        raise ParameterError('seek.longest_plan', parameters.longest_plan, allowed)
    return _plans(parameters.model, parameters.longest_plan, sample_time)


@functools.lru_cache(maxsize=8)
def _plans(model: SeekModelParameters, longest_plan: float, sample_time: float) -> SeekPlans:
    nominal = model_drive(model, sample_time)
    spread = (1.0 - model.mode_spread, 1.0 + model.mode_spread) if model.mode_spread and model.numerators else ()
    drives = [nominal, *(model_drive(model, sample_time, factor) for factor in spread)]
    longest = max(math.floor(longest_plan / sample_time + 1e-9), SHORTEST)
    tail = math.ceil(VIBRATION_TIME / sample_time)
    responses = [_pulse_response(drive, longest + tail) for drive in drives]
    lengths = plan_lengths(longest)
    plans, durations = np.zeros((len(lengths), longest)), np.zeros((len(lengths), 2))
    for row, samples in enumerate(lengths):
        plan, vibration = _plan(model, sample_time, samples, responses, tail)
        plans[row, :samples] = plan
        durations[row] = samples, vibration
    return SeekPlans(plans, durations, nominal.a.copy(), nominal.b[:, 0].copy(), np.ascontiguousarray(nominal.c), tail)


def plan_lengths(longest: int) -> list[int]:
    """Return the numbers of samples for which there is a plan."""
    lengths = list(range(SHORTEST, min(longest, _ALL_UP_TO) + 1))
    while lengths[-1] < longest:
        lengths.append(min(longest, lengths[-1] + lengths[-1] // 16))
    return lengths


def model_drive(model: SeekModelParameters, sample_time: float, frequency_factor: float = 1.0) -> SampledDrive:
    """
    Return the linear sampled model of the seek law, without bristle friction.

    Parameters
    ----------
    model
        The model.
    sample_time
        Sample time T [s].
    frequency_factor
        Factor of the frequencies of all modes; their damping ratios are unchanged.
    """
    resonance = ResonanceParameters(form='none')
    if model.numerators:
        powers = np.array([1.0, frequency_factor, frequency_factor**2])
        resonance = ResonanceParameters(
            numerators=tuple((np.reshape(model.numerators, (-1, 3)) * powers).ravel().tolist()),
            denominators=tuple((np.reshape(model.denominators, (-1, 3)) * powers).ravel().tolist()),
        )
    friction = FrictionParameters(model='lugre', viscous_coefficient=model.viscous_coefficient)
    plant = PlantParameters(gain=model.gain, friction=friction, resonance=resonance)
    drive = sampled_drive(plant, sample_time, presliding=False)
    a, b, c = (_rounded(matrix, _MODEL_DIGITS) for matrix in (drive.a, drive.b, drive.c))
    return SampledDrive(a, b, c, sample_time)


def _plan(
    model: SeekModelParameters, sample_time: float, samples: int, responses: list[Array], tail: int
) -> tuple[Array, float]:
    """Return the plan for a number of samples [V/um], and its largest residual vibration per length."""
    ends, goal = _rigid_end(model, sample_time, samples)
    # Changes of the plan with zeros before and after it, so that it starts and ends smoothly.
    changes = np.eye(samples + 1, samples) - np.eye(samples + 1, samples, -1)
    after = [_vibrations(response, samples, tail) for response in responses]
    weighted = np.vstack([changes, *(_VIBRATION_WEIGHT * rows for rows in after)])
    wanted = np.concatenate([np.zeros(samples + 1), np.full(tail * len(after), _VIBRATION_WEIGHT)])
    basis, triangle = np.linalg.qr(ends.T, mode='complete')
    plan = basis[:, :2] @ np.linalg.solve(triangle[:2].T, goal)
    free = basis[:, 2:]
    columns, upper = np.linalg.qr(weighted @ free)
    plan = plan + free @ np.linalg.solve(upper, columns.T @ (wanted - weighted @ plan))
    plan = _rounded(plan, _DIGITS)
    return plan, float(np.round(np.abs(after[0] @ plan - 1.0).max(), _DIGITS))


def _rigid_end(model: SeekModelParameters, sample_time: float, samples: int) -> tuple[Array, Array]:
    """Return the effect of each sample on position and travel per sample of the rigid body, and their goal."""
    transition, response = held_input_transition(
        [[0.0, 1.0 / sample_time], [0.0, -model.gain * model.viscous_coefficient]],
        [0.0, model.gain * sample_time],
        sample_time,
    )
    ends, column, matrix = np.empty((2, samples)), np.array(response), np.array(transition)
    for sample in range(samples - 1, -1, -1):
        ends[:, sample] = column
        column = matrix @ column
    # At rest the head position is that of the rigid body times the DC gain of the sections.
    pairs = zip(model.numerators[2::3], model.denominators[2::3], strict=True)
    static_gain = math.prod(b0 / a0 for b0, a0 in pairs)
    size = np.linalg.norm(ends, axis=1)
    return np.asarray(ends / size[:, None]), np.asarray(np.array([1.0 / static_gain, 0.0]) / size)


def _pulse_response(drive: SampledDrive, samples: int) -> Array:
    """Return the head position after a voltage pulse of one sample, from the next tick on [um/V]."""
    found, state = np.empty(samples), drive.b[:, 0]
    for sample in range(samples):
        found[sample] = drive.c[0] @ state
        state = drive.a @ state
    return found


def _vibrations(response: Array, samples: int, tail: int) -> Array:
    """Return the effect of each sample on the head positions after the plan, shape (tail, samples)."""
    ages = np.arange(tail)[:, None] + samples - 1 - np.arange(samples)[None, :]
    return np.asarray(response[ages])


def _rounded(values: Array, digits: int) -> Array:
    """Return values rounded relative to the largest value of their row."""
    if values.ndim == 2:
        return np.array([_rounded(row, digits) for row in values])
    largest = float(np.abs(values).max())
    if largest == 0.0:
        return values
    scale = 10.0 ** (digits - 1 - math.floor(math.log10(largest)))
    return np.asarray(np.round(values * scale) / scale)
