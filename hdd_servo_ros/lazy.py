"""Names that a package offers and imports only when they are asked for, so that importing it costs nothing."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """
    Return the ``__getattr__`` of a package that offers names of its modules.

    Parameters
    ----------
    package
        Name of the package.
    homes
        For each name that it offers, the module that has it, relative to the package if that begins with a dot.
    """

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        return getattr(importlib.import_module(homes[name], package), name)

    return get
