"""Parameters of a seek reference: targets, dwell times and trajectory."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter
from hdd_servo_ros.signals.seek_trajectory import TRAJECTORIES

SOURCES = ('list', 'random')
LENGTH_DISTRIBUTIONS = ('uniform', 'log_uniform')

MOST_SEEKS = 100_000
"""Largest number of seeks in a list; planning takes about 25 µs per seek, before the run."""


@dataclasses.dataclass(frozen=True)
class SeekParameters(ParameterSet):
    """Parameters of the waveform ``seek``; other waveforms ignore them."""

    source: str = parameter('list', 'source of the targets: the list `targets`, or random seeks', choices=SOURCES)
    targets: tuple[float, ...] = parameter(
        (10.0, 0.0),
        'targets of the source list, in order and relative to the offset; in um, or in tracks if `track_pitch` is '
        'above 0',
        unit='um',
    )
    track_pitch: float = parameter(
        0.0,
        'track pitch, if `targets` are track numbers (not necessarily whole); 0 for targets in um',
        unit='um',
        minimum=0.0,
    )
    dwell_times: tuple[float, ...] = parameter(
        (0.02,),
        'time from the start of a seek to the start of the next seek, rounded up to whole samples: one element for all '
        'seeks, or one element per seek; the first seek starts at start_time',
        unit='s',
        above=0.0,
        maximum=1e6,
    )
    repeat: bool = parameter(True, 'repeat the list of seeks; if false, the last target is held')
    seed: int = parameter(1, 'seed of random seeks', minimum=0, maximum=2**53)
    count: int = parameter(100, 'number of random seeks', minimum=1, maximum=MOST_SEEKS)
    shortest: float = parameter(0.1, 'shortest random seek', unit='um', above=0.0)
    longest: float = parameter(100.0, 'longest random seek, at most `travel`', unit='um', above=0.0)
    length_distribution: str = parameter(
        'log_uniform',
        'distribution of the lengths of random seeks from `shortest` to `longest`: uniform in the length, or uniform '
        'in its logarithm',
        choices=LENGTH_DISTRIBUTIONS,
    )
    travel: float = parameter(
        100.0,
        'largest distance of random targets from the offset; a seek that would exceed it goes in the other direction',
        unit='um',
        above=0.0,
    )
    trajectory: str = parameter(
        'minimum_jerk',
        'trajectory to a target: step, polynomial of degree 5 (minimum_jerk), or the fastest one within the limits '
        '(time_optimal); the duration is rounded up to whole samples, so the limits are not fully used',
        choices=TRAJECTORIES,
    )
    acceleration: float = parameter(
        2e8,
        'acceleration limit of a trajectory; the default is about half the capability of the default drive',
        unit='um/s^2',
        above=0.0,
    )
    jerk: float = parameter(1e12, 'jerk limit of a trajectory; 0 for no limit', unit='um/s^3', minimum=0.0)
    velocity: float = parameter(0.0, 'velocity limit of a trajectory; 0 for no limit', unit='um/s', minimum=0.0)

    def check_together(self) -> None:
        """Check the combinations of parameters; raise :class:`ParameterError` if one is invalid."""
        if self.source == 'list':
            if not self.targets:
                raise ParameterError('targets', self.targets, 'at least one target')
            if len(self.targets) > MOST_SEEKS:
                raise ParameterError('targets', f'a list of {len(self.targets)}', f'at most {MOST_SEEKS} targets')
        elif self.longest < self.shortest:
            raise ParameterError('longest', self.longest, f'at least shortest, which is {self.shortest!r} um')
        elif self.travel < self.longest:
            raise ParameterError(
                'travel',
                self.travel,
                f'at least longest, which is {self.longest!r} um, so that a seek in one direction is always possible',
            )
        seeks = len(self.targets) if self.source == 'list' else self.count
        if len(self.dwell_times) not in (1, seeks):
            number = len(self.dwell_times)
            raise ParameterError(
                'dwell_times',
                self.dwell_times,
                f'1 element for all seeks, or {seeks} elements, one per seek; it has {number}',
            )
