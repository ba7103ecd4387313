"""Help of the executables, from the declarations of their parameters; no ROS import."""

from collections.abc import Sequence

from hdd_servo_ros.graph.catalog import COMMANDS, NODES, purpose
from hdd_servo_ros.graph.known_parameters import node_declarations

COMPILING = 'compiling the drive and the controllers; this takes about 20 s, only once'


def parse_help(name: str, arguments: Sequence[str]) -> None:
    """Handle ``--help`` and reject arguments that are not ROS arguments; both exit the process."""
    if not arguments:
        return
    # Imported here, because most runs have no such arguments.
    import argparse

    from hdd_servo_ros.messages.command_line import CommandParser

    parser = CommandParser(
        prog=name,
        description=purpose(name),
        epilog=_parameters_text(name),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage=f'{name} [--help] [--ros-args [--params-file FILE] [-p NODE:PARAMETER:=VALUE] [-r FROM:=TO] ...]',
    )
    _, others = parser.parse_known_args(arguments)
    if others:
        hint = '; put ROS arguments after --ros-args' if any(':=' in word for word in others) else ''
        parser.error(f'unrecognized arguments: {" ".join(others)}{hint}')


def _parameters_text(name: str) -> str:
    lines = [f'parameters of {name}:']
    for declaration in node_declarations(name):
        default = list(declaration.default) if isinstance(declaration.default, tuple) else declaration.default
        lines.append(f'  {declaration.name} (default {default})')
        lines.append(f'      {declaration.description_with_equation}; {declaration.allowed}')
    if name in COMMANDS:
        lines.append(f'and those of its nodes as NODE:PARAMETER (see NODE --help): {", ".join(NODES)}')
    return '\n'.join(lines)
