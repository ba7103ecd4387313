"""Repeatable runout (RRO): the part of the track center motion that repeats every revolution."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.spindle import SpindleParameters
from hdd_servo_ros.disturbance.streams import RUNOUT_PHASES, RUNOUT_SEQUENCE
from hdd_servo_ros.disturbance.table import read_table
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import sine_cosine_of_turns
from hdd_servo_ros.numerics.noise import normal_pair, uniform_pair
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

SEQUENCES = ('none', 'random', 'file')
_SEQUENCE_FILE = 'runout.repeatable.sequence_file'

RUNOUT = layout('is_enabled', 'turns_per_sample', 'samples_per_revolution')


@dataclasses.dataclass(frozen=True)
class RepeatableRunoutParameters(ParameterSet):
    """Repeatable runout: harmonics of the spindle speed, and a sequence with one value per servo sector."""

    enabled: bool = parameter(False, 'enable the repeatable runout')
    seed: int = parameter(1, 'seed of the phases and of the random sequence', minimum=0, maximum=2**53)
    orders: tuple[int, ...] = parameter((1, 2, 3), 'orders of the harmonics: multiples of the spindle speed', minimum=1)
    amplitudes: tuple[float, ...] = parameter((0.038, 0.0076, 0.0015), 'amplitude of each harmonic', unit='um')
    phases: tuple[float, ...] = parameter(
        (), 'phase of each harmonic at time 0; an empty list selects random phases set by seed', unit='turn'
    )
    sequence: str = parameter(
        'none',
        'displacement sequence per sector: none, random (set by seed), or read from sequence_file',
        choices=SEQUENCES,
    )
    sequence_sigma: float = parameter(
        0.0037, 'standard deviation of the random sequence over a revolution', unit='um', minimum=0.0
    )
    sequence_cutoff: float = parameter(
        20.0,
        'cutoff order of the random sequence, whose amplitude spectrum is a first-order low pass (1/sqrt(2) at cutoff)',
        above=0.0,
    )
    sequence_file: str = parameter(
        '', 'CSV file with the displacement in each sector [um], one row per sector', read_only=True
    )

    def check_together(self) -> None:
        """Check the lengths of the lists, and that a file is given if one is needed."""
        count = len(self.orders)
        if len(self.amplitudes) != count:
            raise ParameterError('amplitudes', self.amplitudes, f'{count} elements, as many as orders')
        if self.phases and len(self.phases) != count:
            raise ParameterError('phases', self.phases, f'an empty list or {count} elements, as many as orders')
        if self.sequence == 'file' and not self.sequence_file:
            raise ParameterError('sequence_file', '', 'the path of a CSV file, because sequence is file')


@dataclasses.dataclass(frozen=True)
class RunoutParameters(ParameterSet):
    """Runout of the track center."""

    repeatable: RepeatableRunoutParameters = group(RepeatableRunoutParameters)


def harmonics_of(parameters: RepeatableRunoutParameters) -> NDArray[np.float64]:
    """Return order, amplitude [um] and phase [turn] of each harmonic, shape (n, 3)."""
    rows = np.zeros((len(parameters.orders), 3))
    for i, order in enumerate(parameters.orders):
        # The order selects the random number, so a harmonic keeps its phase when other harmonics change.
        phase = parameters.phases[i] if parameters.phases else uniform_pair(parameters.seed, RUNOUT_PHASES, order)[0]
        rows[i] = float(order), parameters.amplitudes[i], phase
    return rows


def read_sequence(parameters: RepeatableRunoutParameters) -> NDArray[np.float64]:
    """
    Return the rows of the sequence file [um], shape (n,); empty without a file.

    Raises
    ------
    ParameterError
        If the file is invalid.
    """
    if not parameters.sequence_file:
        return np.zeros(0)
    rows = read_table(_SEQUENCE_FILE, parameters.sequence_file, ['displacement [um]'], 1)
    return np.array([row[0] for row in rows])


def sequence_of(
    parameters: RepeatableRunoutParameters,
    spindle: SpindleParameters,
    sample_time: float,
    recorded: NDArray[np.float64],
) -> NDArray[np.float64]:
    """
    Return the displacement in each sector [um], shape (sectors,); empty without a sequence.

    Parameters
    ----------
    parameters, spindle
        Parameters of runout and spindle.
    sample_time
        T [s].
    recorded
        Result of :func:`read_sequence`.

    Raises
    ------
    ParameterError
        If T and the spindle are not synchronous, or the number of rows differs from the number of sectors.
    """
    if not parameters.enabled or parameters.sequence == 'none':
        return np.zeros(0)
    samples = spindle.require_synchronous(sample_time, f'runout.repeatable.sequence = {parameters.sequence}')
    if parameters.sequence == 'file':
        if len(recorded) != samples:
            allowed = f'a CSV file with {samples} rows, one per sector; it has {len(recorded)}'
            raise ParameterError(_SEQUENCE_FILE, parameters.sequence_file, allowed)
        return recorded
    sequence = np.zeros(samples)
    _fill_low_pass_sequence(sequence, parameters.seed, parameters.sequence_cutoff, parameters.sequence_sigma)
    return sequence


@compiled
def _fill_low_pass_sequence(sequence: NDArray[np.float64], seed: int, cutoff: float, sigma: float) -> None:
    """
    Fill a periodic sequence: first-order low-pass noise in steady state, with mean 0 and standard deviation sigma.

    Parameters
    ----------
    sequence
        Output array for one period.
    seed
        Seed of the white noise.
    cutoff
        Order at which the low pass has decreased to 1/sqrt(2).
    sigma
        Standard deviation over the period, met exactly.
    """
    count = len(sequence)
    # Low pass 1/(1 - d z^-1) with |H| = |H(1)|/sqrt(2) at the cutoff; d is the root below 1.
    _, cosine = sine_cosine_of_turns(min(cutoff / count, 0.5))
    half = 2.0 - cosine
    decay = half - math.sqrt(half * half - 1.0)
    last = 0.0
    for i in range(count):
        last = decay * last + normal_pair(seed, RUNOUT_SEQUENCE, i)[0]
        sequence[i] = last
    # In steady state the value before the first sample equals the value after the last.
    power = 1.0
    for _ in range(count):
        power *= decay
    carried = last / (1.0 - power)
    mean = 0.0
    for i in range(count):
        carried *= decay
        sequence[i] += carried
        mean += sequence[i]
    mean /= count
    variance = 0.0
    for i in range(count):
        sequence[i] -= mean
        variance += sequence[i] * sequence[i]
    scale = sigma / math.sqrt(variance / count) if variance > 0.0 else 0.0
    for i in range(count):
        sequence[i] *= scale


@compiled
def repeatable_runout(c: np.record, harmonics: NDArray[np.float64], sequence: NDArray[np.float64], tick: int) -> float:
    """Return the displacement of the track center at a tick [um]."""
    samples = int(c.samples_per_revolution)
    sector = 0
    if samples > 0:
        # Identical in every revolution, without rounding.
        sector = tick % samples
        turns = float(sector) / c.samples_per_revolution
    else:
        turns = float(tick) * c.turns_per_sample
    total = 0.0
    for i in range(len(harmonics)):
        total += harmonics[i, 1] * sine_cosine_of_turns(harmonics[i, 0] * turns + harmonics[i, 2])[0]
    if len(sequence) > 0:
        total += sequence[sector]
    return total
