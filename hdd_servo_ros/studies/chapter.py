"""A chapter of the study: a package with one module for each figure or table."""

import functools
import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Protocol, cast

from hdd_servo_ros.campaign.all_cores import on_all_cores
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.parameters.files import ArgumentError

CHAPTERS = ('chapter4', 'chapter5', 'baseline', 'mobile', 'seek')
FIGURES = 'figures'
"""The folder of the pictures and tables, beside those of the runs."""
_PREFIXES = ('fig_', 'table_')


class Figure(Protocol):
    """
    What a module ``fig_*`` or ``table_*`` of a chapter holds; the first line of its docstring is its title.

    Attributes
    ----------
    CASES
        The runs that it needs.
    """

    CASES: tuple[Case, ...]
    __doc__: str

    @staticmethod
    def make(runs: RecordedRuns, path: Path) -> Path:
        """Make it from the bags alone, as ``path`` with a suffix of its own, and return the file."""
        ...


def figures(chapter: str, only: Iterable[str] = ()) -> dict[str, Figure]:
    """
    Return the figures and tables of a chapter by name.

    Parameters
    ----------
    chapter
        One of ``CHAPTERS``.
    only
        Names of those wanted; all if there is none.

    Raises
    ------
    ArgumentError
        If a name is not there.
    """
    package = importlib.import_module(f'hdd_servo_ros.studies.{chapter}')
    found = [module.name for module in pkgutil.iter_modules(package.__path__) if module.name.startswith(_PREFIXES)]
    wanted = list(only)
    for name in wanted:
        if name not in found:
            raise ArgumentError(f'{chapter} has no {name!r}; it has {", ".join(found)}')
    return {
        name: cast(Figure, importlib.import_module(f'{package.__name__}.{name}'))
        for name in found
        if name in wanted or not wanted
    }


def make_figures(made: Mapping[str, Figure], directory: Path) -> list[Path]:
    """Make figures and tables from the runs in a study's folder, on all cores, and return their files."""
    (directory / FIGURES).mkdir(parents=True, exist_ok=True)
    modules = [(cast(ModuleType, figure).__name__, directory, name) for name, figure in made.items()]
    return list(on_all_cores(_make_figure, modules))


def _make_figure(due: tuple[str, Path, str]) -> Path:
    module, directory, name = due
    figure = cast(Figure, importlib.import_module(module))
    return figure.make(_recorded_runs(directory), directory / FIGURES / name)


@functools.lru_cache(1)
def _recorded_runs(directory: Path) -> RecordedRuns:
    """Return the runs as all figures of a process share them."""
    return RecordedRuns(directory)
