"""The specification of a campaign: its runs, varied parameters, metrics and recordings."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.campaign.case import parameter_file
from hdd_servo_ros.campaign.elements import check_notation, check_once
from hdd_servo_ros.campaign.points import MOST, Block, Column, Point, Points
from hdd_servo_ros.campaign.sampling import (
    DISTRIBUTIONS,
    PLANS,
    RANGES,
    Distribution,
    only_keys,
    shares,
    values_of_range,
)
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.parameters.ros_yaml import LARGEST_INTEGER, RosYamlError, read_entries, scalar

ALL = 'all'
KEEP = ('none', 'failed', 'worst', 'all')
_KEYS = ('name', 'files', 'set', 'controllers', 'vary', 'seeds', 'metrics', 'after', 'keep')
_CONTROLLER_KEYS = ('name', 'controller', 'files', 'set')
_PLAN_KEYS = ('runs', 'plan', 'seed', 'draw')
_WORST_KEYS = ('worst', 'of')

_KINDS: tuple[tuple[type | tuple[type, ...], str], ...] = (
    (bool, 'true or false'),
    ((int, float), 'a number'),
    (str, 'a string'),
    (tuple, 'a list'),
)


@dataclasses.dataclass(frozen=True)
class CampaignController:
    """
    A controller of a campaign.

    Attributes
    ----------
    name
        Name in the table.
    controller
        Value of the parameter ``controller`` of `rig`.
    files
        Parameter files in addition to those of the campaign, which they override.
    values
        Parameters by ``'node:parameter'``; they override those of the campaign.
    """

    name: str
    controller: str
    files: tuple[Path, ...] = ()
    values: Mapping[str, object] = dataclasses.field(default_factory=dict)

    @property
    def file_name(self) -> str:
        """The name for use in a file name: characters other than letters, digits and ``-_.`` are replaced."""
        return file_name(self.name)


@dataclasses.dataclass(frozen=True)
class Spec:
    """
    A campaign.

    Attributes
    ----------
    name
        Name of the campaign and of its directory.
    files
        Base parameter files; later ones win.
    values
        Base parameters by ``'node:parameter'``; they override the files.
    controllers
        Controllers; each runs every point.
    points
        Varied values of each run; one empty point if nothing varies.
    seeds
        Seeds of sensors and disturbances; every run is made with each seed. None keeps the seeds of the files.
    metrics
        Names of metrics, ``module:function`` for user-defined ones, or ``all`` for all metrics of a report.
    after
        Start of the window of the metrics [s]; None for that of a report.
    keep
        Runs to record: ``none``, ``failed``, ``worst`` or ``all``.
    worst, worst_of
        For ``worst``: their number and the metric that ranks them (failed runs, then the largest absolute values).
    """

    name: str
    files: tuple[Path, ...] = ()
    values: Mapping[str, object] = dataclasses.field(default_factory=dict)
    controllers: tuple[CampaignController, ...] = ()
    points: Sequence[Point] = ({},)
    seeds: tuple[int | None, ...] = (None,)
    metrics: tuple[str, ...] = (ALL,)
    after: float | None = None
    keep: str = 'none'
    worst: int = 0
    worst_of: str = ''

    @property
    def extent(self) -> str:
        """The factors of the number of runs, as text."""
        return f'{len(self.points)} points x {len(self.controllers)} controllers x {len(self.seeds)} seeds'

    @property
    def count(self) -> int:
        """Number of runs."""
        return len(self.points) * len(self.controllers) * len(self.seeds)


def file_name(controller: str) -> str:
    """Return the name of a controller for use in a file name."""
    return ''.join(c if c.isalnum() or c in '-_.' else '_' for c in controller)


def read_spec(path: Path) -> Spec:
    """
    Read a specification; the files that it names are in ``params/``, or relative to its directory.

    Raises
    ------
    ArgumentError
        If it cannot be read, or an entry is invalid; the message has the file and the entry.
    """
    try:
        content = read_entries(path.read_bytes())
    except OSError as error:
        raise ArgumentError(f'specification {path}: {error.strerror or error}') from None
    except RosYamlError as error:
        raise ArgumentError(f'specification {path} is invalid: {error}') from None
    try:
        return spec_of(content, path.resolve().parent, path.stem)
    except ArgumentError as error:
        raise ArgumentError(f'specification {path}: {error}') from None


def spec_of(content: Mapping[str, Any], directory: Path, name: str = 'campaign') -> Spec:
    """
    Return the campaign that the entries of a specification describe.

    Parameters
    ----------
    content
        The entries, see ``docs/howto/run-campaigns.md``.
    directory
        Base of relative paths.
    name
        Default name of the campaign.

    Raises
    ------
    ArgumentError
        If an entry is invalid.
    """
    only_keys(content, _KEYS, 'top level')
    keep, worst, worst_of = _keep(content.get('keep', 'none'))
    metrics = _metrics(content.get('metrics', ALL))
    if worst_of and worst_of not in metrics and (ALL not in metrics or ':' in worst_of):
        raise ArgumentError(f'keep: of: {worst_of!r} is not among the metrics of the campaign: {", ".join(metrics)}')
    after = content.get('after')
    spec = Spec(
        name=_file_name(content.get('name', name)),
        files=_files(content.get('files', []), directory, 'files'),
        values=_values(content.get('set', {}), 'set'),
        controllers=_controllers(content.get('controllers', ['adaptive_nn']), directory),
        points=_points(content.get('vary', [])),
        seeds=_seeds(content.get('seeds')),
        metrics=metrics,
        after=None if after is None else _number(after, 'after', least=0.0),
        keep=keep,
        worst=worst,
        worst_of=worst_of,
    )
    if spec.count > MOST:
        raise ArgumentError(f'{spec.extent} are {spec.count} runs; a campaign has at most {MOST}')
    return spec


def named_values(sections: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    """Return the parameters of nodes by ``'node:parameter'``."""
    return {f'{node}:{name}': value for node, parameters in sections.items() for name, value in parameters.items()}


def _file_name(name: object) -> str:
    if not isinstance(name, str) or not name or name.startswith('.') or '/' in name or '\0' in name:
        raise ArgumentError(f'name: {name!r} is not a valid directory name')
    return name


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise ArgumentError(f'{where}: {value!r} is not a list of at least one element')
    return value


def _mapping(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ArgumentError(f'{where}: {value!r} is not a mapping')
    return value


def _number(value: object, where: str, least: float | None = None) -> float:
    plain = scalar(value) if isinstance(value, str) else value
    if isinstance(plain, bool) or not isinstance(plain, int | float):
        raise ArgumentError(f'{where}: {shown(value)} is not a number')
    if not math.isfinite(plain):
        raise ArgumentError(f'{where}: {value!r} is not a finite number')
    if least is not None and not plain >= least:
        raise ArgumentError(f'{where}: {value!r} is not at least {least:g}')
    return float(plain)


def _integer(value: object, where: str, least: int, most: int = LARGEST_INTEGER) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ArgumentError(f'{where}: {shown(value)} is not an integer at least {least}')
    if value > most:
        raise ArgumentError(f'{where}: {shown(value)} is not an integer at most {most}')
    return value


def _files(value: object, directory: Path, where: str) -> tuple[Path, ...]:
    found = []
    for file in [] if value == [] else _list(value, where):
        if not isinstance(file, str):
            raise ArgumentError(f'{where}: {file!r} is not the name of a parameter file')
        path = directory / file
        found.append(path if path.is_file() else parameter_file(file))
    return tuple(found)


def _key(key: str, where: str) -> str:
    node, _, parameter = key.partition(':')
    if not node or not parameter:
        raise ArgumentError(f'{where}: {key!r} is not NODE:PARAMETER')
    check_notation(key, where)
    return key


def _value(value: object, where: str) -> object:
    """Return a value as a run uses it."""
    if isinstance(value, list):
        return tuple(_value(element, where) for element in value)
    if isinstance(value, int) and not -LARGEST_INTEGER - 1 <= value <= LARGEST_INTEGER:
        raise ArgumentError(f'{where}: {shown(value)} is invalid; expected an integer of 64 bits')
    if isinstance(value, bool | int | float | str):
        return value
    raise ArgumentError(f'{where}: {value!r} is not the value of a parameter')


def _values(value: object, where: str) -> dict[str, object]:
    return {_key(key, where): _value(found, f'{where}: {key}') for key, found in _mapping(value, where).items()}


def _controllers(value: object, directory: Path) -> tuple[CampaignController, ...]:
    found = []
    for entry in _list(value, 'controllers'):
        if isinstance(entry, str):
            found.append(CampaignController(entry, entry))
            continue
        fields = _mapping(entry, 'controllers')
        only_keys(fields, _CONTROLLER_KEYS, 'controllers')
        controller = fields.get('controller')
        if not isinstance(controller, str):
            raise ArgumentError(f'controllers: {dict(fields)!r} lacks the entry controller')
        name = fields.get('name', controller)
        if not isinstance(name, str) or not name:
            raise ArgumentError(f'controllers: name: {name!r} is not a string')
        files = _files(fields.get('files', []), directory, f'controllers: {name}: files')
        values = _values(fields.get('set', {}), f'controllers: {name}: set')
        found.append(CampaignController(name, controller, files, values))
    names = [controller.file_name for controller in found]
    for name in names:
        if names.count(name) > 1:
            raise ArgumentError(f'controllers: duplicate name {name!r}; give each controller its own name')
    return tuple(found)


def _seeds(value: object) -> tuple[int | None, ...]:
    if value is None:
        return (None,)
    if isinstance(value, list):
        found = [_integer(seed, 'seeds', 0) for seed in _list(value, 'seeds')]
        if len(set(found)) < len(found):
            raise ArgumentError(f'seeds: {value!r} has a duplicate seed')
        return tuple(found)
    return tuple(range(1, _integer(value, 'seeds', 1, MOST) + 1))


def _metrics(value: object) -> tuple[str, ...]:
    found = [value] if isinstance(value, str) else _list(value, 'metrics')
    for name in found:
        if not isinstance(name, str):
            raise ArgumentError(f'metrics: {name!r} is not the name of a metric')
    return tuple(dict.fromkeys(found))


def _keep(value: object) -> tuple[str, int, str]:
    if isinstance(value, str) and value in KEEP and value != 'worst':
        return value, 0, ''
    if isinstance(value, Mapping) and 'worst' in value:
        only_keys(value, _WORST_KEYS, 'keep')
        of = value.get('of', '')
        if not isinstance(of, str):
            raise ArgumentError(f'keep: of: {of!r} is not the name of a metric')
        return 'worst', _integer(value['worst'], 'keep: worst', 1), of
    raise ArgumentError(f'keep: {value!r} is invalid; expected none, failed, all or {{worst: COUNT, of: METRIC}}')


def _points(value: object) -> Points:
    """Return the points: the product of the blocks of ``vary``, with the parameters of each block zipped."""
    if isinstance(value, Mapping):
        value = [value]
    if not isinstance(value, list):
        raise ArgumentError(f'vary: {value!r} is not a list of blocks')
    blocks = [_block(_mapping(block, 'vary')) for block in value]
    keys = [key for block in blocks for key in block.columns]
    duplicate = next((key for key in keys if keys.count(key) > 1), None)
    if duplicate is not None:
        raise ArgumentError(f'vary: {duplicate} is in two blocks')
    check_once(keys, 'vary')
    return Points(blocks)


def _block(block: Mapping[str, Any]) -> Block:
    if not block:
        raise ArgumentError('vary: empty block; to run each controller once, omit `vary`')
    if 'draw' in block:
        return _drawn(block)
    columns = {_key(key, 'vary'): _column(found, f'vary: {key}') for key, found in block.items()}
    lengths = {key: len(column.values) for key, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ', '.join(f'{key} has {length}' for key, length in lengths.items())
        raise ArgumentError(f'vary: the parameters of a block need the same number of values, but {listed}')
    return Block(columns)


def _column(value: object, where: str) -> Column:
    """Return the values of one parameter: a list, or a range."""
    if isinstance(value, list):
        return Column(_of_one_kind([_value(found, where) for found in _list(value, where)], where))
    fields = _mapping(value, where)
    only_keys(fields, (*RANGES, 'values', 'times_base'), where)
    times_base = _flag(fields, where)
    kinds = [kind for kind in (*RANGES, 'values') if kind in fields]
    if len(kinds) != 1:
        raise ArgumentError(f'{where}: {dict(fields)!r} is invalid; expected one of {", ".join((*RANGES, "values"))}')
    numbers = _list(fields[kinds[0]], where)
    if kinds == ['values']:
        found = [_number(value, where) if times_base else _value(value, where) for value in numbers]
        return Column(_of_one_kind(found, where), times_base)
    plain: list[Any] = [scalar(number) if isinstance(number, str) else number for number in numbers]
    for number in plain:
        _number(number, where)
    if len(plain) == 3 and plain[2] > MOST:
        raise ArgumentError(f'{where}: {kinds[0]}: {plain[2]} values are too many: a campaign has at most {MOST} runs')
    return Column(values_of_range(kinds[0], plain, where), times_base)


def _of_one_kind(values: list[object], where: str) -> list[object]:
    """Reject values of different types: a parameter and a column of the table have one type."""
    kinds = list(dict.fromkeys(next(name for types, name in _KINDS if isinstance(value, types)) for value in values))
    if len(kinds) > 1:
        raise ArgumentError(f'{where}: {shown(values)} has {kinds[0]} and {kinds[1]}; expected values of one type')
    return values


def _flag(fields: Mapping[str, Any], where: str) -> bool:
    flag = fields.get('times_base', False)
    if not isinstance(flag, bool):
        raise ArgumentError(f'{where}: times_base: {flag!r} is not true or false')
    return flag


def _drawn(block: Mapping[str, Any]) -> Block:
    only_keys(block, _PLAN_KEYS, 'vary')
    runs = _integer(block.get('runs'), 'vary: runs', 1, MOST)
    plan = block.get('plan', 'random')
    if plan not in PLANS:
        raise ArgumentError(f'vary: unknown plan {plan!r}; expected one of {", ".join(PLANS)}')
    drawn = _mapping(block['draw'], 'vary: draw')
    if not drawn:
        raise ArgumentError('vary: draw: empty; expected a parameter with a distribution')
    points = shares(plan, _integer(block.get('seed', 1), 'vary: seed', 0), runs, len(drawn))
    columns: dict[str, Column] = {}
    for (key, entry), column in zip(drawn.items(), points.T, strict=True):
        where = f'vary: draw: {key}'
        fields = _mapping(entry, where)
        only_keys(fields, (*DISTRIBUTIONS, 'times_base'), where)
        kinds = [kind for kind in DISTRIBUTIONS if kind in fields]
        numbers = fields[kinds[0]] if len(kinds) == 1 else None
        if not isinstance(numbers, list) or len(numbers) != 2:
            raise ArgumentError(
                f'{where}: {dict(fields)!r} is invalid; expected {", ".join(DISTRIBUTIONS)}: [NUMBER, NUMBER]'
            )
        first, second = (_number(number, where) for number in numbers)
        try:
            distribution = Distribution(kinds[0], first, second)
        except ArgumentError as error:
            raise ArgumentError(f'{where}: {error}') from None
        columns[_key(key, 'vary: draw')] = Column(distribution.at(column), _flag(fields, where))
    return Block(columns)
