"""Parameters of a reference that seeks: which targets, when, and along which trajectory."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter
from hdd_servo_ros.signals.seek_trajectory import TRAJECTORIES

SOURCES = ('list', 'random')
LENGTH_DISTRIBUTIONS = ('uniform', 'log_uniform')

MOST_SEEKS = 100_000
"""Of one list: planning a seek takes about 25 us, before the run."""


@dataclasses.dataclass(frozen=True)
class SeekParameters(ParameterSet):
    """The seeks of the waveform ``seek``; those of other waveforms are not looked at."""

    source: str = parameter('list', 'where the targets come from: `targets`, or random seeks', choices=SOURCES)
    targets: tuple[float, ...] = parameter(
        (10.0, 0.0),
        'targets in this order, from the offset; in um, or in tracks if `track_pitch` is above 0. For the source list',
        unit='um',
    )
    track_pitch: float = parameter(
        0.0,
        'width of a track: `targets` are track numbers then, which need not be whole; 0 for targets in um',
        unit='um',
        minimum=0.0,
    )
    dwell_times: tuple[float, ...] = parameter(
        (0.02,),
        'time from the start of a seek to the start of the next one, rounded up to whole samples: one for all seeks, '
        'or one for each. The first seek starts at start_time',
        unit='s',
        above=0.0,
        maximum=1e6,
    )
    repeat: bool = parameter(
        True, 'whether the first target follows the last one and the list starts over; else the last target is held'
    )
    seed: int = parameter(1, 'seed of random seeks', minimum=0, maximum=2**53)
    count: int = parameter(100, 'number of random seeks', minimum=1, maximum=MOST_SEEKS)
    shortest: float = parameter(0.1, 'shortest random seek', unit='um', above=0.0)
    longest: float = parameter(100.0, 'longest random seek, at most `travel`', unit='um', above=0.0)
    length_distribution: str = parameter(
        'log_uniform',
        'distribution of the lengths of random seeks between the shortest and the longest: uniform, or uniform in '
        'the logarithm of the length',
        choices=LENGTH_DISTRIBUTIONS,
    )
    travel: float = parameter(
        100.0,
        'distance from the offset within which random targets stay: a seek whose random direction would leave it goes '
        'the other way',
        unit='um',
        above=0.0,
    )
    trajectory: str = parameter(
        'minimum_jerk',
        'how x_d moves to a target: at once (step), by the polynomial of degree 5 (minimum_jerk), or with as much '
        'acceleration as the bounds allow (time_optimal). The duration is rounded up to whole samples, by which a '
        'trajectory is slower than its bounds allow',
        choices=TRAJECTORIES,
    )
    acceleration: float = parameter(
        2e8, 'largest acceleration of a trajectory; about half of what the default drive has', unit='um/s^2', above=0.0
    )
    jerk: float = parameter(1e12, 'largest jerk of a trajectory; 0 for no bound', unit='um/s^3', minimum=0.0)
    velocity: float = parameter(0.0, 'largest velocity of a trajectory; 0 for no bound', unit='um/s', minimum=0.0)

    def check_together(self) -> None:
        """Check the rules that tie several parameters together; raises :class:`ParameterError`."""
        if self.source == 'list':
            if not self.targets:
                raise ParameterError('targets', self.targets, 'at least one target')
            if len(self.targets) > MOST_SEEKS:
                raise ParameterError('targets', f'a list of {len(self.targets)}', f'at most {MOST_SEEKS} targets')
        elif self.longest < self.shortest:
            raise ParameterError('longest', self.longest, f'at least shortest = {self.shortest!r} um')
        elif self.travel < self.longest:
            raise ParameterError(
                'travel', self.travel, f'at least longest = {self.longest!r} um, so that one direction is free'
            )
        seeks = len(self.targets) if self.source == 'list' else self.count
        if len(self.dwell_times) not in (1, seeks):
            number = len(self.dwell_times)
            raise ParameterError(
                'dwell_times',
                self.dwell_times,
                f'one time for all seeks, or one for each of {seeks}; there are {number}',
            )
