"""Which samples of a long signal to draw, so that every peak stays."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray


def rows_to_draw(values: ArrayLike, buckets: int, in_full: Iterable[slice] = ()) -> NDArray[np.int64]:
    """
    Return rows of a signal whose line looks like the line through all rows: of each bucket the extremes.

    Parameters
    ----------
    values
        The signal, shape (n,).
    buckets
        Into how many pieces of equal length the rows are cut; at most two rows of each are returned.
    in_full
        Stretches of which every row is returned.

    Returns
    -------
    NDArray
        Rows, ascending, the first and the last one among them.
    """
    y = np.asarray(values, dtype=np.float64)
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    size = -(-len(y) // buckets)
    parts = [*bucket_extremes(y, size), np.arange(len(y) // size * size, len(y))]
    parts += [np.arange(len(y))[stretch] for stretch in in_full]
    return np.unique(np.concatenate([*parts, [0, len(y) - 1]]))


def bucket_extremes(values: NDArray[np.float64], size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the row of the smallest and of the largest value in each whole bucket of ``size`` rows."""
    starts = np.arange(0, len(values) // size * size, size)
    folded = values[: len(starts) * size].reshape(-1, size)
    return starts + folded.argmin(axis=1), starts + folded.argmax(axis=1)


def chosen_rows_to_draw(
    values: ArrayLike, ticks: NDArray[np.int64], row_count: int, buckets: int, in_full: Iterable[slice] = ()
) -> NDArray[np.int64]:
    """
    Return what :func:`rows_to_draw` does, from some rows of a signal, the extremes of each bucket among them.

    Parameters
    ----------
    values
        The signal where it is there, shape (n,).
    ticks
        Which rows of the whole signal these are, ascending, shape (n,), the first and the last row among them.
    row_count
        Rows of the whole signal.
    buckets, in_full
        As there; the stretches are those of the n rows.

    Returns
    -------
    NDArray
        Which of the n rows to draw, ascending.
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
