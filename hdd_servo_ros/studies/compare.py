"""
`compare`: several controllers on the same experiments; one table and one figure, made from the bags.

    ros2 run hdd_servo_ros compare [--controllers adaptive_nn pid pid@FILE my_module:MyController]
        [--experiments sine_100_hz ... | --params-file FILE ...] [-p NODE:PARAMETER:=VALUE] [--without-ros]
"""

import argparse
import csv
import dataclasses
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from hdd_servo_ros.analysis.metrics import is_stepwise
from hdd_servo_ros.campaign.case import Case, parameter_file
from hdd_servo_ros.campaign.command import exit_code
from hdd_servo_ros.campaign.runner import run_cases
from hdd_servo_ros.graph.catalog import CONTROLLERS, names_with_parameters
from hdd_servo_ros.graph.controller_loader import load_controller
from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.comparison_panels import compared, error_panel, position_panel
from hdd_servo_ros.reporting.panel import COLORS
from hdd_servo_ros.reporting.plot import draw_panel
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.studies.output import new_figure, save, write_table

DEFAULT_FILE = 'seagate_7200_10.yaml'
DEFAULT_CONTROLLERS = ('adaptive_nn', 'pid')
DEFAULT_OVERLAYS = ('pid@pid_for_sines.yaml',)
"""Additional controllers, used by default with the default drive, for which they are tuned."""
_TRACKING = ('rms_error', 'max_error')
_STEPS = ('worst_overshoot', 'worst_settling_time', 'worst_steady_error')
METRICS = (*_TRACKING, *_STEPS, 'peak_control')
"""Columns of the table: errors after the transient; step metrics of the worst edge in the run."""
_INSTEAD = {'controller': '--controllers', 'run_dir': '--output'}
"""Parameters that `compare` sets for every run, and the options that set them."""


def _experiment(duration: float, **reference: object) -> dict[str, object]:
    own = {f'reference_generator:{name}': value for name, value in reference.items()}
    return {'deterministic_timer:duration': duration, **own}


def _sine(frequency: float) -> dict[str, object]:
    return _experiment(4.0, waveform='sine', amplitude=2.0, frequency=frequency)


def _square(height: float) -> dict[str, object]:
    # The run continues after the last edge, at 1 s, for most of a half period.
    return _experiment(1.04, waveform='square', amplitude=0.5 * height, offset=0.5 * height, frequency=10.0)


