"""`docs/parameters.md`: every parameter of every node, from the declarations that the nodes themselves use."""

import collections
import dataclasses
import inspect
from collections.abc import Iterator
from typing import Any

from hdd_servo_ros.graph.catalogue import names_with_parameters, parameter_sets, purpose
from hdd_servo_ros.parameters import Declaration, declarations

_INTRODUCTION = """\
# Parameters

Written by `make docs` from the declarations in the code, the same that `ros2 param describe`, `NAME --help` and the
checks at start and during a run come from. Change the declarations, not this file.

Numbers without a unit are ratios, counts or seeds. A *fixed* parameter cannot be changed once its node has started; all
others can at any time, take effect at the node's next tick, and the bag shows at which. A change that is refused says
why, and changes nothing; several set together (`set_parameters_atomically`) change together or not at all.
"""
_HEADER = '| parameter | default | unit | allowed | meaning |\n|---|---|---|---|---|'


def document() -> str:
    """Return the whole document as Markdown."""
    used = collections.Counter(kind for name in names_with_parameters() for kind in parameter_sets(name))
    shared = [kind for kind, count in used.items() if count > 1]
    parts = [_INTRODUCTION]
    for name in names_with_parameters():
        kinds = parameter_sets(name)
        links = [_link(kind) for kind in kinds if kind in shared]
        parts.append(f'## {name}\n\n{purpose(name)}' + (f' Has {" and ".join(links)}.' if links else '') + '\n')
        parts += _table(row for kind in kinds if kind not in shared for row in _rows(kind))
    for kind in shared:
        parts.append(f'## {_title(kind)}\n\n{inspect.getdoc(kind)}\n')
        parts += _table(_rows(kind))
    return '\n'.join(parts)


def _table(rows: Iterator[str]) -> list[str]:
    found = list(rows)
    return ['\n'.join([_HEADER, *found]) + '\n'] if found else []


def _rows(kind: type[Any]) -> Iterator[str]:
    for declaration in declarations(kind):
        allowed = dataclasses.replace(declaration, unit='').allowed + (', fixed' if declaration.read_only else '')
        cells = [
            f'`{declaration.name}`',
            f'`{_value(declaration)}`',
            declaration.unit,
            allowed,
            declaration.description,
        ]
        yield '| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |'


def _value(declaration: Declaration) -> str:
    """Return the default as a parameter file has it."""
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
    return f'The {words}'


def _link(kind: type[Any]) -> str:
    title = _title(kind)
    return f'[{title[0].lower()}{title[1:]}](#{title.lower().replace(" ", "-")})'
