"""Recorded run: signals as arrays aligned by tick, metadata, and the values of parameters over time."""

import functools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.codecs import CODECS
from hdd_servo_ros.messages.outcome import FINISHED, RUNNING
from hdd_servo_ros.messages.signals import SignalRows, Signals
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND, NANOSECONDS, sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import (
    ALL_LOOP_TOPICS,
    CLOCK,
    ESTIMATES,
    PARAMETER_EVENT_TYPE,
    PARAMETER_EVENTS,
    SIGNAL_TOPICS,
)
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.recording.bag_columns import Bag, BagError, Column, bag_directory, joined
from hdd_servo_ros.recording.decoding import array_names, check_layout, stamps_of, values_of
from hdd_servo_ros.recording.parameter_history import ParameterChange, ParameterHistory
from hdd_servo_ros.recording.run_folder import DescriptionError, read_run_yaml

_WALL_CLOCK = 10**17
"""Smallest stamp taken as wall-clock time instead of run time: three years, or 1973 in Unix time [ns]."""

LONG_RUN = 2**17
"""Number of ticks from which a run is long: its arrays then take some hundred megabytes."""
OpenedRun = TypeVar('OpenedRun', bound='RecordedRun')


class RecordedRun(Signals):
    """
    Recorded run, opened with :meth:`RecordedRun.open`.

    Opening verifies the checksums of the bag's files and decodes nothing. A topic is decoded and kept on first access;
    :meth:`verify` decodes all of them. All arrays have one row per tick of :attr:`ticks`. Units are those of the topics
    (see ``hdd_servo_ros.messages.topics``): lengths in :attr:`length_unit`, which is um unless the drive's parameter
    file sets another one, control in :attr:`control_unit`, time in s.

    Attributes
    ----------
    path
        Path that was opened.
    description
        Content of ``run.yaml``; empty for a bag without one.
    """

    def __init__(self, path: Path, bag: Bag, description: dict[str, Any], topics: dict[str, str]) -> None:
        self.path = path
        self.description = description
        self._bag = bag
        self._topics = topics
        self._arrays: dict[str, NDArray[Any]] = {}
        self._read_topics: set[str] = set()
        self.is_checked = False
        """Whether checksums of the whole bag were verified; if not, each topic is checked when it is read."""

    @classmethod
    def open(cls: type[OpenedRun], path: str | Path, *, namespace: str | None = None) -> OpenedRun:
        """
        Open a run.

        Parameters
        ----------
        path
            Run directory, its bag, or a bag of the graph's topics recorded by `ros2 bag record`.
        namespace
            Namespace whose topics to read, if a bag without ``run.yaml`` contains several rigs.

        Raises
        ------
        FileNotFoundError
            If a closed bag does not exist.
        BagError
            If the bag cannot be read, is damaged, contradicts ``run.yaml``, or contains the same topic in several
            namespaces and none is given.
        DescriptionError
            If the run's ``run.yaml`` cannot be read.
        """
        path = Path(path)
        bag = Bag(bag_directory(path))
        description: dict[str, Any] = {}
        for directory in (path, path.parent):
            if (directory / 'bag' / 'metadata.yaml').is_file() and (directory / 'run.yaml').is_file():
                description = read_run_yaml(directory)
                if not isinstance(description.get('topics'), dict):
                    raise DescriptionError(f'{directory / "run.yaml"} does not describe a run: it lists no topics')
                break
        topics = dict(description['topics']) if description else _loop_topics(bag, namespace)
        if description:
            _compare_with_bag(path, description, topics, bag)
        is_checked = bag.check()
        run = cls(path, bag, description, topics)
        run.is_checked = is_checked
        return run

    @classmethod
    def open_bag(
        cls: type[OpenedRun], path: Path, sample_time: float | None = None, topics: Mapping[str, str] | None = None
    ) -> OpenedRun:
        """
        Open a bag with the topics listed in ``run.yaml``, but without checking how the run ended.

        Parameters
        ----------
        path
            The bag.
        sample_time
            T [s]; None for the value in the bag.
        topics
            Full name of each loop topic, by its name without namespace. If None or empty, topics are identified by name
            and type.

        Raises
        ------
        BagError
            If the bag cannot be read, or lacks one of the topics.
        """
        bag = Bag(path)
        _require_topics(path, (topics or {}).values(), bag)
        _require_types(path, topics or {}, bag)
        bag.check()
        run = cls(path, bag, {}, dict(topics) if topics else _loop_topics(bag, None))
        if sample_time is not None:
            run.__dict__['sample_time'] = sample_time
        return run

    @property
    def message_count(self) -> int:
        """Number of messages of the bag, on all topics."""
        return sum(self._bag.counts.values())

    @functools.cached_property
    def is_long(self) -> bool:
        """Whether the run is long and can be read in pieces; see :meth:`pieces`."""
        return bool(self.description) and max(self.counts.values(), default=0) >= LONG_RUN and self._is_strict

    def pieces(self, topics: Collection[str] | None = None, first_tick: int = 0) -> Iterator[Signals]:
        """
        Iterate over the signals of the run in pieces of consecutive ticks, so that a long run needs little memory.

        A short run is a single piece, the run itself, whose arrays are kept.

        Parameters
        ----------
        topics
            Names without namespace of the topics to read; None for all topics with fields.
        first_tick
            First tick of the first piece; only for a long run.

        Raises
        ------
        BagError
            See :meth:`__getitem__`.
        """
        if not self.is_long:
            yield self
            return
        names = [
            topic.name for topic in SIGNAL_TOPICS if topic.name in self and (topics is None or topic.name in topics)
        ]
        tick = first_tick
        estimate_names: tuple[str, ...] = ()
        since = first_tick * sample_time_to_nanoseconds(self.sample_time)
        for columns in self._aligned({self._topics[name]: name for name in names}, since):
            arrays = {}
            count = len(next(iter(columns.values())))
            ticks = np.arange(tick, tick + count)
            for name, column in columns.items():
                self._check_layout(name, column)
                stamps = self._stamps(name, column)
                self._check_ticks(name, column, stamps, ticks)
                arrays[name] = values_of(column, self._bag.types[self._topics[name]])
                if name == ESTIMATES.name and not estimate_names:
                    estimate_names = array_names(column)
            yield SignalRows(tick, self.sample_time, arrays, estimate_names, self.units)
            tick += count

    def column_pieces(self, topics: Collection[str]) -> Iterator[dict[str, Column]]:
        """
        Iterate over the recorded messages of loop topics, with the same number of messages of each topic per piece.

        Parameters
        ----------
        topics
            Names without namespace.

        Raises
        ------
        BagError
            If the bag cannot be read, or the topics have different numbers of messages.
        """
        yield from self._aligned({self._topics[name]: name for name in topics})

    def _aligned(self, names: Mapping[str, str], since: int = 0) -> Iterator[dict[str, Column]]:
        """Iterate over columns of equal length from a time [ns] on; ``names`` maps full topic names to keys."""
        waiting: dict[str, list[Column]] = {name: [] for name in names.values()}
        for piece in self._bag.pieces(list(names), since):
            for full_name, column in piece.items():
                waiting[names[full_name]].append(column)
            count = min(sum(map(len, parts)) for parts in waiting.values())
            if not count:
                continue
            taken = {name: joined(parts) for name, parts in waiting.items()}
            yield {name: column[:count] for name, column in taken.items()}
            waiting = {name: [column[count:]] for name, column in taken.items()}
        for name, parts in waiting.items():
            if sum(map(len, parts)):
                raise BagError(f'{self.path}: {self._topics[name]} has messages of more ticks than other topics')

    def verify(self) -> None:
        """
        Read the whole bag: every message of every topic, and the time line of the loop topics.

        Raises
        ------
        BagError
            If a part of it cannot be read or is invalid.
        """
        known = {full_name: name for name, full_name in self._topics.items()}
        # In a bag of this package's recorder, ticks begin with 0.
        is_own = 'sample_time' in self._bag.custom_data and len({*self.counts.values()}) == 1
        if is_own and max(self._bag.counts.values(), default=0) >= LONG_RUN:
            self._verify_in_pieces(known)
            return
        for topic in self._bag.types:
            column = self._bag.column(topic)
            if len(column) and topic in known:
                self._decoded(known[topic])

    def _verify_in_pieces(self, known: Mapping[str, str]) -> None:
        tick = 0
        for columns in self._aligned(known):
            count = len(next(iter(columns.values())))
            if not tick:
                # From the first piece, because the property itself would read whole topics.
                self.__dict__['_origin'] = self._origin_of_columns(columns)
            for name, column in columns.items():
                self._check_layout(name, column)
                stamps = self._stamps(name, column)
                self._check_ticks(name, column, stamps, np.arange(tick, tick + count))
                values_of(column, self._bag.types[self._topics[name]])
            tick += count
        for topic in self._bag.types.keys() - known.keys():
            self._bag.column(topic)

    def __repr__(self) -> str:
        # Only attributes that need no decoding, so that it works for a damaged run too.
        known = [repr(str(self.path))]
        last_tick, sample_time = self.description.get('last_tick'), self.description.get('sample_time')
        if self.description:
            known.append(f'{self.controller} on {self.frame_id}')
        if isinstance(last_tick, int) and isinstance(sample_time, float):
            known.append(f'{last_tick + 1} ticks of {sample_time:g} s')
        if self.description:
            known.append(self.status)
        return f'{type(self).__name__}({", ".join(known)})'

    # Metadata.

    def _metadata(self, key: str, default: Any) -> Any:
        return self.description.get(key, self._bag.custom_data.get(key, default))

    @property
    def status(self) -> str:
        """How the run ended, ``finished``, ``interrupted`` or ``failed``; ``running`` if it was killed."""
        return str(self.description.get('status', 'unknown'))

    @property
    def reason(self) -> str:
        """Why the run ended, if it was not ``finished``."""
        return str(self.description.get('reason', ''))

    @property
    def controller(self) -> str:
        """Short name of the controller."""
        return str(self.description.get('controller', 'unknown'))

    @property
    def frame_id(self) -> str:
        """Name of the drive."""
        return str(self._metadata('frame_id', 'unknown'))

    @functools.cached_property
    def units(self) -> Units:
        """Units of the drive."""
        return Units(str(self._metadata('length_unit', 'um')), str(self._metadata('control_unit', 'V')))

    @property
    def length_unit(self) -> str:
        """Unit of positions."""
        return self.units.length

    @property
    def control_unit(self) -> str:
        """Unit of the control."""
        return self.units.control

    @property
    def error_unit(self) -> str:
        """Unit in which errors are shown: nm if lengths are in um, otherwise the unit of lengths."""
        return self.units.error

    @property
    def error_factor(self) -> float:
        """Factor from the unit of lengths to :attr:`error_unit`."""
        return self.units.error_factor

    @functools.cached_property
    def sample_time(self) -> float:
        """T [s]; without metadata, the smallest step between two stamps of `/clock`."""
        recorded = self._metadata('sample_time', None)
        if recorded is not None:
            return float(recorded)
        topic = next((name for name in (CLOCK.name, *self._topics) if self.counts.get(name, 0) > 1), None)
        if topic is None:
            raise BagError(f'{self.path}: unknown sample time: no loop topic has two messages')
        steps = np.diff(np.unique(self._stamps(topic, self.column(topic))))
        if not len(steps):
            raise BagError(f'{self.path}: unknown sample time: all stamps of {self._topics[topic]} are equal')
        return int(steps.min()) / NANOSECONDS

    @property
    def topics(self) -> dict[str, str]:
        """Type of every topic of the bag, by its full name."""
        return dict(self._bag.types)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of every loop topic, by its name without namespace."""
        return {name: self._bag.counts.get(full_name, 0) for name, full_name in self._topics.items()}

    # The time line.

    @functools.cached_property
    def _is_strict(self) -> bool:
        """Whether this package recorded the bag: receive times are tick times, and every topic has every tick."""
        if self.description:
            # A run that ended early may end within a tick.
            return self.status == FINISHED or len(set(self.counts.values())) == 1
        counts = {count for count in self.counts.values() if count}
        if not self.counts.get(CLOCK.name) or len(counts) != 1:
            return False
        # `ros2 bag record` with use_sim_time takes receive times from /clock, which lags the other topics.
        clock = self.column(CLOCK.name).times
        columns = {name: self.column(name) for name, count in self.counts.items() if count}
        return all(np.array_equal(column.times, clock) for column in columns.values()) and np.array_equal(
            self._stamps(CLOCK.name, columns[CLOCK.name]), clock
        )

    @functools.cached_property
    def _origin(self) -> int:
        """Time of tick 0 [ns]: 0, or the first stamp if stamps are wall-clock times."""
        if self.description:
            return 0
        return self._origin_of_columns({name: self.column(name) for name, count in self.counts.items() if count})

    def _origin_of_columns(self, columns: Mapping[str, Column]) -> int:
        """Return the time of tick 0 [ns] by the first stamps of topics, given by name without namespace."""
        firsts = [
            int(self._stamps(name, column[:1])[0])
            for name, column in columns.items()
            if CODECS[self._bag.types[self._topics[name]]].is_stamped
        ]
        first = min(firsts, default=0)
        return first if first >= _WALL_CLOCK else 0

    def _origin_of(self, stamps: NDArray[np.int64]) -> int:
        """Return the time of tick 0 for the stamps of a topic; arrays may have run time where others have wall time."""
        return self._origin if len(stamps) and stamps[0] >= _WALL_CLOCK else 0

    def tick_of(self, stamp: int) -> int:
        """Return the tick nearest to a stamp [ns]."""
        origin = self._origin if stamp >= _WALL_CLOCK else 0
        return round((stamp - origin) / sample_time_to_nanoseconds(self.sample_time))

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """
        Ticks present on all loop topics, ascending; 0 to :attr:`last_tick` in a run of the rig's recorder.

        If stamps are wall-clock times, the first one is tick 0.

        Raises
        ------
        BagError
            If no tick exists, a stamp does not fall on a tick, or the stamps of a topic go back or repeat, as in a
            bag that contains several runs.
        """
        present = [name for name, count in self.counts.items() if count]
        if not present:
            raise BagError(f'{self.path}: the bag contains no tick: no message on a loop topic')
        if self._is_strict:
            name = CLOCK.name if CLOCK.name in present else present[0]
            return self._rising(name, self._to_ticks(name, self.column(name).times))
        common: NDArray[np.int64] | None = None
        for name in present:
            ticks = self._rising(name, self._to_ticks(name, self._stamps(name, self.column(name))))
            common = ticks if common is None else np.intersect1d(common, ticks, assume_unique=True)
        assert common is not None
        if not len(common):
            raise BagError(f'{self.path}: the bag contains no tick that is common to {", ".join(present)}')
        return common

    @property
    def last_tick(self) -> int:
        """N, the last tick."""
        # A long run begins with tick 0, and each tick is checked when it is read.
        return max(self.counts.values()) - 1 if self.is_long else int(self.ticks[-1])

    @property
    def duration(self) -> float:
        """Time of the last tick [s]."""
        if self.is_long:
            return self.last_tick * sample_time_to_nanoseconds(self.sample_time) / NANOSECONDS
        return float(self.time[-1])

    @functools.cached_property
    def time(self) -> NDArray[np.float64]:
        """Time of each tick [s], shape (n,)."""
        return self.ticks * sample_time_to_nanoseconds(self.sample_time) / NANOSECONDS

    def time_at(self, row: int) -> float:
        """Return ``time[row]`` [s] for a row >= 0; for a long run, without an array of all times."""
        if self.is_long:
            return row * sample_time_to_nanoseconds(self.sample_time) / NANOSECONDS
        return float(self.time[row])

    @property
    def row_count(self) -> int:
        """Number of ticks, the length of every array."""
        return self.last_tick + 1 if self.is_long else len(self.ticks)

    def since(self, time: float) -> slice:
        """Return the rows from ``time`` [s] on."""
        if not self.is_long:
            return super().since(time)
        earliest = time - HALF_MICROSECOND
        row = min(max(math.floor(earliest / self.sample_time) - 1, 0), self.row_count)
        while row < self.row_count and self.time_at(row) < earliest:
            row += 1
        return slice(row, self.row_count)

    # Signals.

    def __getitem__(self, topic: str) -> NDArray[Any]:
        """
        Return a topic as an array with one row per tick.

        Parameters
        ----------
        topic
            Name without namespace, such as ``head``, or full name in the bag. A vector gives columns x, y and z, shape
            (n, 3); an array its elements, shape (n, m); the clock its time [ns], shape (n,).

        Raises
        ------
        KeyError
            If the bag does not contain the topic.
        BagError
            If its messages do not match the ticks.
        """
        name = next((short for short, full in self._topics.items() if topic in (short, full)), topic)
        if name not in self._arrays:
            self._arrays[name] = self._decoded(name)
        return self._arrays[name]

    def __contains__(self, topic: str) -> bool:
        """Return whether the bag contains messages of a loop topic."""
        return any(topic in (name, self._topics[name]) and count > 0 for name, count in self.counts.items())

    @functools.cached_property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``run['estimates']``."""
        if self.is_long and ESTIMATES.name in self:
            return next(iter(self.pieces([ESTIMATES.name]))).estimate_names
        return array_names(self.column(ESTIMATES.name))

    # Messages of any topic, and parameters.

    def messages_by_topic(self) -> dict[str, tuple[NDArray[np.int64], list[bytes]]]:
        """Return for every topic of the bag, by full name, the receive times [ns], shape (n,), and the n payloads."""
        columns = {topic: self._bag.column(topic) for topic in self._bag.types}
        return {topic: (column.times, column.as_bytes()) for topic, column in columns.items()}

    def messages(self, topic: str) -> list[tuple[int, Any]]:
        """
        Return receive time [ns] and deserialized message of every message on a topic, given by its full name.

        Slow; meant for topics outside the loop, such as `/parameter_events`.

        Raises
        ------
        KeyError
            If the bag does not contain the topic.
        """
        if topic not in self._bag.types:
            raise self._missing(topic)
        column = self._bag.column(topic)
        if not len(column):
            return []
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS2_JAZZY)
        kind = self._bag.types[topic]
        messages = [types.deserialize_cdr(payload, kind) for payload in column.as_bytes()]
        return list(zip(column.times.tolist(), messages, strict=True))

    @functools.cached_property
    def _parameter_history(self) -> ParameterHistory:
        """The value of every parameter at every tick."""
        nodes = self.description.get('nodes', {})
        return ParameterHistory.recorded(self._bag, nodes, sample_time_to_nanoseconds(self.sample_time), self._origin)

    @property
    def parameter_changes(self) -> Sequence[ParameterChange]:
        """Parameter changes during the run, in the order of their ticks."""
        return self._parameter_history.changes

    def parameter(self, node: str, name: str, tick: int | None = None) -> Any:
        """
        Return the value of a parameter at a tick.

        Parameters
        ----------
        node
            Node's name, with or without namespace.
        name
            The parameter's dotted name.
        tick
            The tick; the last one if None.

        Raises
        ------
        LookupError
            If the run has no such node or parameter, or the tick is outside the run.
        """
        if tick is not None and not 0 <= tick <= self.last_tick:
            raise LookupError(f'{self.path}: tick {tick} is outside the run (ticks 0 to {self.last_tick})')
        return self._parameter_history.value(node, name, tick)

    # Decoding.

    def column(self, topic: str) -> Column:
        """
        Return the recorded messages of a loop topic, given by its name without namespace.

        Raises
        ------
        KeyError
            If the bag does not contain the topic.
        """
        full_name = self._topics.get(topic, '')
        if full_name not in self._bag.types:
            raise self._missing(topic)
        column = self._bag.column(full_name)
        if topic not in self._read_topics:
            self._check_layout(topic, column)
            self._read_topics.add(topic)
        return column

    def _check_layout(self, topic: str, column: Column) -> None:
        full_name = self._topics[topic]
        try:
            check_layout(column, self._bag.types[full_name])
        except BagError as error:
            raise BagError(f'{self.path}: {full_name}: {error}') from None

    def stamps(self, topic: str) -> NDArray[np.int64]:
        """
        Return the time stamp in each message of a loop topic [ns], given by its name without namespace.

        Raises
        ------
        KeyError
            If the bag does not contain the topic.
        BagError
            If the messages are arrays of different length.
        """
        column = self.column(topic)
        return self._stamps(topic, column) if len(column) else column.times

    def message_ticks(self, topic: str) -> NDArray[np.int64]:
        """Return the tick of each message of a topic by its stamp; raise :class:`BagError` if it is not on a tick."""
        return self._to_ticks(topic, self.stamps(topic))

    def _missing(self, topic: str) -> '_MissingTopic':
        return _MissingTopic(
            f'{self.path}: the bag does not contain topic {topic}; it contains {", ".join(self._bag.types)}'
        )

    def _estimate_error(self) -> Callable[[str], KeyError]:
        path = self.path
        return lambda text: _MissingTopic(f'{path}: {text}')

    def _stamps(self, name: str, column: Column) -> NDArray[np.int64]:
        """Return the time stamps in the messages [ns]."""
        return stamps_of(column, self._bag.types[self._topics[name]])

    def _to_ticks(self, name: str, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the ticks of the stamps [ns] of a topic's messages."""
        period = sample_time_to_nanoseconds(self.sample_time)
        for message in np.flatnonzero(stamps < 0)[:1].tolist():
            raise BagError(
                f'{self.path}: {self._topics[name]}: message {message} has stamp {stamps[message]} ns, before time 0'
            )
        origin = self._origin_of(stamps)
        times = stamps - origin
        ticks = (times + period // 2) // period
        # The time in an array is a float64 [s].
        is_stamped = CODECS[self._bag.types[self._topics[name]]].is_stamped
        tolerance = 0 if is_stamped else np.ceil(NANOSECONDS * np.spacing(stamps / NANOSECONDS))
        off = np.abs(times - ticks * period) > tolerance
        for message in np.flatnonzero(off)[:1].tolist():
            since = f', {times[message]} ns after the first' if origin else ''
            raise BagError(
                f'{self.path}: {self._topics[name]}: message {message} has stamp {stamps[message]} ns{since}, '
                f'which does not fall on a tick of {self.sample_time:g} s'
            )
        return ticks

    def _rising(self, name: str, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the ticks of a topic's messages; raise BagError unless they increase, as in a single run."""
        for message in np.flatnonzero(np.diff(ticks) <= 0)[:1].tolist():
            before, after = ticks[message : message + 2].tolist()
            found = f'goes back from tick {before} to {after}' if after < before else f'has tick {after} twice'
            raise BagError(
                f'{self.path}: {self._topics[name]} {found} at message {message + 1}: the bag contains more than one '
                'run, or a topic with two publishers; record each run in a bag of its own'
            )
        return ticks

    def _decoded(self, name: str) -> NDArray[Any]:
        column = self.column(name)
        stamps = self._stamps(name, column) if len(column) else column.times
        ticks = self.ticks
        rows: NDArray[np.int64] | None = None
        if self._is_strict:
            self._check_ticks(name, column, stamps, ticks)
        else:
            if not len(column):
                raise BagError(f'{self.path}: no message on {self._topics[name]}')
            rows = np.searchsorted(self._rising(name, self._to_ticks(name, stamps)), ticks)
        values = values_of(column, self._bag.types[self._topics[name]])
        values = values if rows is None else values[rows]
        values.flags.writeable = False
        return values

    def _check_ticks(self, name: str, column: Column, stamps: NDArray[np.int64], ticks: NDArray[np.int64]) -> None:
        """Check receive times and stamps of messages against their ticks."""
        full_name = self._topics[name]
        period = sample_time_to_nanoseconds(self.sample_time)
        if not np.array_equal(column.times - self._origin, ticks * period):
            raise BagError(f'{self.path}: the receive times of {full_name} do not match the ticks of the clock')
        # The time in an array is a float64, so it is compared as a tick.
        wrong = np.flatnonzero(np.rint((stamps - self._origin_of(stamps)) / period) != ticks)
        if len(wrong):
            raise BagError(f'{self.path}: {full_name}: the stamp of message {wrong[0]} does not match its tick')


class ClaimError(BagError):
    """A bag that contradicts ``run.yaml``."""


class _MissingTopic(KeyError, BagError):
    """A topic, or an element of the estimates, that the bag does not contain."""

    def __str__(self) -> str:
        return str(self.args[0])


def _require_topics(path: Path, topics: Iterable[str], bag: Bag) -> None:
    missing = [topic for topic in topics if topic not in bag.types]
    if missing:
        raise ClaimError(f'{path}: run.yaml lists {", ".join(missing)}, but metadata.yaml of the bag does not')


def _require_types(path: Path, topics: Mapping[str, str], bag: Bag) -> None:
    """Reject a bag whose metadata contain a wrong type for a loop topic."""
    declared = {topics[topic.name]: topic.type_name for topic in ALL_LOOP_TOPICS if topic.name in topics}
    for topic, kind in {**declared, PARAMETER_EVENTS: PARAMETER_EVENT_TYPE}.items():
        if bag.types.get(topic, kind) != kind:
            raise BagError(f'{path}: {topic} has type {bag.types[topic]} in the metadata of the bag; expected {kind}')


def _compare_with_bag(path: Path, description: dict[str, Any], topics: dict[str, str], bag: Bag) -> None:
    """Reject a bag that contradicts ``run.yaml``."""
    _require_topics(path, topics.values(), bag)
    _require_types(path, topics, bag)
    last_tick = description.get('last_tick')
    if isinstance(last_tick, int) and description.get('status') != RUNNING:
        # A run that ended early may end within a tick.
        counts = [bag.counts[topic] for topic in topics.values()] or [0]
        if not min(counts) - 1 <= last_tick <= max(counts) - 1:
            held = min(counts) - 1
            raise ClaimError(f'{path}: last_tick in run.yaml is {last_tick}, but the last tick in the bag is {held}')


def _loop_topics(bag: Bag, namespace: str | None) -> dict[str, str]:
    """Return the loop topics of a bag without ``run.yaml``, identified by last name and type."""
    found: dict[str, list[str]] = {}
    for topic in ALL_LOOP_TOPICS:
        for name, kind in bag.types.items():
            parent, _, own = name.rpartition('/')
            if own == topic.name and kind == topic.type_name and namespace in (None, parent, parent or '/'):
                found.setdefault(topic.name, []).append(name)
    for names in found.values():
        if len(names) > 1:
            raise BagError(f'{bag.path}: {" and ".join(names)} are both present; select one by namespace')
    return {name: names[0] for name, names in found.items()}
