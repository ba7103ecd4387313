"""
matplotlib with its default settings, independent of the user's environment, for executables that write plots.

A notebook sets ``MPLBACKEND`` to a backend that other interpreters lack, so that importing matplotlib fails. A
``matplotlibrc`` in the working or home directory may request LaTeX, or be unreadable. Both are meant for the user's own
plots. matplotlib is imported late or never, so the settings are applied on import.
"""

import contextlib
import importlib.abc
import importlib.util
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

_NAME = 'matplotlib'
_BACKEND = 'MPLBACKEND'


def use_plain_matplotlib() -> None:
    """Import matplotlib, when it is needed, with the Agg backend and default settings; no effect once imported."""
    if _NAME not in sys.modules and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(importlib.abc.MetaPathFinder):
    """Import hook that finds matplotlib once, through the other finders."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != _NAME:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(_NAME)
        if spec is not None and spec.loader is not None and spec.origin:
            spec.loader = _Loader(spec.loader, Path(spec.origin).parent / 'mpl-data')
        return spec


class _Loader(importlib.abc.Loader):
    def __init__(self, loader: importlib.abc.Loader, defaults: Path) -> None:
        self._loader = loader
        self._defaults = defaults

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        # Suppresses the two-line warning about a read-only configuration directory, which does not affect the plots.
        logging.getLogger(_NAME).setLevel(logging.ERROR)
        with _in_folder(self._defaults), _plain_backend():
            self._loader.exec_module(module)


@contextlib.contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    """Change to the directory of matplotlib's own ``matplotlibrc``, since it searches the working directory first."""
    try:
        here = os.open('.', os.O_RDONLY)
    except OSError:
        yield
        return
    try:
        with contextlib.suppress(OSError):
            os.chdir(folder)
        yield
    finally:
        os.fchdir(here)
        os.close(here)


@contextlib.contextmanager
def _plain_backend() -> Iterator[None]:
    given = os.environ.get(_BACKEND)
    os.environ[_BACKEND] = 'Agg'
    try:
        yield
    finally:
        if given is None:
            del os.environ[_BACKEND]
        else:
            os.environ[_BACKEND] = given