EXPERIMENTS: dict[str, dict[str, object]] = {
    'sine_100_hz': _sine(100.0),
    'sine_200_hz': _sine(200.0),
    'step_0.5_um': _square(0.5),
    'step_5_um': _square(5.0),
}
"""Overrides of the parameter file: a 2 µm sine, or a 10 Hz square wave between 0 and the step height."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """
    Controller with its own parameter files.

    Attributes
    ----------
    controller
        Value of the parameter ``controller`` of `rig`.
    node
        Name of the controller node.
    overlays
        Parameter files for the runs of this controller only, applied on top of the common files.
    """

    controller: str
    node: str
    overlays: tuple[str | Path, ...] = ()

    @property
    def label(self) -> str:
        """Name in tables and figures."""
        if self.overlays:
            return Path(self.overlays[-1]).stem
        return self.controller if self.controller in CONTROLLERS else self.node

    @classmethod
    def named(cls, text: str) -> 'Candidate':
        """
        Return the controller for an argument ``CONTROLLER`` or ``CONTROLLER@FILE``.

        FILE is a path, or else the name of a parameter file of this package.
        """
        controller, at, file = text.partition('@')
        if at and not file:
            raise ArgumentError(f'--controllers {text}: expected the name of a parameter file after the @')
        node = CONTROLLERS[controller] if controller in CONTROLLERS else load_controller(controller).node
        if not at:
            return cls(controller, node)
        path = Path(file)
        # `parameter_file` reports the available names if the file does not exist.
        return cls(controller, node, (path if path.is_file() else str(parameter_file(file)),))


@dataclasses.dataclass(frozen=True)
class Comparison:
    """
    Controllers and experiments to compare.

    Attributes
    ----------
    controllers
        Controllers with distinct labels.
    experiments
        Overrides of each experiment, by name.
    files
        Parameter files.
    overrides
        Values set by the user, under ``'node:parameter'`` or ``'parameter'``, with the highest precedence. Parameters
        of a controller apply only to the runs of that controller.
    """

    controllers: Sequence[Candidate]
    experiments: Mapping[str, Mapping[str, object]]
    files: tuple[str | Path, ...]
    overrides: Mapping[str, object] = dataclasses.field(default_factory=dict)

    def cases(self) -> dict[tuple[str, str], Case]:
        """Return the cases by experiment and controller label, in the order of the table."""
        return {
            (experiment, one.label): Case(
                f'{experiment}-{one.label}',
                one.controller,
                (*self.files, *one.overlays),
                {**own, **self._given(one.node)},
            )
            for experiment, own in self.experiments.items()
            for one in self.controllers
        }

    def _given(self, node: str) -> dict[str, object]:
        others = {one.node for one in self.controllers} - {node}
        # A run contains no controller node but its own.
        participating = (set(names_with_parameters()) - set(CONTROLLERS.values()) - others) | {node}
        foreign = _known(others) - _known(participating)
        return {
            name: value
            for name, value in self.overrides.items()
            if name not in foreign and name.partition(':')[0] not in others
        }


@dataclasses.dataclass(frozen=True)
class Row:
    """
    Row of the table.

    Attributes
    ----------
    experiment, controller
        Names of the experiment and the controller.
    values
        Values of ``METRICS`` by name, without those that do not apply to the experiment.
    headers
        Label and unit of each metric.
    note
        Reason of a failed run; empty otherwise.
    verdict
        Verdict on the run; empty if it has no reference to track.
    """

    experiment: str
    controller: str
    values: Mapping[str, float]
    headers: Mapping[str, str]
    note: str = ''
    verdict: str = ''


def _known(nodes: Iterable[str]) -> set[str]:
    """Return the names of all parameters of the nodes."""
    registered = set(names_with_parameters()).intersection(nodes)
    return {declaration.name for node in registered for declaration in node_declarations(node)}


def read_row(experiment: str, controller: str, run: RecordedRun) -> Row:
    """Return the row of a recorded run."""
    if run.status != FINISHED:
        return Row(experiment, controller, {}, {}, f'{run.status}: {run.reason}', _verdict(run))
    inapplicable = _TRACKING if is_stepwise(run.desired_position) else _STEPS
    metrics = [metric for metric in run_metrics(run) if metric.name in METRICS and metric.name not in inapplicable]
    return Row(
        experiment,
        controller,
        {metric.name: metric.value for metric in metrics},
        {metric.name: f'{metric.label} [{shown(metric.unit)}]' for metric in metrics},
        verdict=_verdict(run),
    )


def _verdict(run: RecordedRun) -> str:
    """Return the verdict of a run for the table; empty without a verdict."""
    judged = verdict_of(run)
    return '' if judged is None else judged.in_table


def write_rows(rows: Sequence[Row], path: Path) -> tuple[Path, Path]:
    """Write the table as CSV with all digits and as Markdown with three digits; return both files."""
    headers = {name: label for row in rows for name, label in row.headers.items()}
    columns = [name for name in METRICS if name in headers]
    notes = ['note'] if any(row.note for row in rows) else []
    header = ['experiment', 'controller', 'verdict', *(headers[name] for name in columns), *notes]
    with path.with_suffix('.csv').open('w', newline='', encoding='utf8') as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        for row in rows:
            cells = [row.values.get(name, '') for name in columns]
            writer.writerow([row.experiment, row.controller, row.verdict, *cells, *[row.note for _ in notes]])
    table = [
        [
            row.experiment,
            row.controller,
            row.verdict,
            *(_shown(row.values.get(name, math.nan)) for name in columns),
            *[row.note for _ in notes],
        ]
        for row in rows
    ]
    return path.with_suffix('.csv'), write_table(
        path, 'Errors after the transient; step metrics of the worst edge.', header, table
    )


def _shown(value: float) -> str:
    if math.isnan(value):
        return '-'
    return f'{value:.3g}' if math.isfinite(value) else 'never'


def draw_runs(runs: Mapping[tuple[str, str], RecordedRun], path: Path) -> Path:
    """Draw the runs of all controllers in one column of panels per experiment; return the file."""
    experiments = list(dict.fromkeys(experiment for experiment, _ in runs))
    figure = new_figure(
        'Comparison of controllers on the same experiments', width=1.0 + 4.6 * len(experiments), height=9.0
    )
    axes = figure.subplots(3, len(experiments), squeeze=False)
    controllers = list(dict.fromkeys(controller for _, controller in runs))
    for column, experiment in zip(axes.T, experiments, strict=True):
        # Index the colors by all controllers, so that each controller has one color in every column.
        items = [
            dataclasses.replace(item, color=COLORS[controllers.index(item.name) % len(COLORS)])
            for item in compared({controller: run for (of, controller), run in runs.items() if of == experiment})
        ]
        # A failed run ends early: take the longest run.
        close_up = close_up_of(max((item.run for item in items), key=lambda run: run.duration))
        positions, errors = position_panel(items, close_up), error_panel(items, close_up)
        large = close_up is not None
        draw_panel(column[0], dataclasses.replace(positions, title=experiment), close_up=large, is_alone=True)
        draw_panel(column[1], errors, close_up=large, is_alone=True)
        draw_panel(column[2], errors, is_alone=True)
    return save(figure, path)


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='compare',
        description='Run several controllers on the same experiments, and compare them in one table and one figure.',
        epilog='A finished run with the same parameters and the same controller is reused.',
    )
    parser.add_argument(
        '--controllers',
        nargs='+',
        metavar='CONTROLLER',
        help=f'{", ".join(CONTROLLERS)}, the entry point of an installed package, or module:Class; append @FILE to '
        "apply a parameter file to this controller's runs only; default: "
        f'{" ".join(DEFAULT_CONTROLLERS)}, and {" ".join(DEFAULT_OVERLAYS)} on the default drive',
    )
    parser.add_argument(
        '--experiments', nargs='+', choices=EXPERIMENTS, metavar='EXPERIMENT', help=', '.join(EXPERIMENTS)
    )
    parser.add_argument(
        '--params-file',
        nargs='+',
        type=Path,
        action='extend',
        metavar='FILE',
        help=f'parameter files that replace {DEFAULT_FILE}; without --experiments they define the experiment',
    )
    parser.add_argument(
        '-p',
        action='append',
        default=[],
        dest='parameters',
        metavar='NODE:PARAMETER:=VALUE',
        help='parameter override, as for rig',
    )
    parser.add_argument(
        '--without-ros',
        action='store_true',
        help='use simulate instead of the node graph: faster, with bit-identical results',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIRECTORY',
        help='output directory; default: runs/compare, or runs/compare-without-ros',
    )
    return parser


def _comparison(options: argparse.Namespace) -> Comparison:
    controllers = options.controllers or [*DEFAULT_CONTROLLERS, *(() if options.params_file else DEFAULT_OVERLAYS)]
    for option, names in (('--controllers', controllers), ('--experiments', options.experiments or ())):
        for name in names:
            if names.count(name) > 1:
                raise ArgumentError(f'{option} names {name} more than once')
    candidates: dict[str, Candidate] = {}
    names_by_label: dict[str, str] = {}
    for name in controllers:
        one = Candidate.named(name)
        if one.label in candidates:
            other = names_by_label[one.label]
            raise ArgumentError(
                f'--controllers: {other} and {name} have the same label {one.label}, and their runs the same names'
            )
        candidates[one.label], names_by_label[one.label] = one, name
    experiments: Mapping[str, Mapping[str, object]] = EXPERIMENTS
    if options.experiments:
        experiments = {name: EXPERIMENTS[name] for name in options.experiments}
    elif options.params_file:
        experiments = {options.params_file[-1].stem: {}}
    arguments = [word for text in options.parameters for word in ('-p', text)]
    overrides = {
        f'{pattern.strip("/")}:{name}'.removeprefix('**:'): value
        for pattern, parameters in parse_ros_arguments(['--ros-args', *arguments]).overrides.items()
        for name, value in parameters.items()
    }
    for name in overrides:
        instead = _INSTEAD.get(name.rpartition(':')[2])
        if instead:
            raise ArgumentError(f'-p {name} is rejected: compare sets it for each run; use {instead}')
    return Comparison(tuple(candidates.values()), experiments, tuple(options.params_file or [DEFAULT_FILE]), overrides)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare controllers; exit code 0 done, 1 a run failed, 2 invalid arguments or parameters, 130 interrupted."""
    options = command_line().parse_args(arguments)
    directory = options.output or Path('runs') / ('compare-without-ros' if options.without_ros else 'compare')

    def work() -> int:
        cases = _comparison(options).cases()
        run_cases(cases.values(), directory, without_ros=options.without_ros, keep_failed=True)
        runs = {key: RecordedRun.open(directory / case.name) for key, case in cases.items()}
        rows = [read_row(*key, run) for key, run in runs.items()]
        written, table = write_rows(rows, directory / 'compare')
        print(table.read_text('utf8'))
        print(f'{table}\n{written}')
        # A run that failed at tick 0 has nothing to draw.
        started = {key: run for key, run in runs.items() if run.description['last_tick'] >= 0}
        if started:
            print(draw_runs(started, directory / 'compare'))
        return 1 if any(row.note for row in rows) else 0

    return exit_code('compare', work)


if __name__ == '__main__':
    sys.exit(main())
