"""
ROS 2 arguments and parameter files, parsed without ROS for `simulate`.

Command lines and files have the same meaning as for a ROS node: several files and ``-p`` are applied from left to
right, and node names may contain the wildcards ``*`` (one part) and ``**`` (any number of parts).
"""

import contextlib
import dataclasses
import difflib
import functools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.remapping import RemapError, Remapping, RemapRule
from hdd_servo_ros.parameters.ros_yaml import Parameters, RosYamlError, Section, read_sections, read_value

_TOKEN = r'[A-Za-z_][A-Za-z0-9_]*'
_PARAMETER = re.compile(rf'(?:({_TOKEN}):)?({_TOKEN}(?:[./]{_TOKEN})*):=(.*)', re.DOTALL | re.ASCII)
QOS_OVERRIDES = 'qos_overrides.'
QOS_IS_FIXED = 'the quality of service of the topics is fixed, since a run must not lose messages'
_QOS = re.compile(rf'(?:{_TOKEN}:)?{re.escape(QOS_OVERRIDES)}', re.ASCII)
"""Only topics in parameter names contain slashes."""
_FOR_ALL = '/**'
_LOGS = tuple(
    f'--{switch}-{logs}'
    for switch in ('enable', 'disable')
    for logs in ('rosout-logs', 'stdout-logs', 'external-lib-logs')
)
_NO_LOG_CONFIGURATION = 'the ROS logger, spdlog, has no configuration file; use --log-level and --log-file-name'
_LEVEL = re.compile(r'(?:[^:]+:=)?(?:debug|info|warn|error|fatal|unset)', re.IGNORECASE)


class ArgumentError(ValueError):
    """Command line or parameter file that cannot be read; reports the error and its location."""

    exit_code = WRONG_ARGUMENTS


@dataclasses.dataclass
class RosArguments:
    """
    Parsed ROS command line.

    Attributes
    ----------
    overrides
        Parameters by node pattern as given. A repeated pattern keeps its position, as in ROS, for which ``node`` and
        ``/node`` are different patterns. If several patterns match a node, later ones win.
    named
        Nodes named with ``-p``; a file may have sections for other nodes.
    remaps
        Remap rules for nodes, namespaces and topics.
    others
        Arguments that are not ROS arguments.
    origins
        File and line of each override, by pattern and name; without those given by ``-p``.
    """

    overrides: dict[str, dict[str, object]] = dataclasses.field(default_factory=dict)
    named: list[str] = dataclasses.field(default_factory=list)
    remaps: Remapping = dataclasses.field(default_factory=Remapping)
    others: list[str] = dataclasses.field(default_factory=list)
    origins: dict[tuple[str, str], str] = dataclasses.field(default_factory=dict)

    def full_name(self, node: str) -> str:
        """Return the remapped name of a node with its namespace, given the default name of its executable."""
        return self.remaps.full_name(node)

    def parameters_of(self, node: str) -> dict[str, object]:
        """Return the parameters given for a node, by the default name of its executable."""
        full_name = self.full_name(node)
        values: dict[str, object] = {}
        for pattern, parameters in self.overrides.items():
            if _matches(pattern, full_name):
                values.update(parameters)
        return values

    def names(self, node: str) -> bool:
        """Return whether a node has its own section in a file or a ``-p``, not only a wildcard for all."""
        full_name = self.full_name(node)
        own = full_name.rpartition('/')[2]
        return any(pattern.rpartition('/')[2] == own and _matches(pattern, full_name) for pattern in self.overrides)

    def is_for_all(self, name: str) -> bool:
        """Return whether a parameter was given only for all nodes, not for a named node."""
        patterns = [pattern for pattern, parameters in self.overrides.items() if name in parameters]
        return bool(patterns) and all(pattern.endswith('*') for pattern in patterns)

    def origin(self, parameter: str) -> str:
        """
        Return the file and line of a parameter's value, an empty string if it is not from a file.

        Parameters
        ----------
        parameter
            Name of the parameter, with or without its node's name and a colon.
        """
        node, _, name = parameter.rpartition(':')
        patterns = [pattern for pattern, parameters in self.overrides.items() if name in parameters]
        # `simulate` also accepts parameters of `rig` in a section of its own name.
        own = [pattern for pattern in patterns if node and _matches(pattern, self.full_name(node))] or patterns
        return self.origins.get((own[-1], name), '') if own else ''

    @contextlib.contextmanager
    def naming_files(self) -> Iterator[None]:
        """Add file and line to an error about a parameter whose value is from a parameter file."""
        try:
            yield
        except ParameterError as error:
            origin = self.origin(error.name)
            if not origin or error.where:
                raise
            raise error.located(origin) from error.__cause__

    def check_nodes(self, nodes: Sequence[str]) -> None:
        """
        Reject a ``-p NODE:PARAMETER`` for an unknown node.

        Raises
        ------
        ArgumentError
            If a named node is not in ``nodes``.
        """
        names = list(dict.fromkeys(self.full_name(node) for node in nodes))
        for pattern in self.named:
            if not any(_matches(pattern, name) for name in names):
                hint = did_you_mean(f'/{pattern}', names)
                raise ArgumentError(f"parameters for '/{pattern}', but there are {', '.join(names)}{hint}")

    def check_names(self, program: str, nodes: Sequence[str]) -> None:
        """
        Reject names that would give several nodes of one process the same name.

        Raises
        ------
        ArgumentError
            If two of ``nodes`` have the same full name.
        """
        by_name: dict[str, str] = {}
        for node in nodes:
            name = self.full_name(node)
            if name in by_name:
                raise ArgumentError(f'{program} is several nodes: {by_name[name]} and {node} would both be {name}')
            by_name[name] = node

    def _add(self, section: Section, file: Path | None = None) -> None:
        pattern, parameters = section
        self.overrides.setdefault(pattern, {}).update(parameters)
        for name in parameters:
            self.origins.pop((pattern, name), None)
            if file is not None and isinstance(parameters, Parameters):
                self.origins[pattern, name] = f'{file}, line {parameters.lines[name]}'


