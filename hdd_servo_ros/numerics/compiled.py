"""The one decorator through which this package compiles its kernels."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from hdd_servo_ros.numerics.kernel_cache import keep_compiled

__all__ = ['compiled', 'compiled_apart']

jit: Any = numba.njit

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """
    Compile a scalar kernel ahead of its first call in later runs.

    No ``fastmath`` and no fused operations: every addition and multiplication is rounded as IEEE 754 says, so the bits
    do not depend on the machine. Division by zero gives an infinity, as in numpy, and is caught where values enter.

    A kernel allocates nothing, so references to its arrays are not counted (``_nrt``): with six arrays that would cost
    60 ns per step. One that makes an array does not compile ('Only accept returning of array passed').

    A kernel is inlined into the kernels that call it (``forceinline``): a call costs some ns, for its arrays and what
    the registers held go through memory, and one tick of the closed loop has dozens of calls.

    Parameters
    ----------
    function
        A function of numbers and arrays, in the part of Python that Numba compiles.

    Raises
    ------
    numba.core.errors.TypingError
        At the first call, if Numba cannot compile it.

    Examples
    --------
    >>> from hdd_servo_ros.numerics.compiled import compiled
    >>> @compiled
    ... def limited(u: float, limit: float) -> float:
    ...     return min(max(u, -limit), limit)
    >>> limited(12.0, 10.0)
    10.0
    """
    return _compiled(function, forceinline=True)


def compiled_apart(function: Function) -> Function:
    """
    Compile a kernel as :func:`compiled` does, but keep it a function of its own in the kernels that call it.

    For kernels that are long, called from several places, and rarely at that: copies of them would only make the
    compiled code larger, which every start has to load.

    Parameters
    ----------
    function
        As of :func:`compiled`.

    Examples
    --------
    >>> from hdd_servo_ros.numerics.compiled import compiled_apart
    >>> @compiled_apart
    ... def magnitude(u: float) -> float:
    ...     return abs(u)
    >>> magnitude(-2.5)
    2.5
    """
    return _compiled(function, forceinline=False)


def _compiled(function: Function, *, forceinline: bool) -> Function:
    kernel = jit(error_model='numpy', _nrt=False, forceinline=forceinline)(function)
    if hasattr(kernel, 'py_func'):  # not where Numba is switched off, NUMBA_DISABLE_JIT
        keep_compiled(kernel)
    return cast(Function, kernel)
