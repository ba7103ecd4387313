"""Blocks of decimated signals for who looks on: each bin's smallest and largest values, so that no peak is lost."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import array_names_and_offset

BINS = 200
"""Bins of one block; a block of fewer ticks than two a bin is not decimated."""
NAMES = ('t', 'x_d', 'x', 'error', 'u', 'feedback')
"""Columns of a block before those of the estimates: time [s], positions and error x - x_d, u and its feedback part."""


@dataclasses.dataclass(frozen=True)
class Block:
    """Names of the columns, and rows in the order of time; two a bin, its smallest and its largest values."""

    names: tuple[str, ...]
    rows: NDArray[np.float64]


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


def make_block(first_tick: int, sample_time: float, ticks: Sequence[Sequence[bytes]]) -> Block:
    """
    Return the block of consecutive ticks.

    Parameters
    ----------
    first_tick, sample_time
        The first tick, and T [s].
    ticks
        For each tick its messages in the order of ``LOOP_TOPICS``.
    """
    count = len(ticks)
    time = np.arange(first_tick, first_tick + count) * sample_time
    reference, head, control = (_vectors(ticks, place) for place in (1, 2, 4))
    x_d, x = reference[:, 0], head[:, 0]
    labels, offset = array_names_and_offset(ticks[0][5])
    estimates = _doubles([messages[5][offset:] for messages in ticks]).reshape(count, len(labels))
    columns = [time, x_d, x, x - x_d, control[:, 0], control[:, 2], *estimates[:, 1:].T]
    return Block((*NAMES, *(f'estimates.{label}' for label in labels[1:])), decimated(np.column_stack(columns)))


def _vectors(ticks: Sequence[Sequence[bytes]], place: int) -> NDArray[np.float64]:
    return _doubles([messages[place][-24:] for messages in ticks]).reshape(len(ticks), 3)


def _doubles(parts: Sequence[bytes]) -> NDArray[np.float64]:
    return np.frombuffer(b''.join(parts), dtype='<f8')
