"""Signals of a run: one array per topic of the loop, one row per tick, independent of source and storage."""

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
    CONTROL_UPDATES,
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
    Rows of a topic, shape (n, 3) for a vector, with its fields as attributes, such as ``control.before_saturation``.

    Accelerations have the shape (n, 6). Each attribute is a column, shape (n,). The declaration of the topic names the
    fields, see ``docs/reference/topics.md``.
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
        raise AttributeError(f'no field {name!r}; fields: {", ".join(self.fields) or "none"}')

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        # Selected or reordered columns no longer match the declaration of the topic.
        return found.view(np.ndarray) if isinstance(key, tuple) and isinstance(found, np.ndarray) else found

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        # Results of computations on the rows of a topic have other fields, or no fields.
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
    Signals over time by topic, the interface for plots: row i of every array belongs to ``time[i]``.

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
        """Return the rows of a topic by its name; raises KeyError if the topic is missing."""

    @abc.abstractmethod
    def __contains__(self, topic: str) -> bool:
        """Return whether the topic has rows."""

    # Topics.

    @functools.cached_property
    def reference(self) -> SignalArray:
        """Desired position [um], velocity [um/s] and acceleration [um/s^2], shape (n, 3)."""
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
        """Decoded position error and position [um], sector number; shape (n, 3); only with `servo_sensor`."""
        return self._rows(PES)

    @functools.cached_property
    def control(self) -> SignalArray:
        """Command, command before saturation, and its feedback part [V], shape (n, 3)."""
        return self._rows(CONTROL)

    @functools.cached_property
    def control_updates(self) -> SignalArray:
        """Voltages from 1/4, 1/2 and 3/4 of the sample on [V], shape (n, 3); in a run with several updates."""
        return self._rows(CONTROL_UPDATES)

    @functools.cached_property
    def disturbance(self) -> SignalArray:
        """Force against u [V], track center displacement [um], 0; shape (n, 3); only in a run with a disturbance."""
        return self._rows(DISTURBANCE)

    @functools.cached_property
    def base_acceleration(self) -> SignalArray:
        """
        Acceleration of the base, shape (n, 6); only in a run whose disturbance moves the base.

        Linear along x, y, z [m/s^2], then angular about x, y, z [rad/s^2]; z is the pivot axis, y the direction of head
        motion.
        """
        return self._rows(BASE_ACCELERATION)

    @functools.cached_property
    def accelerometer(self) -> SignalArray:
        """Outputs of the two accelerometers on the base [V], 0; shape (n, 3); only in a run with an accelerometer."""
        return self._rows(ACCELEROMETER)

    @functools.cached_property
    def estimates(self) -> Mapping[str, Array]:
        """Internal state of the controller by name, shape (n,) each; KeyError for an unknown name lists the known."""
        columns = zip(self.estimate_names, self[ESTIMATES.name].T, strict=True)
        return _Estimates(columns, self._estimate_error())

    def _estimate_error(self) -> Callable[[str], KeyError]:
        """Return a function that makes the error of an unknown estimate; it must not reference the signals."""
        return KeyError

    def _rows(self, topic: LoopTopic) -> SignalArray:
        return SignalArray.of(topic, self[topic.name])

    # Frequently used signals.

    @property
    def desired_position(self) -> Array:
        """Reference x_d [um]."""
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
        """True head position in the sensor's frame [um]: relative to the track center with the servo sensor."""
        if not self.is_track_following or DISTURBANCE.name not in self:
            return self.position
        return np.asarray(self.position - self[DISTURBANCE.name][:, 1])

    @functools.cached_property
    def error(self) -> Array:
        """Tracking error x - x_d of the true head position [um]."""
        return self.position - self.desired_position

    @functools.cached_property
    def track_error(self) -> Array:
        """Track error x - x_d - track center displacement [um]; equals the tracking error without a disturbance."""
        if DISTURBANCE.name not in self:
            return self.error
        return np.asarray(self.error - self[DISTURBANCE.name][:, 1])

    @property
    def position_error(self) -> Array:
        """
        Error of the true head position that the controller must reduce to zero [um].

        The tracking error :attr:`error` with the vibrometer, the track error with the servo sensor.
        """
        return self.track_error if self.is_track_following else self.error

    @property
    def command(self) -> Array:
        """Drive voltage u, held over the sample after its tick [V]."""
        return self.control.voltage

    @property
    def feedback(self) -> Array:
        """Feedback part of the command, without feedforward and compensation [V]."""
        return self.control.feedback


