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

Written by `make docs` from the parsers and the catalog of the executables. Change those, not this file.

In a ROS 2 workspace, run `ros2 run hdd_servo_ros NAME`. In the environment that `make run` creates, run
`.venv/bin/NAME`. `NAME --help` prints the same information. The help of a node also lists its parameters.

## Exit codes

These codes apply to every executable. The section of a command lists more specific meanings. [Errors](errors.md) lists
the messages.

"""
_NODES = """\
## Nodes

The nodes of the loop, `rig` and `simulate` accept ROS arguments only:

```text
NAME [--help] [--ros-args [--params-file FILE] [-p NODE:PARAMETER:=VALUE] [-r FROM:=TO] ...]
```

Later parameter files override earlier ones. A parameter without a node (`-p frequency:=200.0`) is set on every node of
the process that has it.

| executable | purpose | parameters |
|---|---|---|
"""


def document() -> str:
    """Return the page as Markdown."""
    parts = [_INTRODUCTION, _exit_codes(), '\n', _NODES]
    with_parameters: list[NodeRow | CommandRow] = [
        *NODES.values(),
        *(row for row in COMMANDS.values() if row.parameters),
    ]
    for row in with_parameters:
        parts.append(f'| `{row.name}` | {row.purpose} | [{row.name}]({page_of(row.name)}) |\n')
    commands = [row for row in COMMANDS.values() if not row.parameters]
    parts += ['\n## Commands\n\n| command | purpose |\n|---|---|\n']
    parts += [f'| [{row.name}](#{row.name}) | {row.purpose} |\n' for row in commands]
    parts += [text for row in commands for text in _section(row)]
    return ''.join(parts)


def _exit_codes() -> str:
    """Return the table of the exit codes as Markdown, from the docstring of the module that chooses them."""
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
    # The table at the top of the page has the general exit codes.
    notes = (parser.epilog or '').replace(exit_codes.EPILOG, '').strip()
    if notes:
        yield f'\n{notes}\n'


def _arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    # argparse has no public list of the arguments of a parser.
    return [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]


def _usage(parser: argparse.ArgumentParser) -> str:
    """Return the usage in one line; argparse formats its own differently in each version of Python."""
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
    has_default = 'default' in text or action.default is None or action.default is False or action.default == []
    if not has_default and action.default != float('inf'):
        text = f'{text} (default: {action.default})'.strip()
    return text.replace('|', r'\|')
