"""The signals of a run: an array per topic of the loop, one row per tick, whoever made them and wherever they are."""

import abc
import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.codecs import AXES
from hdd_servo_ros.messages.errors import MissingExtra
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND
from hdd_servo_ros.messages.topics import (
    ACCELEROMETER,
    BASE_ACCELERATION,
    CONTROL,
    DISTURBANCE,
    ESTIMATES,
    HEAD,
    KERNEL_TOPICS,
    LDV,
    PES,
    REFERENCE,
    SIGNAL_TOPICS,
    LoopTopic,
    topics_of_run,
)
from hdd_servo_ros.messages.units import Units

Array = NDArray[np.float64]


class SignalArray(np.ndarray[Any, np.dtype[np.float64]]):
    """
    The rows of a topic, shape (n, 3) for a vector, whose fields are attributes too: ``control.before_saturation``.

    Accelerations have the shape (n, 6). Each attribute is a column, shape (n,); the topic's declaration names them, see
    ``docs/reference/topics.md``.
    """

    fields: tuple[str, ...]

    @classmethod
    def of(cls, topic: LoopTopic, rows: Array) -> 'SignalArray':
        """Return rows as those of a topic, without a copy."""
        return _with_fields(rows, topic.field_names)

    def __array_finalize__(self, source: Any) -> None:
        self.fields = getattr(source, 'fields', ())

    def __getattr__(self, name: str) -> Array:
        if name in self.fields and self.ndim == 2:
            column: Array = self.view(np.ndarray)[:, self.fields.index(name)]
            return column
        raise AttributeError(f'no field {name!r}; there are {", ".join(self.fields) or "none"}')

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        # Chosen or reordered columns are no longer those that the topic declares.
        return found.view(np.ndarray) if isinstance(key, tuple) and isinstance(found, np.ndarray) else found

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        # What is computed from the rows of a topic has other fields, or none.
        plain = array.view(np.ndarray)
        return plain[()] if plain.ndim == 0 else plain

    def __reduce__(self) -> Any:
        return _with_fields, (self.view(np.ndarray), self.fields)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.fields]


def _with_fields(rows: Array, fields: tuple[str, ...]) -> SignalArray:
    view = rows.view(SignalArray)
    view.fields = fields
    return view


