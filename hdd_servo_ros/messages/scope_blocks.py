"""Blocks of decimated signals for live viewers, with the minima and maxima of each bin so that no peak is lost."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import ESTIMATES, SIGNAL_TOPICS, LoopTopic
from hdd_servo_ros.messages.units import Units

BINS = 200
"""Bins per block; a block of fewer than two ticks per bin is not decimated."""
TIME, ERROR = 't', 'error'
"""Columns that are not fields of a topic: time [s] and position error."""


@dataclasses.dataclass(frozen=True)
class Block:
    """Column names, and rows in time order; two rows per bin, its minima and its maxima."""

    names: tuple[str, ...]
    rows: NDArray[np.float64]


_MOST_COLUMNS = 500


@dataclasses.dataclass(frozen=True)
class ScopeMessage:
    """
    Content of a message on ``scope``.

    Attributes
    ----------
    run
        Identifier of the run.
    units
        Units of the drive.
    block
        The decimated signals.
    """

    run: str
    units: Units
    block: Block

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of the array's two dimensions: units and run; column names."""
        return f'{self.units.length},{self.units.control},{self.run}', ','.join(self.block.names)


def read_scope_message(message: Any) -> ScopeMessage:
    """
    Return the content of a ``std_msgs/Float64MultiArray``.

    Raises
    ------
    ValueError
        If it is not a message as described by :class:`ScopeMessage`.
    """
    dimensions = message.layout.dim
    if len(dimensions) != 2:
        raise ValueError(f'{len(dimensions)} dimensions; expected 2 for a block')
    about, names = dimensions[0].label.split(',', 2), tuple(dimensions[1].label.split(','))
    if len(about) != 3:
        raise ValueError(f'expected two units and the run in the label of a block, got {dimensions[0].label[:60]!r}')
    if names[:2] != (TIME, ERROR) or len(set(names)) < len(names) or len(names) > _MOST_COLUMNS:
        raise ValueError(f'expected unique columns that start with {TIME}, {ERROR}, got {names[:5]!r:.80}')
    values = np.asarray(message.data, dtype=np.float64)
    if not 0 < len(values) <= 2 * BINS * len(names) or len(values) % len(names):
        raise ValueError(f'{len(values)} numbers in {len(names)} columns')
    rows = values.reshape(-1, len(names))
    if not np.isfinite(rows[:, 0]).all() or (np.diff(rows[:, 0]) < 0.0).any():
        raise ValueError('the times of a block do not increase')
    return ScopeMessage(about[2], Units(*about[:2]), Block(names, rows))


def column_name(topic: LoopTopic, field: str) -> str:
    """Return the column name of a field of a topic, such as ``control.voltage``."""
    return f'{topic.name}.{field}'


def decimated(values: NDArray[np.float64], bins: int = BINS) -> NDArray[np.float64]:
    """
    Return the minima and maxima of each of ``bins`` bins.

    Parameters
    ----------
    values
        Rows in time order with the time in column 0, shape (n, m).
    bins
        Number of bins; fewer than 2 ``bins`` rows are returned unchanged.

    Returns
    -------
    ndarray
        Shape (2 ``bins``, m): per bin a row of its minima and a row of its maxima, with the times of its first and
        last row.
    """
    if len(values) < 2 * bins:
        return values
    edges = np.linspace(0, len(values), bins, endpoint=False).astype(np.int64)
    rows = np.empty((2 * bins, values.shape[1]))
    # Time increases, so its minimum and maximum are the first and the last.
    rows[0::2] = np.minimum.reduceat(values, edges)
    rows[1::2] = np.maximum.reduceat(values, edges)
    return rows


def make_block(signals: Signals, bins: int = BINS) -> Block:
    """Return the block of consecutive ticks: time, error, all fields of all topics, and the estimates."""
    columns = dict(_columns(signals))
    return Block(tuple(columns), decimated(np.column_stack(list(columns.values())), bins))


def _columns(signals: Signals) -> Iterator[tuple[str, NDArray[np.float64]]]:
    yield TIME, signals.time
    yield ERROR, signals.position_error
    for topic in SIGNAL_TOPICS:
        if topic.name in signals:
            for index, field in enumerate(topic.field_names):
                yield column_name(topic, field), signals[topic.name][:, index]
    for name, values in signals.estimates.items() if ESTIMATES.name in signals else ():
        # The time of the tick already is a column.
        if name != TIME:
            yield column_name(ESTIMATES, name), values
