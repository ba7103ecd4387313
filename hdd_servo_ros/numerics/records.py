"""
Named access to the elements of an array.

A block keeps its constants and its state in plain float64 arrays, which are cheap to pass into compiled code. A layout
names each element of such an array, and ``c = record(constants, LAYOUT)`` makes the elements readable and writable as
``c.gain``, in Python and in kernels. A field that is a layout itself is again a record, and can be passed on to another
kernel: ``level(c.friction, v)``.

Two rules apply. The array has exactly the size of its layout. Data of variable length (modes, nodes, a history) are in
a separate array, because slicing inside a kernel costs more than the kernel itself.
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
        In order, the name of a number, or the name of a nested record and its layout.
    """
    members = [(field, np.dtype(np.float64)) if isinstance(field, str) else field for field in fields]
    # Without alignment, compiled code would load each number byte by byte on some machines.
    aligned: Layout = np.dtype(members, align=True)
    return np.dtype((np.record, aligned))


def size(layout: Layout) -> int:
    """Return the number of float64 elements in a layout."""
    return layout.itemsize // np.dtype(np.float64).itemsize


def zeros(layout: Layout) -> NDArray[np.float64]:
    """Return an array of zeros with the size of a layout."""
    return np.zeros(size(layout))


def record(array: NDArray[np.float64], layout: Layout, row: int = 0) -> Any:
    """
    Return a record view of an array; assigning to a field writes into the array.

    Parameters
    ----------
    array
        Array of shape (size,), or (n, size) with one record per row.
    layout
        Layout of the record; in a kernel, it must be a global constant.
    row
        Index of the row.

    Raises
    ------
    ValueError
        If the array does not have exactly the size of the layout, or is not contiguous. Compiled code checks neither
        the size nor the index, because a check would cost 8 ns per call.
    """
    if array.dtype != np.float64 or array.ndim > 2 or array.shape[-1] != size(layout):
        raise ValueError(
            f'an array of {array.dtype} and shape {array.shape} cannot hold records of {size(layout)} float64 numbers'
        )
    return np.atleast_2d(array)[row].view(layout)[0]


@intrinsic
def _record_at(typing_context: Any, array: Any, layout: Any, row: Any) -> Any:
    """Return the record at a row as a bare pointer, which avoids the cost of an array view."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # Imported late, because the import is slow and only needed for compilation.
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