class TimedSignals(abc.ABC):
    """
    Signals over time by topic, which is all that diagrams need: row i of every array belongs to ``time[i]``.

    Lengths and controls are in the drive's :attr:`units`; the fields of each topic are declared in
    :mod:`hdd_servo_ros.messages.topics`.
    """

    @property
    @abc.abstractmethod
    def time(self) -> Array:
        """Time of each row [s], shape (n,)."""

    @property
    @abc.abstractmethod
    def units(self) -> Units:
        """Units of the drive."""

    @property
    @abc.abstractmethod
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``signals['estimates']``."""

    @abc.abstractmethod
    def __getitem__(self, topic: str) -> NDArray[Any]:
        """Return the rows of a topic by its name; raises KeyError if there are none."""

    @abc.abstractmethod
    def __contains__(self, topic: str) -> bool:
        """Return whether there are rows of a topic."""

    # The topics.

    @functools.cached_property
    def reference(self) -> SignalArray:
        """Desired position, velocity and acceleration [um, um/s, um/s^2], shape (n, 3)."""
        return self._rows(REFERENCE)

    @functools.cached_property
    def head(self) -> SignalArray:
        """Ground truth of head position [um], velocity [um/s] and pivot friction [V], shape (n, 3)."""
        return self._rows(HEAD)

    @functools.cached_property
    def ldv(self) -> SignalArray:
        """Displacement and velocity output of the vibrometer [V], 0; shape (n, 3); not in a run with `/pes`."""
        return self._rows(LDV)

    @functools.cached_property
    def pes(self) -> SignalArray:
        """Decoded position error and position [um], number of the sector; shape (n, 3); only with `servo_sensor`."""
        return self._rows(PES)

    @functools.cached_property
    def control(self) -> SignalArray:
        """Command, command before saturation, and its feedback part [V], shape (n, 3)."""
        return self._rows(CONTROL)

    @functools.cached_property
    def disturbance(self) -> SignalArray:
        """Force against u [V], displacement of the track center [um], 0; shape (n, 3); in a run with a disturbance."""
        return self._rows(DISTURBANCE)

    @functools.cached_property
    def base_acceleration(self) -> SignalArray:
        """
        Acceleration of the base, shape (n, 6); only in a run whose disturbance moves the base.

        Linear along x, y, z [m/s^2], then angular about x, y, z [rad/s^2]; z is the pivot axis, y the direction of the
        head's motion.
        """
        return self._rows(BASE_ACCELERATION)

    @functools.cached_property
    def accelerometer(self) -> SignalArray:
        """Outputs of the two sensors of the base [V], 0; shape (n, 3); only in a run with an accelerometer."""
        return self._rows(ACCELEROMETER)

    @functools.cached_property
    def estimates(self) -> Mapping[str, Array]:
        """The controller's inner state by name, each of shape (n,); another name's KeyError lists those there are."""
        columns = zip(self.estimate_names, self[ESTIMATES.name].T, strict=True)
        return _Estimates(columns, self._estimate_error())

    def _estimate_error(self) -> Callable[[str], KeyError]:
        """Return what makes the error of an estimate that is not there; it may not hold these signals themselves."""
        return KeyError

    def _rows(self, topic: LoopTopic) -> SignalArray:
        return SignalArray.of(topic, self[topic.name])

    # What is asked for most.

    @property
    def desired_position(self) -> Array:
        """x_d [um]."""
        return self.reference.position

    @property
    def position(self) -> Array:
        """True head position [um]."""
        return self.head.position

    @property
    def is_track_following(self) -> bool:
        """Whether the controller reads positions relative to the track, from the servo sensor."""
        return PES.name in self

    @functools.cached_property
    def relative_position(self) -> Array:
        """True head position in the sensor's frame [um], less the track center's displacement with the servo sensor."""
        if not self.is_track_following or DISTURBANCE.name not in self:
            return self.position
        return np.asarray(self.position - self[DISTURBANCE.name][:, 1])

    @functools.cached_property
    def error(self) -> Array:
        """Tracking error, x - x_d of the head's true position [um]."""
        return self.position - self.desired_position

    @functools.cached_property
    def track_error(self) -> Array:
        """Track error, x - x_d - displacement of the track center [um]; the tracking error without a disturbance."""
        if DISTURBANCE.name not in self:
            return self.error
        return np.asarray(self.error - self[DISTURBANCE.name][:, 1])

    @property
    def position_error(self) -> Array:
        """
        Error that the controller is to make zero, of the head's true position [um].

        With the vibrometer the tracking error :attr:`error`, with the servo sensor the track error.
        """
        return self.track_error if self.is_track_following else self.error

    @property
    def command(self) -> Array:
        """Drive voltage u, held over the sample after its tick [V]."""
        return self.control.voltage

    @property
    def feedback(self) -> Array:
        """Feedback part of the command, before any compensation [V]."""
        return self.control.feedback


