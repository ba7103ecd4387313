"""
Loading of cached kernels without their LLVM code, which is parsed only when another kernel is compiled with it.

Numba stores machine code and LLVM code in the file of a kernel. The machine code is executed; the LLVM code is inlined
into other kernels. A start that compiles nothing does not need the LLVM code, and parsing it took half of the loading
time. The file therefore contains an outline instead: a module with the same symbols, from which Numba determines the
definitions in the machine code.
"""

from typing import Any

import llvmlite.binding as llvm

Payload = tuple[Any, ...]
"""Data that Numba stores for a kernel; the first element contains name, kind and code of the library."""


def outlined(payload: Payload, library: Any) -> tuple[Payload, bytes | None]:
    """
    Return a payload with an outline instead of the LLVM code, and the LLVM code.

    Parameters
    ----------
    payload
        Payload that Numba would store.
    library
        Library of the kernel.

    Returns
    -------
    payload, bitcode
        Payload with the outline, and the LLVM code; or the unchanged payload and None, if its format is unknown.
    """
    (name, kind, code), *others = payload
    if kind != 'object' or len(code) != 2 or not hasattr(library, '_get_module_for_linking'):
        return payload, None
    machine_code, bitcode = code
    return ((name, kind, (machine_code, _outline(bitcode))), *others), bitcode


def _outline(bitcode: bytes) -> bytes:
    """Return the bitcode of a module that defines the same symbols, but with bodies that must not be executed."""
    module = llvm.parse_bitcode(bitcode)
    functions = [found.name for found in module.functions if not found.is_declaration]
    variables = [found.name for found in module.global_variables if not found.is_declaration]
    lines = [f'define void @{_quoted(name)}() {{ unreachable }}' for name in functions]
    lines += [f'@{_quoted(name)} = global i8 0' for name in variables]
    outline: bytes = llvm.parse_assembly('\n'.join(lines)).as_bitcode()
    return outline


def _quoted(name: str) -> str:
    """Return a name as a quoted LLVM identifier."""
    return '"' + ''.join(f'\\{byte:02x}' for byte in name.encode()) + '"'


def complete_when_linked(library: Any, bitcode: bytes) -> None:
    """Make a library that was loaded with an outline parse its LLVM code when it is first linked."""
    module_for_linking = library._get_module_for_linking

    def complete() -> Any:
        del library._get_module_for_linking
        library._shared_module = llvm.parse_bitcode(bitcode)
        return module_for_linking()

    library._get_module_for_linking = complete
