"""ROS 2 parameter files, read without ROS."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """YAML as ROS 2 reads it: PyYAML alone takes 1e-4 and 1.0e10 for texts."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][-+]?\d+)?$'),
    list('-+.0123456789'),
)


def read_parameter_files(paths: Iterable[str | Path]) -> dict[str, dict[str, object]]:
    """
    Return for each node its parameters under dotted names; later files win.

    A node is named by the last part of its section (``/**/vcm_plant``, ``/bench1/vcm_plant`` or ``vcm_plant``): these
    readers run one bench, so the namespace does not matter to them.

    Raises
    ------
    ValueError
        If a file does not have the form of a ROS 2 parameter file; the text names file and section.
    """
    nodes: dict[str, dict[str, object]] = {}
    for path in paths:
        with Path(path).open(encoding='utf-8') as file:
            document = yaml.load(file, _Loader)
        if not isinstance(document, Mapping):
            raise ValueError(f'{path}: no ROS 2 parameter file; it needs NODE: ros__parameters: ... at the top')
        for section, content in document.items():
            if not isinstance(content, Mapping) or not isinstance(content.get('ros__parameters'), Mapping):
                raise ValueError(f'{path}: section {section} holds no ros__parameters')
            node = str(section).rstrip('/').split('/')[-1]
            nodes.setdefault(node, {}).update(_dotted(content['ros__parameters']))
    return nodes


def _dotted(values: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value
