"""Decorators with which this package compiles its kernels."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from hdd_servo_ros.numerics.kernel_cache import keep_compiled

__all__ = ['compiled', 'compiled_apart']

jit: Any = numba.njit

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """
    Compile a scalar kernel, and cache the machine code for later runs.

    ``fastmath`` and fused operations are off: every addition and multiplication is rounded according to IEEE 754, so
    the results are bit-identical on every machine. Division by zero gives an infinity, as in numpy; values are checked
    where they enter.

    A kernel allocates no memory, so reference counting of its arrays is disabled (``_nrt``); with six arrays it would
    cost 60 ns per step. A kernel that creates an array does not compile ('Only accept returning of array passed').

    A kernel is inlined into the kernels that call it (``forceinline``). A call costs a few ns, because its arrays and
    the saved registers go through memory, and one tick of the closed loop has dozens of calls.

    Parameters
    ----------
    function
        Function of numbers and arrays, in the subset of Python that Numba compiles.

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
    Compile a kernel like :func:`compiled`, but do not inline it into the kernels that call it.

    Use it for long kernels that are called rarely and more than once in the code: inlined copies of them would only
    enlarge the compiled code, which is loaded at every start.

    Parameters
    ----------
    function
        See :func:`compiled`.

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
    if hasattr(kernel, 'py_func'):  # false with NUMBA_DISABLE_JIT
        keep_compiled(kernel)
    return cast(Function, kernel)
