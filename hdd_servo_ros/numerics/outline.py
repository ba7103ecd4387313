"""
Loads the machine code of a cached kernel alone, and its LLVM code only where another kernel is compiled with it.

Numba keeps both in a kernel's file: the one is run, the other is what is inlined into further kernels. A start that
compiles nothing has no use for the latter, and parsing it took half of the time of loading kernels. So the file has an
outline in its place: a module with the same symbols, by which Numba finds what the machine code defines.
"""

from typing import Any

import llvmlite.binding as llvm

Payload = tuple[Any, ...]
"""What Numba stores of a kernel; first the name, the kind and the code of its library."""


def outlined(payload: Payload, library: Any) -> tuple[Payload, bytes | None]:
    """
    Return a payload with an outline in place of the LLVM code, and that code.

    Parameters
    ----------
    payload
        What Numba would store.
    library
        The library of the kernel.

    Returns
    -------
    payload, bitcode
        As it was, and None, if it is not as this package knows it of Numba.
    """
    (name, kind, code), *others = payload
    if kind != 'object' or len(code) != 2 or not hasattr(library, '_get_module_for_linking'):
        return payload, None
    machine_code, bitcode = code
    return ((name, kind, (machine_code, _outline(bitcode))), *others), bitcode


def _outline(bitcode: bytes) -> bytes:
    """Return the bitcode of a module that defines the same symbols, as something that must not be run."""
    module = llvm.parse_bitcode(bitcode)
    functions = [found.name for found in module.functions if not found.is_declaration]
    variables = [found.name for found in module.global_variables if not found.is_declaration]
    lines = [f'define void @{_quoted(name)}() {{ unreachable }}' for name in functions]
    lines += [f'@{_quoted(name)} = global i8 0' for name in variables]
    outline: bytes = llvm.parse_assembly('\n'.join(lines)).as_bitcode()
    return outline


def _quoted(name: str) -> str:
    """Return a name as LLVM writes any name."""
    return '"' + ''.join(f'\\{byte:02x}' for byte in name.encode()) + '"'


def complete_when_linked(library: Any, bitcode: bytes) -> None:
    """Have a library that was loaded with an outline take its LLVM code once that is to be linked."""
    module_for_linking = library._get_module_for_linking

    def complete() -> Any:
        del library._get_module_for_linking
        library._shared_module = llvm.parse_bitcode(bitcode)
        return module_for_linking()

    library._get_module_for_linking = complete
