"""Chapters of the study: packages with one module per figure or table."""

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
"""Directory of the figures and tables, next to the run directories."""
_PREFIXES = ('fig_', 'table_')


class Figure(Protocol):
    """
    Interface of a module ``fig_*`` or ``table_*``; the first line of the module's docstring is the title.

    Attributes
    ----------
    CASES
        Runs that the figure or table needs.
    """

    CASES: tuple[Case, ...]
    __doc__: str

    @staticmethod
    def make(runs: RecordedRuns, path: Path) -> Path:
        """Make the figure or table from the bags, append the suffix to ``path``, and return the file."""
        ...


def figures(chapter: str, only: Iterable[str] = ()) -> dict[str, Figure]:
    """
    Return the figures and tables of a chapter by name.

    Parameters
    ----------
    chapter
        One of ``CHAPTERS``.
    only
        Names of the figures and tables to return; all if empty.

    Raises
    ------
    ArgumentError
        If the chapter has no figure or table of this name.
    """
    package = importlib.import_module(f'hdd_servo_ros.studies.{chapter}')
    found = [module.name for module in pkgutil.iter_modules(package.__path__) if module.name.startswith(_PREFIXES)]
    wanted = list(only)
    for name in wanted:
        if name not in found:
            raise ArgumentError(f'{chapter} has no figure or table {name!r}; expected one of {", ".join(found)}')
    return {
        name: cast(Figure, importlib.import_module(f'{package.__name__}.{name}'))
        for name in found
        if name in wanted or not wanted
    }


def make_figures(made: Mapping[str, Figure], directory: Path) -> list[Path]:
    """Make figures and tables from the runs in a study's directory, on all cores, and return their files."""
    (directory / FIGURES).mkdir(parents=True, exist_ok=True)
    modules = [(cast(ModuleType, figure).__name__, directory, name) for name, figure in made.items()]
    return list(on_all_cores(_make_figure, modules))


def _make_figure(due: tuple[str, Path, str]) -> Path:
    module, directory, name = due
    figure = cast(Figure, importlib.import_module(module))
    return figure.make(_recorded_runs(directory), directory / FIGURES / name)


@functools.lru_cache(1)
def _recorded_runs(directory: Path) -> RecordedRuns:
    """Return the recorded runs; all figures made by one process share them."""
    return RecordedRuns(directory)
