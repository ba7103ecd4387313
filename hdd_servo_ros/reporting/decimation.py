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
    whole = len(y) // size * size
    starts = np.arange(0, whole, size)
    folded = y[:whole].reshape(-1, size)
    parts = [starts + folded.argmin(axis=1), starts + folded.argmax(axis=1), np.arange(whole, len(y))]
    parts += [np.arange(len(y))[stretch] for stretch in in_full]
    return np.unique(np.concatenate([*parts, [0, len(y) - 1]]))
