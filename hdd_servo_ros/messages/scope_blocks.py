"""Blocks of decimated signals for live viewers: each bin's smallest and largest values, so that no peak is lost."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import ESTIMATES, SIGNAL_TOPICS, LoopTopic
from hdd_servo_ros.messages.units import Units

BINS = 200
"""Bins of one block; a block of fewer ticks than two per bin is not decimated."""
TIME, ERROR = 't', 'error'
"""Columns that are no field of a topic: time [s], and the position error."""


@dataclasses.dataclass(frozen=True)
class Block:
    """Names of the columns, and rows in the order of time; two per bin, its smallest and its largest values."""

    names: tuple[str, ...]
    rows: NDArray[np.float64]


_MOST_COLUMNS = 500


@dataclasses.dataclass(frozen=True)
class ScopeMessage:
    """
    What a message on ``scope`` holds.

    Attributes
    ----------
    run
        Identifier of the run.
    units
        Units of the drive.
    block
        The block.
    """

    run: str
    units: Units
    block: Block

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of the array's two dimensions: units and run, and the names of the columns."""
        return f'{self.units.length},{self.units.control},{self.run}', ','.join(self.block.names)


def read_scope_message(message: Any) -> ScopeMessage:
    """
    Return what a ``std_msgs/Float64MultiArray`` holds.

    Raises
    ------
    ValueError
        If it is not one that :class:`ScopeMessage` describes.
    """
    dimensions = message.layout.dim
    if len(dimensions) != 2:
        raise ValueError(f'{len(dimensions)} dimensions, a block has 2')
    about, names = dimensions[0].label.split(',', 2), tuple(dimensions[1].label.split(','))
    if len(about) != 3:
        raise ValueError(f'the label of a block names two units and the run, not {dimensions[0].label[:60]!r}')
    if names[:2] != (TIME, ERROR) or len(set(names)) < len(names) or len(names) > _MOST_COLUMNS:
        raise ValueError(f'the columns of a block begin with {TIME}, {ERROR} and are unique, not {names[:5]!r:.80}')
    values = np.asarray(message.data, dtype=np.float64)
    if not 0 < len(values) <= 2 * BINS * len(names) or len(values) % len(names):
        raise ValueError(f'{len(values)} numbers in {len(names)} columns')
    rows = values.reshape(-1, len(names))
    if not np.isfinite(rows[:, 0]).all() or (np.diff(rows[:, 0]) < 0.0).any():
        raise ValueError('the time of a block does not grow')
    return ScopeMessage(about[2], Units(*about[:2]), Block(names, rows))


def column_name(topic: LoopTopic, field: str) -> str:
    """Return the name of the column that holds a field of a topic, such as ``control.voltage``."""
    return f'{topic.name}.{field}'


def decimated(values: NDArray[np.float64], bins: int = BINS) -> NDArray[np.float64]:
    """
    Return the smallest and the largest values of each of ``bins`` bins.

    Parameters
    ----------
    values
        Rows in the order of time, the time in column 0, shape (n, m).
    bins
        Number of bins; fewer than 2 ``bins`` rows are returned as they are.

    Returns
    -------
    ndarray
        Shape (2 ``bins``, m): of each bin a row of its smallest and one of its largest values; their times are those of
        the bin's first and last row.
    """
    if len(values) < 2 * bins:
        return values
    edges = np.linspace(0, len(values), bins, endpoint=False).astype(np.int64)
    rows = np.empty((2 * bins, values.shape[1]))
    # As time grows, its smallest and largest are the first and last.
    rows[0::2] = np.minimum.reduceat(values, edges)
    rows[1::2] = np.maximum.reduceat(values, edges)
    return rows


def make_block(signals: Signals, bins: int = BINS) -> Block:
    """Return the block of consecutive ticks: time, error, every field of every topic, and the estimates."""
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
        # The time of the tick is a column already.
        if name != TIME:
            yield column_name(ESTIMATES, name), values