def parse_ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """
    Parse a command line (without the program's name).

    Raises
    ------
    ArgumentError
        If an argument or a file is malformed.
    """
    parsed = RosArguments()
    rules: list[RemapRule] = []
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
            section = _parse_parameter(_value_of(argument, rest))
            parsed._add(section)
            if section[0] != _FOR_ALL:
                parsed.named.append(section[0])
        elif argument == '--params-file':
            file = Path(_value_of(argument, rest))
            for section in read_parameter_file(file):
                parsed._add(section, file)
        elif argument in ('-r', '--remap'):
            rules.append(_parse_remap(_value_of(argument, rest)))
        elif argument == '--log-level':
            _check_level(_value_of(argument, rest))
        elif argument == '--log-config-file':
            raise ArgumentError(f'{argument} {shown(_value_of(argument, rest))}: {_NO_LOG_CONFIGURATION}')
        elif argument in ('--log-file-name', '-e', '--enclave'):
            _value_of(argument, rest)
        elif argument not in _LOGS:
            raise ArgumentError(f'unknown ROS argument {shown(argument)}')
    parsed.remaps = Remapping(tuple(rules))
    return parsed


def _value_of(argument: str, rest: list[str]) -> str:
    if not rest:
        raise ArgumentError(f'{argument} needs a value')
    return rest.pop(0)


def _parse_parameter(text: str) -> Section:
    match = _PARAMETER.fullmatch(text)
    if not match and _QOS.match(text):
        raise ArgumentError(f'-p {shown(text)}: {QOS_IS_FIXED}')
    if not match:
        raise ArgumentError(
            f'-p {shown(text)} is not NODE:PARAMETER:=VALUE or PARAMETER:=VALUE, with names of letters, digits and _'
        )
    node, name, value = match.groups()
    try:
        return node or _FOR_ALL, {name: read_value(value)}
    except RosYamlError as error:
        raise ArgumentError(f'-p {shown(text)}: {error.reason}') from None


def parse_value(text: str) -> object:
    """
    Parse a parameter value as ROS does; lists become tuples.

    Raises
    ------
    ArgumentError
        If ROS would reject it.
    """
    try:
        return read_value(text)
    except RosYamlError as error:
        raise ArgumentError(error.reason) from None


def _parse_remap(text: str) -> RemapRule:
    try:
        return RemapRule.parse(text)
    except RemapError as error:
        raise ArgumentError(str(error)) from None


def _check_level(text: str) -> None:
    if not _LEVEL.fullmatch(text):
        raise ArgumentError(f'--log-level {shown(text)} is not [LOGGER:=]debug, info, warn, error or fatal')


def read_parameter_file(path: Path) -> list[Section]:
    """
    Return node patterns and their parameters from a ROS 2 parameter file, in the order of the file.

    Raises
    ------
    ArgumentError
        If the file cannot be read or is not a ROS 2 parameter file.
    """
    try:
        return list(read_sections(path.read_bytes()))
    except OSError as error:
        raise ArgumentError(f'parameter file {path}: {error.strerror or error}') from None
    except ValueError as error:
        # Also for a path with a NUL character.
        raise ArgumentError(f'parameter file {path}: {error}') from None


def read_parameter_files(paths: Iterable[str | Path]) -> dict[str, dict[str, object]]:
    """
    Return the parameters of each node by dotted name, for all namespaces; later files win.

    Raises
    ------
    ArgumentError
        If a file cannot be read or is not a ROS 2 parameter file.
    """
    nodes: dict[str, dict[str, object]] = {}
    for path in paths:
        for pattern, parameters in read_parameter_file(Path(path)):
            nodes.setdefault(pattern.rsplit('/', 1)[-1], {}).update(parameters)
    return nodes


@functools.lru_cache(4096)
def _matches(pattern: str, full_name: str) -> bool:
    # As in rcl, '/**/node' also matches '/node'.
    expression = re.escape('/' + pattern.removeprefix('/')).replace(r'/\*\*', r'(/[^/]+)*').replace(r'\*', '[^/]+')
    return re.fullmatch(expression, full_name) is not None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a hint with the most similar known name, empty if none is similar."""
    similar = difflib.get_close_matches(name, list(known), n=1)
    return f'; did you mean {similar[0]}?' if similar else ''


def with_node(error: ParameterError, node: str) -> ParameterError:
    """Return the error with the node's name before the parameter's, unchanged if it already has one."""
    if ':' in error.name:
        return error
    return error.renamed(f'{node}:{error.name}')
