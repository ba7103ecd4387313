"""
matplotlib with its own defaults, whatever the caller's environment says, for executables that draw into files.

A notebook sets ``MPLBACKEND`` to a backend that other interpreters do not have, so that importing matplotlib fails; a
``matplotlibrc`` in the working folder or the home directory asks for LaTeX, or cannot be read. Both are for the figures
that their user draws. matplotlib is imported late, or never, so this waits until it is.
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
    """Have matplotlib imported with the Agg backend and its own defaults; where it is imported already, it stays."""
    if _NAME not in sys.modules and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(importlib.abc.MetaPathFinder):
    """Finds matplotlib once, as the others find it."""

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
        # A configuration folder that cannot be written is told in two lines, and what is drawn is the same without.
        logging.getLogger(_NAME).setLevel(logging.ERROR)
        with _in_folder(self._defaults), _plain_backend():
            self._loader.exec_module(module)


@contextlib.contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    """Work in the folder of matplotlib's own ``matplotlibrc``: the working folder is where it looks first."""
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
