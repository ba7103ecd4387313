"""Parameters of the run and the lockstep, not of a block; no ROS import."""

import dataclasses
from collections.abc import Mapping

from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter
from hdd_servo_ros.parameters.schedule import FORM, Change, parse_schedule


@dataclasses.dataclass(frozen=True)
class PeerParameters(ParameterSet):
    """Time limits of a loop node for the other nodes, in wall time."""

    start_timeout: float = parameter(
        60.0,
        'before the run: timeout for a missing node, counted from the last change among the nodes; 0 waits forever',
        unit='s',
        minimum=0.0,
        read_only=True,
    )
    peer_timeout: float = parameter(
        3.0,
        'during the run: timeout for a silent node while no tick completes; three times as long while ticks continue',
        unit='s',
        minimum=0.5,
        maximum=60.0,
        read_only=True,
    )


LONGEST_RUN = 2.0e9
"""Limit [s]: a ROS time stamp has 31 bits for the seconds."""


@dataclasses.dataclass(frozen=True)
class SampleTimeParameters(ParameterSet):
    """Sample time that a node checks against the timer's."""

    sample_time: float = parameter(
        0.0,
        'sample time T that this node requires; 0 accepts that of deterministic_timer',
        unit='s',
        minimum=0.0,
        read_only=True,
    )


@dataclasses.dataclass(frozen=True)
class TimerParameters(ParameterSet):
    """Parameters of `deterministic_timer`."""

    sample_time: float = parameter(
        1e-4, 'sample time T; an integer number of nanoseconds', unit='s', above=0.0, read_only=True
    )
    duration: float = parameter(
        1.0,
        'duration of the run, ticks 0 to duration/T; 0 for as long as a node with a plan needs (signal_analyzer)',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_RUN,
        read_only=True,
    )
    rate: float = parameter(
        0.0,
        'real-time factor: 0 as fast as possible, 1 real time, 0.1 slow motion; does not affect the results',
        minimum=0.0,
    )
    lookahead: int = parameter(
        2,
        'number of ticks by which `/clock` may lead the last `/control`; hides one hop between processes',
        unit='ticks',
        minimum=0,
        maximum=16,
        read_only=True,
    )
    record: bool = parameter(True, 'wait for a bag_recorder before the run starts', read_only=True)
    autostart: bool = parameter(
        True, 'start the ticks as soon as all nodes are ready; false waits for ~/start', read_only=True
    )
    progress: bool = parameter(True, 'show progress with the real-time factor')
    schedule: tuple[str, ...] = parameter(
        (), f'parameter changes at exact ticks, each a string {FORM}', read_only=True, element=str
    )

    def check_together(self) -> None:
        """Reject a T that is not an integer number of nanoseconds, and a duration that is not a multiple of T."""
        try:
            sample_time_to_nanoseconds(self.sample_time)
        except ValueError:
            raise ParameterError(
                'sample_time', self.sample_time, 'a positive integer number of nanoseconds [s]'
            ) from None
        if self.duration == 0.0:
            if self.schedule:
                allowed = 'empty with duration = 0, since the times must be within a given duration'
                raise ParameterError('schedule', self.schedule, allowed)
            return
        if abs(self.duration / self.sample_time - self.last_tick) > 1e-6 * self.last_tick or self.last_tick < 1:
            raise ParameterError('duration', self.duration, f'a multiple of sample_time = {self.sample_time!r} s [s]')

        parse_schedule(self.schedule, self.sample_time, self.last_tick)

    @property
    def changes(self) -> tuple[Change, ...]:
        """The parsed schedule, in the order of its ticks."""
        return parse_schedule(self.schedule, self.sample_time, self.last_tick)

    @property
    def last_tick(self) -> int:
        """N, the number of the last tick; 0 if a node's plan sets it, see :func:`last_tick_of_run`."""
        return round(self.duration / self.sample_time)


def last_tick_of_run(timer: TimerParameters, needed: Mapping[str, int]) -> int:
    """
    Return the number N of the last tick of a run.

    Parameters
    ----------
    timer
        The timer's parameters.
    needed
        Last tick of each node with a plan, by node name.

    Raises
    ------
    ParameterError
        If the duration is shorter than a plan, or 0 without a plan.
    """
    name = 'deterministic_timer:duration'
    if not needed:
        if timer.duration == 0.0:
            raise ParameterError(name, 0.0, 'above 0 s, since no node of this run defines the duration')
        return timer.last_tick
    node, longest = max(needed.items(), key=lambda item: item[1])
    if longest * timer.sample_time > LONGEST_RUN:
        allowed = f'a run of at most {LONGEST_RUN:g} s; {node} needs {longest * timer.sample_time:.3g} s'
        raise ParameterError(name, timer.duration, allowed)
    if timer.duration == 0.0:
        return longest
    if timer.last_tick < longest:
        allowed = f'0 (as long as {node} needs), or at least {longest * timer.sample_time:.9g} s'
        raise ParameterError(name, timer.duration, allowed)
    return timer.last_tick


@dataclasses.dataclass(frozen=True)
class RecorderParameters(ParameterSet):
    """Parameters of `bag_recorder`."""

    run_dir: str = parameter(
        '',
        'run directory; empty creates runs/<date-time>-<controller> in the working directory',
        read_only=True,
    )
    storage: str = parameter('mcap', 'storage of the bag', choices=('mcap', 'sqlite3'), read_only=True)
    compression: str = parameter(
        'none',
        'compression of an mcap bag, chunk by chunk; saves disk space and costs processor time',
        choices=('none', 'zstd'),
        read_only=True,
    )
    max_bag_size: int = parameter(
        0,
        'size at which an mcap bag continues in another file; 0 for a single file',
        unit='bytes',
        minimum=0,
        read_only=True,
    )
    max_bag_duration: float = parameter(
        0.0,
        'simulated time after which an mcap bag continues in another file; 0 for a single file',
        unit='s',
        minimum=0.0,
        read_only=True,
    )
    topics: tuple[str, ...] = parameter(
        (),
        'loop topics to record, such as head and control; empty for all; parameter events are always recorded',
        read_only=True,
        element=str,
    )

    def check_together(self) -> None:
        """Reject options of MCAP with another storage, and topics outside the loop."""
        if self.storage != 'mcap':
            for name in ('compression', 'max_bag_size', 'max_bag_duration'):
                default = next(field.default for field in dataclasses.fields(self) if field.name == name)
                if getattr(self, name) != default:
                    allowed = f'{default!r} with storage = {self.storage!r}'
                    raise ParameterError(name, getattr(self, name), allowed)
        names = [topic.name for topic in ALL_LOOP_TOPICS]
        if not set(self.topics) <= set(names):
            raise ParameterError('topics', self.topics, f'a list, each element one of {", ".join(names)}')


@dataclasses.dataclass(frozen=True)
class PlaybackParameters(ParameterSet):
    """Parameters of `playback`."""

    recorded_run: str = parameter(
        '',
        'directory of a recorded run whose /disturbance and /base_acceleration are published again; empty for none',
        read_only=True,
    )


@dataclasses.dataclass(frozen=True)
class DriveIdentityParameters(ParameterSet):
    """Properties of a drive for reports that do not affect its motion."""

    frame_id: str = parameter('seagate_7200_10', 'name of the drive, in the header of every message', read_only=True)
    track_pitch: float = parameter(
        1.016,
        'track pitch; reports also give errors as a percentage of it; 1.016 um is 25000 tracks per inch, 0.254 um '
        '100000 and 0.0527 um 482000',
        unit='um',
        above=0.0,
        read_only=True,
    )
