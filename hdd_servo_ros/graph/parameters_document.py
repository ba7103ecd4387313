"""
`docs/reference/parameters/`: every parameter of every node, from the declarations that the nodes use.

One page per node, and one for the parameter sets that several nodes share.
"""

import collections
import inspect
from collections.abc import Iterator
from typing import Any

from hdd_servo_ros.graph.catalog import names_with_parameters, parameter_sets, purpose
from hdd_servo_ros.parameters import Declaration, declarations

FOLDER = 'parameters'
"""Directory of these pages, below the reference directory."""
_SHARED = 'shared.md'
_INDEX = """\
# Parameters

Written by `make docs` from the declarations in the code. `ros2 param describe`, `NAME --help` and all parameter checks
use the same declarations. Change them, not these files.

Numbers without a unit are ratios, counts or seeds. A *fixed* parameter cannot be changed once its node has started. All
others can be changed at any time. A change takes effect at the node's next tick, which the bag records. A rejected
change returns the reason and has no effect. Parameters that are set together (`set_parameters_atomically`) change
together or not at all.

[Change parameters](../../howto/change-parameters.md) explains how to set them.

| node | purpose |
|---|---|
"""
_SHARED_INTRODUCTION = """\
# Parameters of several nodes

Written by `make docs` from the declarations in the code. The page of each node lists the sets that it has.
"""
_HEADER = '| parameter | default | unit | type and range | description | thesis eq. |\n|---|---|---|---|---|---|'


def page_of(name: str) -> str:
    """Return the path of the page of a node or command, relative to the reference directory."""
    return f'{FOLDER}/{name}.md'


def pages() -> dict[str, str]:
    """Return the pages as Markdown, by their paths relative to the reference directory."""
    found = {f'{FOLDER}/index.md': _index()}
    found |= {page_of(name): _page(name) for name in names_with_parameters()}
    found[f'{FOLDER}/{_SHARED}'] = _shared_page()
    return found


def _index() -> str:
    names = names_with_parameters()
    rows = [f'| [`{name}`]({name}.md) | {purpose(name)} |' for name in names]
    rows.append(f'| [several nodes]({_SHARED}) | Parameter sets that several nodes share. |')
    entries = '\n'.join([*names, _SHARED.removesuffix('.md')])
    return _INDEX + '\n'.join(rows) + f'\n\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n'


def _page(name: str) -> str:
    shared, kinds = _shared(), parameter_sets(name)
    parts = [f'# {name}\n\n{purpose(name)}\n']
    parts += _table(row for kind in kinds if kind not in shared for row in _rows(kind))
    links = [f'- {_link(kind)}\n' for kind in kinds if kind in shared]
    if links:
        parts.append(f'## Shared parameters\n\nSets that other nodes have too:\n\n{"".join(links)}')
    return '\n'.join(parts)


def _shared_page() -> str:
    parts = [_SHARED_INTRODUCTION]
    for kind in _shared():
        parts.append(f'## {_title(kind)}\n\n{_summary(kind)}\n')
        parts += _table(_rows(kind))
    return '\n'.join(parts)


def _shared() -> list[type[Any]]:
    """Return the parameter sets that more than one node has."""
    used = collections.Counter(kind for name in names_with_parameters() for kind in parameter_sets(name))
    return [kind for kind, count in used.items() if count > 1]


def _summary(kind: type[Any]) -> str:
    """Return the text of a docstring before its sections, which are for readers of the code."""
    return (inspect.getdoc(kind) or '').partition('\n\nAttributes\n')[0].partition('\n\nExamples\n')[0]


def _table(rows: Iterator[str]) -> list[str]:
    found = list(rows)
    return ['\n'.join([_HEADER, *found]) + '\n'] if found else []


def _rows(kind: type[Any]) -> Iterator[str]:
    for declaration in declarations(kind):
        cells = [
            f'`{declaration.name}`',
            f'`{_value(declaration)}`',
            declaration.unit,
            declaration.type_and_range + (', fixed' if declaration.read_only else ''),
            declaration.description,
            declaration.equation,
        ]
        yield '| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |'


def _value(declaration: Declaration) -> str:
    """Return the default in the syntax of a parameter file."""
    default = declaration.default
    if isinstance(default, tuple):
        return '[' + ', '.join(map(_scalar, default)) + ']'
    return _scalar(default)


def _scalar(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value) or "''"


def _title(kind: type[Any]) -> str:
    words = ''.join(' ' + letter.lower() if letter.isupper() else letter for letter in kind.__name__).strip()
    return (words[0].upper() + words[1:]).replace('Pid ', 'PID ')


def _link(kind: type[Any]) -> str:
    title = _title(kind)
    return f'[{title}]({_SHARED}#{title.lower().replace(" ", "-")})'
