"""A recorded run: its signals as arrays aligned by tick, its description, and the parameters in force."""

import dataclasses
import difflib
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import STAMP, array_names_and_offset
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.messages.ticks import NANOSECONDS, sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import (
    ARRAY_TYPE,
    CLOCK,
    CLOCK_TYPE,
    CONTROL,
    DISTURBANCE,
    ESTIMATES,
    HEAD,
    LDV,
    LOOP_TOPICS,
    PARAMETER_EVENTS,
    PARAMETER_VALUE_FIELDS,
    REFERENCE,
)
from hdd_servo_ros.recording.bag_columns import Bag, BagError, Column
from hdd_servo_ros.recording.run_folder import DescriptionError, read_run_yaml

OpenedRun = TypeVar('OpenedRun', bound='RecordedRun')


def bag_directory(path: Path) -> Path:
    """
    Return the bag of a run folder, or the path itself if it is a bag.

    Raises
    ------
    FileNotFoundError
        If it is neither.
    """
    for candidate in (path / 'bag', path):
        if (candidate / 'metadata.yaml').is_file():
            return candidate
    raise FileNotFoundError(f'{path} is neither a run folder nor a closed bag: no metadata.yaml in it or in its bag/')


@dataclasses.dataclass(frozen=True)
class ParameterChange:
    """A parameter that was changed during a run; ``tick`` is the first one with the new value."""

    tick: int
    node: str
    name: str
    value: Any


