"""
Names for the numbers of an array.

A block keeps its constants and its state in plain float64 arrays, which are cheap to pass into compiled code. A layout
gives every number of such an array a name, and ``c = record(constants, LAYOUT)`` makes them readable and writable as
``c.gain``, in Python and in a kernel alike. A field that is a layout itself is a record again and can be passed on to
another kernel: ``level(c.friction, v)``.

Two rules come with it. The array has exactly the size of its layout. What has a variable length (modes, nodes, a
history) is an array of its own, since cutting it off inside a kernel costs more than the kernel.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic, overload
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


def size(layout: Layout) -> int:
    """Return how many numbers a layout has."""
    return layout.itemsize // np.dtype(np.float64).itemsize


def zeros(layout: Layout) -> NDArray[np.float64]:
    """Return an array of zeros of a layout's size."""
    return np.zeros(size(layout))


def record(array: NDArray[np.float64], layout: Layout, row: int = 0) -> Any:
    """
    Return the numbers of an array under their names; what is assigned to a name is written into the array.

    Parameters
    ----------
    array
        Numbers of shape (size,) or, with a record per row, (n, size).
    layout
        Their names; a global constant, if this is called in a kernel.
    row
        Which row.

    Raises
    ------
    ValueError
        If the array does not have exactly the size of the layout, or is not contiguous. Compiled code does not check
        the size, as it does not check an index: 8 ns each time.
    """
    if array.dtype != np.float64 or array.ndim > 2 or array.shape[-1] != size(layout):
        raise ValueError(
            f'an array of {array.dtype} and shape {array.shape} cannot hold records of {size(layout)} float64 numbers'
        )
    return np.atleast_2d(array)[row].view(layout)[0]


@intrinsic
def _record_at(typing_context: Any, array: Any, layout: Any, row: Any) -> Any:
    """Return the record at a row: a bare pointer, which costs nothing where a view of the array would be made."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # Late: where nothing is compiled, it is not imported otherwise, and takes a while.
        from numba.np.arrayobj import make_array

        data = make_array(array)(context, builder, arguments[0]).data  # type: ignore[no-untyped-call]
        first = builder.bitcast(data, context.get_value_type(signature.return_type))
        return builder.gep(first, [arguments[2]], inbounds=True)

    return layout.dtype(array, layout, types.intp), generate


@overload(record)
def _record_in_a_kernel(array: Any, layout: Any, row: int = 0) -> Callable[..., Any] | None:
    is_of_numbers = isinstance(array, types.Array) and array.dtype == types.float64 and array.layout == 'C'
    if not is_of_numbers or not isinstance(layout, types.DType) or not isinstance(layout.dtype, types.Record):
        return None

    def implementation(array: Any, layout: Any, row: int = 0) -> Any:
        return _record_at(array, layout, row)  # type: ignore[call-arg]

    return implementation
