"""Digests of the code and files that the runs of a campaign read in addition to their parameters."""

import hashlib
import importlib
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

_PIECE = 1 << 20


def digests(
    nodes: Iterable[Mapping[str, Mapping[str, Any]]],
    further: Iterable[object],
    metrics: Mapping[str, Callable[..., float]],
) -> dict[str, str]:
    """
    Return the digests of the inputs of a campaign, by the name used in messages.

    For a metric or a custom controller the digest is that of the file that defines it, without the modules that it
    imports.

    Parameters
    ----------
    nodes
        For each controller the nodes of its runs by full name, as in :attr:`Simulation.nodes`.
    further
        Further parameter values.
    metrics
        User-defined metrics by import path.
    """
    found: dict[str, str] = {}
    strings = [value for value in further if isinstance(value, str)]
    for node in (node for of_controller in nodes for node in of_controller.values()):
        offers = node['offers']
        if 'controller_sha256' in offers:
            found[f'controller {offers["controller_class"]}'] = offers['controller_sha256']
        strings += [value for value in node['parameters'].values() if isinstance(value, str)]
    for text in dict.fromkeys(strings):
        for file in _files(text):
            found[f'file {file}'] = _digest(file)
    for path, metric in metrics.items():
        for file in _sources(path, metric):
            found[f'metric {path}, {file.name}'] = _digest(file)
    return found


def _files(text: str) -> Iterator[Path]:
    """Yield the files that a parameter value names: the file itself, or the files of a recorded run."""
    path = Path(text)
    try:
        if text and path.is_file():
            yield path
        elif text and (path / 'run.yaml').is_file():
            yield from sorted(file for file in path.rglob('*') if file.is_file())
    except (OSError, ValueError):
        # Not a valid file name.
        return


def _sources(path: str, metric: Callable[..., float]) -> list[Path]:
    """Return the files that define a metric: that of its module and, if different, that of its function."""
    found = [getattr(importlib.import_module(path.partition(':')[0]), '__file__', None)]
    try:
        found.append(inspect.getsourcefile(inspect.unwrap(metric)))
    except TypeError:
        # A built-in function, or an instance.
        found.append(None)
    return [file for file in map(Path, dict.fromkeys(filter(None, found))) if file.is_file()]


def _digest(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open('rb') as opened:
        while piece := opened.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()
