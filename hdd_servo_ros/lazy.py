"""Lazy imports: a package imports its public names at first use, so that importing the package itself is fast."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazily(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """
    Return a ``__getattr__`` that imports the public names of a package at first use.

    Parameters
    ----------
    package
        Name of the package.
    modules
        The module that defines each public name; a name with a leading dot is relative to the package.
    """

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        return getattr(importlib.import_module(modules[name], package), name)

    return get