class Signals(TimedSignals):
    """The signals of consecutive or chosen ticks, aligned: row i of every array is that of ``ticks[i]``."""

    @property
    @abc.abstractmethod
    def ticks(self) -> NDArray[np.int64]:
        """The ticks, ascending, shape (n,)."""

    @property
    @abc.abstractmethod
    def sample_time(self) -> float:
        """T [s]."""

    @functools.cached_property
    def time(self) -> Array:
        """Time of each tick [s], shape (n,)."""
        return np.multiply(self.ticks, self.sample_time, dtype=np.float64)

    @property
    def duration(self) -> float:
        """Time of the last tick [s]."""
        return float(self.time[-1])

    def to_dataframe(self) -> Any:
        """
        Return all signals as a pandas ``DataFrame``, a row per tick.

        The index is the tick, the first column ``time`` [s]; the others are ``TOPIC.FIELD``, such as ``head.position``,
        and ``estimates.NAME``, in the units of the topics.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtra('to_dataframe()', 'pandas') from None
        columns: dict[str, Array] = {'time': self.time}
        for topic in SIGNAL_TOPICS:
            if topic.name not in self:
                continue
            names = self.estimate_names if topic is ESTIMATES else topic.field_names
            # Columns behind the fields of a vector are 0.
            for name, column in zip(names, np.asarray(self[topic.name]).T, strict=False):
                columns[f'{topic.name}.{name}'] = column
        return pd.DataFrame(columns, index=pd.Index(self.ticks, name='tick'))

    def since(self, time: float) -> slice:
        """Return the rows from ``time`` [s] on."""
        # Half a microsecond lets a tick at that very time count, whatever its last bit.
        return slice(int(np.searchsorted(self.time, time - HALF_MICROSECOND)), len(self.ticks))


class _Estimates(dict[str, Array]):
    """
    Estimates by name.

    They are kept in the signals: if they held the signals in turn, the memory of a piece of a long run would be free
    only when Python looks for such rings.
    """

    def __init__(self, columns: Iterable[tuple[str, Array]], error: Callable[[str], KeyError]) -> None:
        super().__init__(columns)
        self._error = error

    def __missing__(self, name: str) -> Array:
        raise self._error(f'no estimate {name!r}; there are {", ".join(self) or "none"}')


class SignalRows(Signals):
    """
    Signals of consecutive ticks in memory, as the compiled loop fills them.

    Parameters
    ----------
    first_tick
        The first tick.
    sample_time
        T [s].
    arrays
        An array per topic by its name, one row per tick: (n, 3) for a vector, (n, 6) for accelerations, (n, m) for the
        estimates.
    estimate_names
        Names of the m estimates.
    units
        Units of the drive.
    """

    def __init__(
        self,
        first_tick: int,
        sample_time: float,
        arrays: Mapping[str, Array],
        estimate_names: tuple[str, ...],
        units: Units = Units(),  # noqa: B008 - a frozen value
    ) -> None:
        self.first_tick = first_tick
        self._sample_time = sample_time
        self._arrays = dict(arrays)
        self._estimate_names = estimate_names
        self._units = units

    @classmethod
    def empty(
        cls,
        first_tick: int,
        count: int,
        sample_time: float,
        estimate_names: tuple[str, ...],
        optional: tuple[LoopTopic, ...] = (),
        units: Units = Units(),  # noqa: B008 - a frozen value
    ) -> 'SignalRows':
        """Return rows for ``count`` ticks, to be filled; of the optional topics, rows for those named."""
        arrays = {}
        for topic in topics_of_run(optional):
            if topic in SIGNAL_TOPICS:
                width = topic.codec.width
                arrays[topic.name] = np.empty((count, len(estimate_names) if width is None else width))
        return cls(first_tick, sample_time, arrays, estimate_names, units)

    def __len__(self) -> int:
        # All topics have the same ticks; a long run is read by some of them.
        return len(next(iter(self._arrays.values())))

    def __repr__(self) -> str:
        last = self.first_tick + len(self) - 1
        topics = ', '.join(self._arrays)
        return f'{type(self).__name__}(ticks {self.first_tick} to {last} of {self._sample_time:g} s: {topics})'

    def starting_at(self, tick: int) -> 'SignalRows':
        """Return these rows, the same memory, as those of the ticks from ``tick`` on."""
        return SignalRows(tick, self._sample_time, self._arrays, self._estimate_names, self._units)

    def part(self, first_tick: int, count: int) -> 'SignalRows':
        """Return the rows of ``count`` ticks from ``first_tick`` on, the same memory."""
        start = first_tick - self.first_tick
        arrays = {name: rows[start : start + count] for name, rows in self._arrays.items()}
        return SignalRows(first_tick, self._sample_time, arrays, self._estimate_names, self._units)

    def before(self, tick: int) -> 'SignalRows':
        """Return the rows before ``tick``, the same memory."""
        return self.part(self.first_tick, tick - self.first_tick)

    @property
    def kernel_arrays(self) -> tuple[Array, ...]:
        """The arrays in the order of ``KERNEL_TOPICS``, as the compiled loop takes them; none has no row."""
        nothing = np.empty((0, len(AXES)))
        return tuple(self._arrays.get(topic.name, nothing) for topic in KERNEL_TOPICS)

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """The ticks, shape (n,)."""
        return np.arange(self.first_tick, self.first_tick + len(self), dtype=np.int64)

    @property
    def sample_time(self) -> float:
        """T [s]."""
        return self._sample_time

    @property
    def units(self) -> Units:
        """Units of the drive."""
        return self._units

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``signals['estimates']``."""
        return self._estimate_names

    def __getitem__(self, topic: str) -> Array:
        """Return the rows of a topic by its name."""
        return self._arrays[topic]

    def __contains__(self, topic: str) -> bool:
        """Return whether there are rows of a topic."""
        return topic in self._arrays

    @property
    def topic_names(self) -> tuple[str, ...]:
        """Names of the topics that there are rows of."""
        return tuple(self._arrays)