class RecordedRun:
    """
    A recorded run, opened with :meth:`RecordedRun.open`.

    Opening reads texts only. A topic is decoded when it is first asked for, and kept. All arrays have one row a tick of
    :attr:`ticks`, in the units of the topics (see ``hdd_servo_ros.messages.topics``): lengths in :attr:`length_unit`,
    um unless the drive's parameter file says otherwise, control in :attr:`control_unit`, time in s.

    Attributes
    ----------
    path
        What was opened.
    description
        Content of ``run.yaml``; empty for a bag without one.
    """

    def __init__(self, path: Path, bag: Bag, description: dict[str, Any], topics: dict[str, str]) -> None:
        self.path = path
        self.description = description
        self._bag = bag
        self._topics = topics
        self._arrays: dict[str, NDArray[Any]] = {}

    @classmethod
    def open(cls: type[OpenedRun], path: str | Path, *, namespace: str | None = None) -> OpenedRun:
        """
        Open a run.

        Parameters
        ----------
        path
            Run folder, its bag, or a bag that `ros2 bag record` made of the graph's topics.
        namespace
            Which rig's topics to read, where a bag without ``run.yaml`` holds those of several.

        Raises
        ------
        FileNotFoundError
            If there is no closed bag.
        BagError
            If the bag cannot be read, or holds the same topic in several namespaces and none is given.
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
                    raise DescriptionError(f'{directory / "run.yaml"} does not describe a run: it names no topics')
                break
        topics = dict(description['topics']) if description else _loop_topics(bag, namespace)
        return cls(path, bag, description, topics)

    def __repr__(self) -> str:
        return f'{type(self).__name__}({str(self.path)!r})'

    # What the run says of itself.

    def _said(self, key: str, default: Any) -> Any:
        return self.description.get(key, self._bag.custom_data.get(key, default))

    @property
    def status(self) -> str:
        """How the run ended: ``finished``, ``interrupted`` or ``failed``; ``running`` if it was killed."""
        return str(self.description.get('status', 'unknown'))

    @property
    def reason(self) -> str:
        """Why it ended, if it was not ``finished``."""
        return str(self.description.get('reason', ''))

    @property
    def controller(self) -> str:
        """Short name of the controller."""
        return str(self.description.get('controller', 'unknown'))

    @property
    def frame_id(self) -> str:
        """Name of the drive."""
        return str(self._said('frame_id', 'unknown'))

    @property
    def length_unit(self) -> str:
        """Unit of positions."""
        return str(self._said('length_unit', 'um'))

    @property
    def control_unit(self) -> str:
        """Unit of the control."""
        return str(self._said('control_unit', 'V'))

    @property
    def error_unit(self) -> str:
        """Unit in which errors are told to people: nm where lengths are in um, else the unit of lengths."""
        return 'nm' if self.length_unit == 'um' else self.length_unit

    @property
    def error_factor(self) -> float:
        """Factor from the unit of lengths to :attr:`error_unit`."""
        return 1e3 if self.length_unit == 'um' else 1.0

    @functools.cached_property
    def sample_time(self) -> float:
        """T [s]; of a bag that does not tell, the smallest step between two stamps of `/clock`."""
        said = self._said('sample_time', None)
        if said is not None:
            return float(said)
        topic = next((name for name in (CLOCK.name, *self._topics) if self.counts.get(name, 0) > 1), None)
        if topic is None:
            raise BagError(f'{self.path}: the sample time is not known: no topic of the loop has two messages')
        steps = np.diff(np.unique(self._stamps(topic, self.column(topic))))
        if not len(steps):
            raise BagError(f'{self.path}: the sample time is not known: all stamps of {self._topics[topic]} are equal')
        return int(steps.min()) / NANOSECONDS

    @property
    def topics(self) -> dict[str, str]:
        """Type of every topic of the bag, by its full name."""
        return dict(self._bag.types)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of every topic of the loop, by its name without namespace."""
        return {name: self._bag.counts.get(full_name, 0) for name, full_name in self._topics.items()}

    # The time line.

    @functools.cached_property
    def _is_strict(self) -> bool:
        """Whether the project's own recorder made the bag: receive times are ticks, and every topic has them all."""
        if self.description:
            # What is left of a run that was cut off may end within a tick.
            return self.status == FINISHED or len(set(self.counts.values())) == 1
        if not self.counts.get(CLOCK.name):
            return False
        clock = self.column(CLOCK.name)
        return np.array_equal(self._stamps(CLOCK.name, clock), clock.times)

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """
        The ticks that all topics of the loop hold, ascending; 0 to :attr:`last_tick` in a run of the rig's recorder.

        Raises
        ------
        BagError
            If there is none, or a stamp is no tick's.
        """
        present = [name for name, count in self.counts.items() if count]
        if not present:
            raise BagError(f'{self.path}: the bag holds no tick: no message on a topic of the loop')
        if self._is_strict:
            name = CLOCK.name if CLOCK.name in present else present[0]
            return self._to_ticks(name, self.column(name).times)
        common: NDArray[np.int64] | None = None
        for name in present:
            ticks = np.unique(self._to_ticks(name, self._stamps(name, self.column(name))))
            common = ticks if common is None else np.intersect1d(common, ticks, assume_unique=True)
        assert common is not None
        if not len(common):
            raise BagError(f'{self.path}: the bag holds no tick that all of {", ".join(present)} have')
        return common

    @property
    def last_tick(self) -> int:
        """N, the last tick."""
        return int(self.ticks[-1])

    @functools.cached_property
    def time(self) -> NDArray[np.float64]:
        """Time of each tick [s], shape (n,)."""
        return self.ticks * sample_time_to_nanoseconds(self.sample_time) / NANOSECONDS

    @property
    def duration(self) -> float:
        """Time of the last tick [s]."""
        return float(self.time[-1])

    def since(self, time: float) -> slice:
        """Return the rows from ``time`` [s] on."""
        # Half a microsecond lets a tick at that very time count, whatever its last bit.
        return slice(int(np.searchsorted(self.time, time - 0.5e-6)), len(self.ticks))

    # Signals.

    def __getitem__(self, topic: str) -> NDArray[Any]:
        """
        Return a topic as an array with one row a tick.

        Parameters
        ----------
        topic
            Name without namespace, such as ``head``, or full name in the bag. x, y and z of a vector are the columns,
            shape (n, 3); the elements of an array, shape (n, m); the clock gives its time [ns], shape (n,).

        Raises
        ------
        KeyError
            If the bag holds no such topic.
        BagError
            If its messages are not those of the ticks.
        """
        name = next((short for short, full in self._topics.items() if topic in (short, full)), topic)
        if name not in self._arrays:
            self._arrays[name] = self._decoded(name)
        return self._arrays[name]

    def __contains__(self, topic: str) -> bool:
        """Return whether the bag holds messages of a topic of the loop."""
        return any(topic in (name, self._topics[name]) and count > 0 for name, count in self.counts.items())

    @property
    def reference(self) -> NDArray[np.float64]:
        """Desired position, velocity and acceleration [um, um/s, um/s^2], shape (n, 3)."""
        return self[REFERENCE.name]

    @property
    def head(self) -> NDArray[np.float64]:
        """True head position [um], velocity [um/s] and pivot friction [V], shape (n, 3)."""
        return self[HEAD.name]

    @property
    def ldv(self) -> NDArray[np.float64]:
        """Displacement and velocity output of the vibrometer [V], 0; shape (n, 3)."""
        return self[LDV.name]

    @property
    def control(self) -> NDArray[np.float64]:
        """Command, command before saturation, and its feedback part [V], shape (n, 3)."""
        return self[CONTROL.name]

    @functools.cached_property
    def estimates(self) -> Mapping[str, NDArray[np.float64]]:
        """The controller's inner state by name, each of shape (n,); another name's KeyError says what there is."""
        columns = dict(zip(self.estimate_names, self[ESTIMATES.name].T, strict=True))
        return _Estimates(columns, self.path)

    @functools.cached_property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``run['estimates']``."""
        payloads = self.column(ESTIMATES.name).payloads
        return array_names_and_offset(bytes(payloads[0]))[0] if len(payloads) else ()

    @property
    def desired_position(self) -> NDArray[np.float64]:
        """x_d [um]."""
        return self.reference[:, 0]

    @property
    def position(self) -> NDArray[np.float64]:
        """True head position [um]."""
        return self.head[:, 0]

    @functools.cached_property
    def error(self) -> NDArray[np.float64]:
        """Tracking error, x - x_d of the head's true position [um]."""
        return self.position - self.desired_position

    @property
    def command(self) -> NDArray[np.float64]:
        """U, held over the sample after its tick [V]."""
        return self.control[:, 0]

    @property
    def feedback(self) -> NDArray[np.float64]:
        """Feedback part of the command, before any compensation [V]."""
        return self.control[:, 2]

    # Messages of any topic, and parameters.

    def messages(self, topic: str) -> list[tuple[int, Any]]:
        """
        Return the receive time [ns] and the deserialized message of everything on a topic, given by its full name.

        Slow, and for topics such as `/parameter_events` that are not of the loop.

        Raises
        ------
        KeyError
            If the bag holds no such topic.
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
    def parameter_changes(self) -> list[ParameterChange]:
        """The parameters that were changed during the run, in order."""
        if PARAMETER_EVENTS not in self._bag.types:
            return []
        period = sample_time_to_nanoseconds(self.sample_time)
        changes = []
        for _, event in self.messages(PARAMETER_EVENTS):
            time = event.stamp.sec * NANOSECONDS + event.stamp.nanosec
            for parameter in event.changed_parameters:
                value = _plain(parameter.value)
                changes.append(ParameterChange(-(-time // period), event.node, parameter.name, value))
        return sorted(changes, key=lambda change: change.tick)

    def parameter(self, node: str, name: str, tick: int | None = None) -> Any:
        """
        Return the value of a parameter that was in force at a tick.

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
            If the run knows no such node or parameter, or the tick lies outside the run.
        """
        nodes: dict[str, Any] = self.description.get('nodes', {})
        full_name = next(
            (full for full in nodes if node.strip('/') in (full.strip('/'), full.rsplit('/', 1)[-1])), None
        )
        if full_name is None:
            raise LookupError(f'{self.path}: no node {node!r} in run.yaml; it has {", ".join(nodes) or "none"}')
        parameters: dict[str, Any] = nodes[full_name]['parameters']
        if name not in parameters:
            similar = difflib.get_close_matches(name, parameters, n=1)
            hint = f'; did you mean {similar[0]}?' if similar else ''
            raise LookupError(f'{self.path}: {full_name} has no parameter {name!r}{hint}')
        if tick is not None and not 0 <= tick <= self.last_tick:
            raise LookupError(f'{self.path}: tick {tick} lies outside the run, which has ticks 0 to {self.last_tick}')
        value = parameters[name]
        for change in self.parameter_changes:
            if (change.node, change.name) == (full_name, name) and (tick is None or change.tick <= tick):
                value = change.value
        return value

    # Decoding.

    def column(self, topic: str) -> Column:
        """
        Return the messages of a topic of the loop as they were recorded, given by its name without namespace.

        Raises
        ------
        KeyError
            If the bag holds no such topic.
        """
        full_name = self._topics.get(topic, '')
        if full_name not in self._bag.types:
            raise self._missing(topic)
        return self._bag.column(full_name)

    def stamps(self, topic: str) -> NDArray[np.int64]:
        """
        Return the time that each message of a topic of the loop carries itself [ns], given by its name as above.

        Raises
        ------
        KeyError
            If the bag holds no such topic.
        BagError
            If the messages are arrays of different length.
        """
        column = self.column(topic)
        return self._stamps(topic, column) if len(column) else column.times

    def message_ticks(self, topic: str) -> NDArray[np.int64]:
        """Return the tick whose stamp each message of a topic carries; raises :class:`BagError` if that is none's."""
        # The time in an array is a float64.
        period = sample_time_to_nanoseconds(self.sample_time)
        stamps = self.stamps(topic)
        nearest = np.rint(stamps / period).astype(np.int64)
        return self._to_ticks(topic, np.where(np.abs(stamps - nearest * period) <= 1, nearest * period, stamps))

    def _missing(self, topic: str) -> '_MissingTopic':
        return _MissingTopic(f'{self.path}: the bag holds no topic {topic}; it holds {", ".join(self._bag.types)}')

    def _stamps(self, name: str, column: Column) -> NDArray[np.int64]:
        """Return the time that the messages themselves carry [ns]."""
        kind = self._bag.types[self._topics[name]]
        if kind == ARRAY_TYPE:
            return np.rint(_array_values(column)[:, 0] * NANOSECONDS).astype(np.int64)
        heads = _rows(column, slice(STAMP.start, STAMP.stop))
        stamps = np.ascontiguousarray(heads).view([('s', '<i4'), ('ns', '<u4')])[:, 0]
        times: NDArray[np.int64] = stamps['s'].astype(np.int64) * NANOSECONDS + stamps['ns']
        return times

    def _to_ticks(self, name: str, times: NDArray[np.int64]) -> NDArray[np.int64]:
        ticks, rest = np.divmod(times, sample_time_to_nanoseconds(self.sample_time))
        if rest.any():
            message = int(np.flatnonzero(rest)[0])
            raise BagError(
                f'{self.path}: {self._topics[name]}: message {message} is stamped {times[message]} ns, '
                f'which is no tick of {self.sample_time:g} s'
            )
        return ticks

    def _decoded(self, name: str) -> NDArray[Any]:
        column = self.column(name)
        stamps = self._stamps(name, column) if len(column) else column.times
        ticks = self.ticks
        rows: NDArray[np.int64] | None = None
        if self._is_strict:
            full_name = self._topics[name]
            period = sample_time_to_nanoseconds(self.sample_time)
            if not np.array_equal(column.times, ticks * period):
                raise BagError(f'{self.path}: the stamps of {full_name} are not those of the clock')
            # The time in an array is a float64, so that it is compared as a tick.
            wrong = np.flatnonzero(np.rint(stamps / period) != ticks)
            if len(wrong):
                raise BagError(f'{self.path}: {full_name}: message {wrong[0]} does not carry the stamp of its tick')
        else:
            if not len(column):
                raise BagError(f'{self.path}: no message on {self._topics[name]}')
            all_ticks, first = np.unique(self._to_ticks(name, stamps), return_index=True)
            rows = first[np.searchsorted(all_ticks, ticks)]
        kind = self._bag.types[self._topics[name]]
        values: NDArray[Any]
        if kind == CLOCK_TYPE:
            values = stamps
        elif kind == ARRAY_TYPE:
            values = _array_values(column)
        else:
            values = np.ascontiguousarray(_rows(column, slice(-24, None))).view('<f8')
        values = values if rows is None else values[rows]
        values.flags.writeable = False
        return values


