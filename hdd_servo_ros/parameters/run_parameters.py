"""Parameters that belong to the run and the lockstep rather than to a block; no ROS import."""

import dataclasses
from collections.abc import Mapping

from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter
from hdd_servo_ros.parameters.schedule import FORM, Change, parse_schedule


@dataclasses.dataclass(frozen=True)
class PeerParameters(ParameterSet):
    """How long a node of the loop waits for others, in wall time."""

    start_timeout: float = parameter(
        60.0,
        'before the run: how long to wait for a missing peer since the last change among the peers; 0 waits for ever',
        unit='s',
        minimum=0.0,
        read_only=True,
    )
    peer_timeout: float = parameter(
        3.0,
        'during the run: how long a peer may stay silent before the run fails if the loop stands still; three times as '
        'long while ticks go on',
        unit='s',
        minimum=0.5,
        maximum=60.0,
        read_only=True,
    )


LONGEST_RUN = 2.0e9
"""[s]; a stamp counts its seconds in 31 bits."""


@dataclasses.dataclass(frozen=True)
class SampleTimeParameters(ParameterSet):
    """A node's own idea of T, for those who want it checked."""

    sample_time: float = parameter(
        0.0,
        'sample time T that this node insists on; 0 takes the one of deterministic_timer',
        unit='s',
        minimum=0.0,
        read_only=True,
    )


@dataclasses.dataclass(frozen=True)
class TimerParameters(ParameterSet):
    """Parameters of `deterministic_timer`."""

    sample_time: float = parameter(
        1e-4, 'sample time T; a whole number of nanoseconds', unit='s', above=0.0, read_only=True
    )
    duration: float = parameter(
        1.0,
        'length of the run; ticks 0 to duration/T; 0 for as long as a node takes that has a plan (signal_analyzer)',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_RUN,
        read_only=True,
    )
    rate: float = parameter(
        0.0,
        'pace: 0 as fast as the graph goes, 1 real time, 0.1 slow motion; the bits do not depend on it',
        minimum=0.0,
    )
    lookahead: int = parameter(
        2,
        'how many ticks `/clock` may run ahead of the last `/control`; hides one hop between processes',
        unit='ticks',
        minimum=0,
        maximum=16,
        read_only=True,
    )
    record: bool = parameter(True, 'whether the run waits for a bag_recorder', read_only=True)
    autostart: bool = parameter(
        True, 'whether the ticks begin once all nodes are ready; false waits for ~/start', read_only=True
    )
    progress: bool = parameter(True, 'whether to show progress with the real-time factor')
    schedule: tuple[str, ...] = parameter(
        (), f'parameter changes that take effect at exact ticks, each a text {FORM}', read_only=True, element=str
    )

    def check_together(self) -> None:
        """Reject a T that is no whole number of nanoseconds, and a duration that holds no whole number of ticks."""
        try:
            sample_time_to_nanoseconds(self.sample_time)
        except ValueError:
            raise ParameterError(
                'sample_time', self.sample_time, 'a positive integer number of nanoseconds [s]'
            ) from None
        if self.duration == 0.0:
            if self.schedule:
                allowed = 'empty with duration = 0: its times must lie within a duration that is given'
                raise ParameterError('schedule', self.schedule, allowed)
            return
        if abs(self.duration / self.sample_time - self.last_tick) > 1e-6 * self.last_tick or self.last_tick < 1:
            raise ParameterError('duration', self.duration, f'a multiple of sample_time = {self.sample_time!r} s [s]')

        parse_schedule(self.schedule, self.sample_time, self.last_tick)

    @property
    def changes(self) -> tuple[Change, ...]:
        """The schedule, read and in the order of its ticks."""
        return parse_schedule(self.schedule, self.sample_time, self.last_tick)

    @property
    def last_tick(self) -> int:
        """N, the number of the last tick; 0 where a node's plan decides, see :func:`last_tick_of_run`."""
        return round(self.duration / self.sample_time)


def last_tick_of_run(timer: TimerParameters, needed: Mapping[str, int]) -> int:
    """
    Return N of a run.

    Parameters
    ----------
    timer
        The timer's parameters.
    needed
        The last tick of each node that has a plan of its own, by the node's name.

    Raises
    ------
    ParameterError
        If the duration is shorter than a plan, or 0 without any.
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
        '', 'folder of the run; empty makes runs/<date-time>-<controller> below the working folder', read_only=True
    )
    storage: str = parameter('mcap', 'storage of the bag', choices=('mcap', 'sqlite3'), read_only=True)
    compression: str = parameter(
        'none',
        'compression of an mcap bag, chunk by chunk: a run takes less space and more processor time',
        choices=('none', 'zstd'),
        read_only=True,
    )
    max_bag_size: int = parameter(
        0,
        'size beyond which an mcap bag goes on in another file; 0 for one file of any size',
        unit='bytes',
        minimum=0,
        read_only=True,
    )
    max_bag_duration: float = parameter(
        0.0,
        'simulated time after which an mcap bag goes on in another file; 0 for one file of any duration',
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
        """Reject what only MCAP can do with another storage, and topics that are none of the loop."""
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
        'folder of a recorded run whose /disturbance and /base_acceleration are published again in this run; empty for '
        'none',
        read_only=True,
    )


@dataclasses.dataclass(frozen=True)
class DriveIdentityParameters(ParameterSet):
    """What reports need to know of a drive and its motion does not depend on."""

    frame_id: str = parameter('seagate_7200_10', 'name of the drive, in the header of every message', read_only=True)
    track_pitch: float = parameter(
        1.016,
        'track pitch, of which reports give position errors in per cent; 1.016 um is 25000 tracks per inch, 0.254 um '
        '100000 and 0.0527 um 482000',
        unit='um',
        above=0.0,
        read_only=True,
    )
