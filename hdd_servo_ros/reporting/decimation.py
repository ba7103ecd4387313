"""Decimation of long signals for plots that keeps every peak."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray


def rows_to_draw(values: ArrayLike, buckets: int, in_full: Iterable[slice] = ()) -> NDArray[np.int64]:
    """
    Return the rows with the extremes of each bucket, whose line looks like the line through all rows.

    Parameters
    ----------
    values
        The signal, shape (n,).
    buckets
        Number of buckets of equal length; at most two rows per bucket are returned.
    in_full
        Stretches in which every row is returned.

    Returns
    -------
    NDArray
        Rows in ascending order, including the first and the last.
    """
    y = np.asarray(values, dtype=np.float64)
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    size = -(-len(y) // buckets)
    parts = [*bucket_extremes(y, size), np.arange(len(y) // size * size, len(y))]
    parts += [np.arange(len(y))[stretch] for stretch in in_full]
    return np.unique(np.concatenate([*parts, [0, len(y) - 1]]))


def bucket_extremes(values: NDArray[np.float64], size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the row of the smallest and of the largest value in each complete bucket of ``size`` rows."""
    starts = np.arange(0, len(values) // size * size, size)
    folded = values[: len(starts) * size].reshape(-1, size)
    return starts + folded.argmin(axis=1), starts + folded.argmax(axis=1)


def chosen_rows_to_draw(
    values: ArrayLike, ticks: NDArray[np.int64], row_count: int, buckets: int, in_full: Iterable[slice] = ()
) -> NDArray[np.int64]:
    """
    Return the result of :func:`rows_to_draw` from a subset of rows that includes the extremes of each bucket.

    Parameters
    ----------
    values
        The signal at the available rows, shape (n,).
    ticks
        Indices of these rows in the whole signal, ascending, shape (n,), including the first and the last row.
    row_count
        Number of rows of the whole signal.
    buckets, in_full
        As for :func:`rows_to_draw`; stretches are given as rows of the n.

    Returns
    -------
    NDArray
        Indices of the rows to draw, ascending, from 0 to n - 1.
    """
    y = np.asarray(values, dtype=np.float64)
    if row_count <= 2 * buckets:
        return np.arange(len(y))
    size = -(-row_count // buckets)
    whole = row_count // size * size
    edges = np.searchsorted(ticks, np.arange(0, whole + 1, size))
    filled = [(begin, end) for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if begin < end]
    extremes = [begin + int(y[begin:end].argmin()) for begin, end in filled]
    extremes += [begin + int(y[begin:end].argmax()) for begin, end in filled]
    parts = [np.array(extremes, dtype=np.int64), np.arange(edges[-1], len(y))]
    parts += [np.arange(len(y))[stretch] for stretch in in_full]
    return np.unique(np.concatenate([*parts, [0, len(y) - 1]]))
