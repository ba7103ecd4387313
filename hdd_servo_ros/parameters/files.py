"""
ROS 2 arguments and parameter files read without ROS, for `simulate`.

The same command line and the same files mean the same as to a ROS node: several files and ``-p`` overlay from left to
right, node names may hold the wildcards ``*`` (one part) and ``**`` (any parts).
"""

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from hdd_servo_ros.parameters import ParameterError


class ArgumentError(ValueError):
    """A command line or a parameter file that cannot be read; says what and where."""


_Loader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""That of libyaml, by which ROS reads as well, where PyYAML was built with it: ten times faster."""


class _RosLoader(_Loader):  # type: ignore[misc]
    """YAML as ROS reads it: ``1e-4`` is a number, though YAML 1.1 wants a dot in it, and a bare ``N`` is false."""

    bool_values = {**yaml.SafeLoader.bool_values, 'y': True, 'n': False}  # noqa: RUF012 - as the base has it


_RosLoader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$'), list('-+0123456789')
)
_RosLoader.add_implicit_resolver('tag:yaml.org,2002:bool', re.compile('^[yYnN]$'), list('yYnN'))


@dataclasses.dataclass
class RosArguments:
    """
    A ROS command line.

    Attributes
    ----------
    overrides
        Node pattern and parameters, in the order in which they were given; later ones win.
    named
        The node patterns among them that were named with ``-p``; a file may hold sections for nodes that are not here.
    namespace
        From ``-r __ns:=``.
    remaps
        Further remappings of names, as given.
    others
        What is none of ROS's.
    """

    overrides: list[tuple[str, dict[str, object]]]
    named: list[str]
    namespace: str
    remaps: dict[str, str]
    others: list[str]

    def parameters_of(self, node: str) -> dict[str, object]:
        """Return the parameters given for a node, by its name without namespace."""
        full_name = f'{self.namespace.rstrip("/")}/{node}'
        values: dict[str, object] = {}
        for pattern, parameters in self.overrides:
            if _matches(pattern, full_name):
                values.update(parameters)
        return values

    def names(self, node: str) -> bool:
        """Return whether a node is named: by a section of its own in a file or by ``-p``, not by a wildcard for all."""
        full_name = f'{self.namespace.rstrip("/")}/{node}'
        return any(pattern.rsplit('/', 1)[-1] == node and _matches(pattern, full_name) for pattern, _ in self.overrides)

    def is_for_all(self, name: str) -> bool:
        """Return whether a parameter was given for all nodes and for none by its name."""
        patterns = [pattern for pattern, parameters in self.overrides if name in parameters]
        return bool(patterns) and all(pattern.endswith('*') for pattern in patterns)

    def check_nodes(self, nodes: Sequence[str]) -> None:
        """
        Refuse a ``-p NODE:PARAMETER`` for a node that there is not.

        Raises
        ------
        ArgumentError
            If a pattern matches none of ``nodes``.
        """
        names = [f'{self.namespace.rstrip("/")}/{node}' for node in nodes]
        for pattern in self.named:
            if not any(_matches(pattern, name) for name in names):
                raise ArgumentError(f'parameters for {pattern!r}, but there are {", ".join(names)}')


def parse_ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """
    Read a command line (without the program's name).

    Raises
    ------
    ArgumentError
        If an argument or a file is malformed.
    """
    parsed = RosArguments([], [], '/', {}, [])
    rest = list(arguments)
    in_ros = False
    while rest:
        argument = rest.pop(0)
        if argument == '--ros-args':
            in_ros = True
        elif not in_ros:
            parsed.others.append(argument)
        elif argument == '--':
            in_ros = False
        elif argument in ('-p', '--param'):
            parsed.overrides.append(_parse_parameter(_value_of(argument, rest)))
            parsed.named.append(parsed.overrides[-1][0])
        elif argument == '--params-file':
            parsed.overrides += read_parameter_file(Path(_value_of(argument, rest)))
        elif argument in ('-r', '--remap'):
            _parse_remap(_value_of(argument, rest), parsed)
        elif argument in ('--log-level', '--log-config-file', '--log-file-name', '-e', '--enclave'):
            _value_of(argument, rest)
        elif not argument.startswith(('--disable-', '--enable-')):
            raise ArgumentError(f'unknown ROS argument {argument!r}')
    return parsed


def _value_of(argument: str, rest: list[str]) -> str:
    if not rest:
        raise ArgumentError(f'{argument} wants a value behind it')
    return rest.pop(0)


def _parse_parameter(text: str) -> tuple[str, dict[str, object]]:
    match = re.fullmatch(r'(?:([^:]+):)?([^:=]+):=(.*)', text, re.DOTALL)
    if not match:
        raise ArgumentError(f'-p {text!r} is not NODE:PARAMETER:=VALUE or PARAMETER:=VALUE')
    node, name, value = match.groups()
    try:
        return _pattern(node or '/**'), {name: parse_value(value)}
    except ArgumentError as error:
        raise ArgumentError(f'-p {text!r}: {error}') from None


def parse_value(text: str) -> object:
    """
    Return a parameter's value from its text, lists as tuples.

    Raises
    ------
    ArgumentError
        If it is no YAML.
    """
    try:
        return _value(yaml.load(text, _RosLoader))
    except yaml.YAMLError as error:
        raise ArgumentError(str(error)) from None


def _parse_remap(text: str, parsed: RosArguments) -> None:
    source, separator, target = text.partition(':=')
    if not separator:
        raise ArgumentError(f'-r {text!r} is not FROM:=TO')
    if source.endswith('__ns'):
        parsed.namespace = '/' + target.strip('/')
    else:
        parsed.remaps[source] = target


def read_parameter_file(path: Path) -> list[tuple[str, dict[str, object]]]:
    """
    Return node patterns and their parameters from a ROS 2 parameter file, in the file's order.

    Raises
    ------
    ArgumentError
        If the file cannot be read or is no ROS 2 parameter file.
    """
    try:
        content = yaml.load(path.read_text('utf8'), _RosLoader)
    except (OSError, yaml.YAMLError) as error:
        raise ArgumentError(f'parameter file {path}: {error}') from None
    if not isinstance(content, dict):
        raise ArgumentError(f'parameter file {path}: expected node names at the top')
    return list(_sections(content, '', path))


def read_parameter_files(paths: Iterable[str | Path]) -> dict[str, dict[str, object]]:
    """
    Return for each node its parameters under dotted names, whatever the namespace; later files win.

    Raises
    ------
    ArgumentError
        If a file cannot be read or is no ROS 2 parameter file.
    """
    nodes: dict[str, dict[str, object]] = {}
    for path in paths:
        for pattern, parameters in read_parameter_file(Path(path)):
            nodes.setdefault(pattern.rsplit('/', 1)[-1], {}).update(parameters)
    return nodes


def _sections(content: Mapping[Any, Any], prefix: str, path: Path) -> Iterator[tuple[str, dict[str, object]]]:
    for key, value in content.items():
        if not isinstance(value, dict):
            raise ArgumentError(f'parameter file {path}: {key!r} holds neither ros__parameters nor further names')
        name = f'{prefix}/{str(key).strip("/")}'
        if 'ros__parameters' in value:
            yield _pattern(name), dict(_flatten(value['ros__parameters'] or {}, ''))
        else:
            yield from _sections(value, name, path)


def _flatten(parameters: Mapping[Any, Any], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in parameters.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', _value(value)


def _value(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def _pattern(name: str) -> str:
    return '/' + name.strip('/')


def _matches(pattern: str, full_name: str) -> bool:
    # As rcl has it, '/**/node' matches '/node' too.
    expression = re.escape(pattern).replace(r'/\*\*', r'(/[^/]+)*').replace(r'\*', '[^/]+')
    return re.fullmatch(expression, full_name) is not None


def with_node(error: ParameterError, node: str) -> ParameterError:
    """Return a parameter error whose name begins with the node's."""
    return ParameterError(f'{node}:{error.name}', error.value, error.allowed)
