"""`docs/reference/executables.md`: purpose, usage, options and exit codes of every executable, from its own parser."""

import argparse
import inspect
import re
from collections.abc import Iterator

from hdd_servo_ros.graph.catalog import COMMANDS, NODES, CommandRow, NodeRow, resolve
from hdd_servo_ros.graph.parameters_document import page_of
from hdd_servo_ros.messages import exit_codes

_INTRODUCTION = """\
# Executables

Written by `make docs` from the parsers and the catalog of the executables; change those, not this file.

With ROS 2 an executable runs as `ros2 run hdd_servo_ros NAME`, in the environment of `make run` as `.venv/bin/NAME`.
`NAME --help` prints what is listed here; that of a node lists its parameters too.

## Exit codes

A command that needs other words for a code has them in its own section.

"""
_NODES = """\
## Nodes

The nodes of the loop, `rig` and `simulate` take their parameters from ROS arguments alone:

```text
NAME [--help] [--ros-args [--params-file FILE] [-p NODE:PARAMETER:=VALUE] [-r FROM:=TO] ...]
```

Several parameter files overlay from left to right. A parameter without a node (`-p frequency:=200.0`) goes to whichever
node of the process has it.

| executable | purpose | parameters |
|---|---|---|
"""


def document() -> str:
    """Return the whole document as Markdown."""
    parts = [_INTRODUCTION, _exit_codes(), '\n', _NODES]
    with_parameters: list[NodeRow | CommandRow] = [
        *NODES.values(),
        *(row for row in COMMANDS.values() if row.parameters),
    ]
    for row in with_parameters:
        parts.append(f'| `{row.name}` | {row.purpose} | [{row.name}]({page_of(row.name)}) |\n')
    parts += ['\n## Commands\n']
    parts += [text for row in COMMANDS.values() if not row.parameters for text in _section(row)]
    return ''.join(parts)


def _exit_codes() -> str:
    """Return the table of the exit codes as Markdown; it stands in the docstring of the module that chooses them."""
    rows = re.findall(r'^(\d+(?: \+ n)?) {2,}(.+)$', inspect.getdoc(exit_codes) or '', re.MULTILINE)
    return '| exit code | meaning |\n|---|---|\n' + ''.join(f'| {code} | {meaning} |\n' for code, meaning in rows)


def _section(row: CommandRow) -> Iterator[str]:
    yield f'\n### {row.name}\n\n'
    if row.name == 'outside_controller':
        yield f'{row.purpose}\n\n```text\n{resolve(f"{row.module}:USAGE").removeprefix("usage: ")}\n```\n'
        return
    parser: argparse.ArgumentParser = resolve(f'{row.module}:command_line')()
    yield f'{parser.description}\n\n```text\n{_usage(parser)}\n```\n\n'
    yield '| argument | meaning |\n|---|---|\n'
    for action in _arguments(parser):
        yield f'| {_shown(action)} | {_meaning(action, parser.prog)} |\n'
    if parser.epilog:
        yield f'\n{parser.epilog}\n'


def _arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    # argparse lists what a parser takes nowhere else.
    return [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]


def _usage(parser: argparse.ArgumentParser) -> str:
    """Return one line of usage: argparse's own is laid out differently by each version of Python."""
    options = [action for action in _arguments(parser) if action.option_strings]
    words = [parser.prog, *(f'[{_option(action)}]' for action in options if not action.required)]
    words += [_option(action) for action in options if action.required]
    words += [_positional(action) for action in _arguments(parser) if not action.option_strings]
    return ' '.join(words)


def _value(action: argparse.Action) -> str:
    if isinstance(action.metavar, tuple):
        return ' '.join(action.metavar)
    name = action.metavar if isinstance(action.metavar, str) else (action.dest.upper() if action.option_strings else '')
    if action.choices is not None and action.metavar is None:
        name = '{' + ','.join(str(choice) for choice in action.choices) + '}'
    return name or action.dest


def _option(action: argparse.Action) -> str:
    (name,) = action.option_strings
    if action.nargs == 0:
        return name
    value = _value(action)
    more = {'+': f'{value} ...', '*': f'[{value} ...]'}.get(str(action.nargs), value)
    return f'{name} {more}'


def _positional(action: argparse.Action) -> str:
    value = _value(action)
    if isinstance(action.nargs, int):
        return ' '.join([value] * action.nargs)
    return {'?': f'[{value}]', '+': f'{value} ...', '*': f'[{value} ...]'}.get(str(action.nargs), value)


def _shown(action: argparse.Action) -> str:
    return f'`{_option(action) if action.option_strings else _positional(action)}`'.replace('|', r'\|')


def _meaning(action: argparse.Action, prog: str) -> str:
    text = (action.help or '') % {**vars(action), 'prog': prog}
    is_told = 'default' in text or action.default is None or action.default is False or action.default == []
    if not is_told and action.default != float('inf'):
        text = f'{text} (default: {action.default})'.strip()
    return text.replace('|', r'\|')