class _MissingTopic(KeyError, BagError):
    """A topic, or an estimate on one, that the bag does not hold."""

    def __str__(self) -> str:
        return str(self.args[0])


class _Estimates(dict[str, NDArray[np.float64]]):
    """The estimates of a run by name."""

    def __init__(self, columns: Mapping[str, NDArray[np.float64]], path: Path) -> None:
        super().__init__(columns)
        self._path = path

    def __missing__(self, name: str) -> NDArray[np.float64]:
        raise _MissingTopic(f'{self._path}: no estimate {name!r}; there are {", ".join(self) or "none"}')


def _loop_topics(bag: Bag, namespace: str | None) -> dict[str, str]:
    """Return the loop's topics of a bag that has no ``run.yaml``: those with the right last name and type."""
    found: dict[str, list[str]] = {}
    for topic in (*LOOP_TOPICS, DISTURBANCE):
        for name, kind in bag.types.items():
            parent, _, own = name.rpartition('/')
            if own == topic.name and kind == topic.type_name and namespace in (None, parent, parent or '/'):
                found.setdefault(topic.name, []).append(name)
    for names in found.values():
        if len(names) > 1:
            raise BagError(f'{bag.path}: {" and ".join(names)}: say which by namespace')
    return {name: names[0] for name, names in found.items()}


def _rows(column: Column, part: slice) -> NDArray[np.uint8]:
    """Return a part of every payload, shape (n, size)."""
    if isinstance(column.payloads, list):
        parts = [payload[part] for payload in column.payloads]
        return np.frombuffer(b''.join(parts), dtype=np.uint8).reshape(len(parts), -1)
    return column.payloads[:, part]


def _array_values(column: Column) -> NDArray[np.float64]:
    """Return the elements of labelled arrays, shape (n, m)."""
    payloads = column.payloads
    if isinstance(payloads, list):
        raise BagError('the arrays on a topic are of different length')
    if not len(payloads):
        return np.zeros((0, 1))
    _, offset = array_names_and_offset(payloads[0].tobytes())
    return np.ascontiguousarray(payloads[:, offset:]).view('<f8')


def _plain(value: Any) -> Any:
    """Return what a ``rcl_interfaces/ParameterValue`` holds as plain Python."""
    field = PARAMETER_VALUE_FIELDS.get(int(value.type))
    content = None if field is None else getattr(value, field)
    if isinstance(content, np.ndarray):
        return content.tolist()
    return list(content) if isinstance(content, list) else content