class Signals(TimedSignals):
    """Signals of consecutive or selected ticks, aligned: row i of every array belongs to ``ticks[i]``."""

    @property
    @abc.abstractmethod
    def ticks(self) -> NDArray[np.int64]:
        """Ticks, ascending, shape (n,)."""

    @property
    @abc.abstractmethod
    def sample_time(self) -> float:
        """Sample time T [s]."""

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
            # The remaining components of a vector are 0.
            for name, column in zip(names, np.asarray(self[topic.name]).T, strict=False):
                columns[f'{topic.name}.{name}'] = column
        return pd.DataFrame(columns, index=pd.Index(self.ticks, name='tick'))

    def since(self, time: float) -> slice:
        """Return the slice of rows from ``time`` [s] on."""
        # Half a microsecond of tolerance includes a tick at exactly this time, despite rounding.
        return slice(int(np.searchsorted(self.time, time - HALF_MICROSECOND)), len(self.ticks))


class _Estimates(dict[str, Array]):
    """
    Estimates by name.

    They are stored in the signals. A reference back to the signals would be a cycle, and the memory of a piece of a
    long run would be freed only by the cyclic garbage collector.
    """

    def __init__(self, columns: Iterable[tuple[str, Array]], error: Callable[[str], KeyError]) -> None:
        super().__init__(columns)
        self._error = error

    def __missing__(self, name: str) -> Array:
        raise self._error(f'no estimate {name!r}; estimates: {", ".join(self) or "none"}')


class SignalRows(Signals):
    """
    Signals of consecutive ticks in memory, as written by the compiled loop.

    Parameters
    ----------
    first_tick
        The first tick.
    sample_time
        T [s].
    arrays
        One array per topic by its name, one row per tick: (n, 3) for a vector, (n, 6) for accelerations, (n, m) for
        the estimates.
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
        """Return uninitialized rows for ``count`` ticks; of the optional topics, only for those named."""
        arrays = {}
        for topic in topics_of_run(optional):
            if topic in SIGNAL_TOPICS:
                width = topic.codec.width
                arrays[topic.name] = np.empty((count, len(estimate_names) if width is None else width))
        return cls(first_tick, sample_time, arrays, estimate_names, units)

    def __len__(self) -> int:
        # All topics have the same ticks; a long run may have loaded only some of them.
        return len(next(iter(self._arrays.values())))

    def __repr__(self) -> str:
        last = self.first_tick + len(self) - 1
        topics = ', '.join(self._arrays)
        return f'{type(self).__name__}(ticks {self.first_tick} to {last} of {self._sample_time:g} s: {topics})'

    def starting_at(self, tick: int) -> 'SignalRows':
        """Return a view of these rows with ``tick`` as the first tick."""
        return SignalRows(tick, self._sample_time, self._arrays, self._estimate_names, self._units)

    def part(self, first_tick: int, count: int) -> 'SignalRows':
        """Return a view of the ``count`` rows from ``first_tick`` on."""
        start = first_tick - self.first_tick
        arrays = {name: rows[start : start + count] for name, rows in self._arrays.items()}
        return SignalRows(first_tick, self._sample_time, arrays, self._estimate_names, self._units)

    def before(self, tick: int) -> 'SignalRows':
        """Return a view of the rows before ``tick``."""
        return self.part(self.first_tick, tick - self.first_tick)

    @property
    def kernel_arrays(self) -> tuple[Array, ...]:
        """Arrays in the order of ``KERNEL_TOPICS`` for the compiled loop; a missing topic has no rows."""
        nothing = np.empty((0, len(AXES)))
        return tuple(self._arrays.get(topic.name, nothing) for topic in KERNEL_TOPICS)

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """Ticks, shape (n,)."""
        return np.arange(self.first_tick, self.first_tick + len(self), dtype=np.int64)

    @property
    def sample_time(self) -> float:
        """Sample time T [s]."""
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
        """Return whether the topic has rows."""
        return topic in self._arrays

    @property
    def topic_names(self) -> tuple[str, ...]:
        """Names of the topics with rows."""
        return tuple(self._arrays)
