"""
Names for the numbers of an array.

A block keeps its constants and its state in plain float64 arrays, which are cheap to pass into compiled code. A layout
gives every number of such an array a name. Compiled code takes its view with ``c = constants.view(LAYOUT)[0]`` and
reads ``c.gain``; a field that is a layout itself is a record again, ``friction = c.friction``, and can be passed on to
another kernel. Python code fills the same numbers with ``record(constants, LAYOUT).gain = ...``.

Two rules come with it. The array has exactly the size of its layout. What has a variable length (modes, nodes, a
history) is an array of its own, since cutting it off inside a kernel costs more than the kernel.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Layout = np.dtype[np.void]


def layout(*fields: str | tuple[str, Layout]) -> Layout:
    """
    Return the layout of an array with these fields.

    Parameters
    ----------
    *fields
        In order, the name of a number, or the name of a record and its layout.
    """
    members = [(field, np.dtype(np.float64)) if isinstance(field, str) else field for field in fields]
    # Aligned, or compiled code would load every number byte by byte on some machines.
    aligned: Layout = np.dtype(members, align=True)
    return np.dtype((np.record, aligned))


def zeros(layout: Layout) -> NDArray[np.float64]:
    """Return an array of zeros of a layout's size."""
    return np.zeros(layout.itemsize // np.dtype(np.float64).itemsize)


def record(array: NDArray[np.float64], layout: Layout) -> Any:
    """
    Return the numbers of an array under their names; what is assigned to a name is written into the array.

    Raises
    ------
    ValueError
        If the array does not have exactly the size of the layout, or is not contiguous.
    """
    if array.dtype != np.float64 or array.nbytes != layout.itemsize:
        raise ValueError(
            f'an array of {array.size} {array.dtype} cannot hold a record of {layout.itemsize // 8} float64 numbers'
        )
    return array.view(layout)[0]
