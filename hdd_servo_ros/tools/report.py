"""
`report`: metrics, plots and HTML report of recorded runs, and the contribution of each error source.

No ROS import; without ``--by-source`` it reads only the bag and the ``run.yaml`` of each run.
"""

import argparse
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import EPILOG, UNREADABLE, command, reading
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.report import compare_runs, comparison_table, reject_different_units, report_run
from hdd_servo_ros.reporting.run_names import run_name, run_names
from hdd_servo_ros.reporting.source_panels import ErrorBySource


def _check(run: RecordedRun) -> None:
    """Read all loop topics of a bag without checksums, including those that no metric needs."""
    if run.is_checked:
        return
    if run.is_long:
        run.verify()
        return
    for topic in run.counts:
        if topic in run:
            run[topic]


def _by_source(run: RecordedRun, after: float | None, *, trusted: bool) -> ErrorBySource:
    # Imported here, because it imports the compiled loop.
    from hdd_servo_ros.tools.error_by_source import error_by_source_of_run

    return error_by_source_of_run(run, after, trusted=trusted)


def _directories(runs: Sequence[RecordedRun], output: Path | None) -> list[Path]:
    """Return the directory of each report: in ``output`` by run name, with a number appended if names repeat."""
    if output is None or len(runs) == 1:
        return [output or run.path for run in runs]
    directories: list[Path] = []
    for run in runs:
        name = run_name(run)
        numbered = (output / (f'{name}-{number}' if number > 1 else name) for number in itertools.count(1))
        directories.append(next(directory for directory in numbered if directory not in directories))
    return directories


def _print_table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> None:
    widths = [max(len(line[column]) for line in [head, *lines]) for column in range(len(head))]
    for line in [head, *lines]:
        print('  '.join(f'{text:>{width}}' for text, width in zip(line, widths, strict=True)))


def _seconds(text: str) -> float:
    """Parse a nonnegative time [s]; raise ArgumentTypeError otherwise."""
    number = float(text)
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a time; expected a finite number >= 0 [s]')
    return number


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='report',
        description='Write metrics, a plot (report.png) and an HTML report (report.html) of each run from its bag; for '
        'several runs also a table and an overlay plot (comparison.png, comparison.html).',
        epilog=EPILOG,
    )
    parser.add_argument('run', type=Path, nargs='+', help='run directory, or a bag with the same topics')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help='output directory; several runs are written to subdirectories with their names (default: the directory of '
        'each run, and the parent directory of the first run for the comparison)',
    )
    parser.add_argument(
        '--after',
        type=_seconds,
        metavar='SECONDS',
        help='time before which errors are ignored (default: half of the run, but at most 2 s)',
    )
    parser.add_argument(
        '--by-source',
        action='store_true',
        help='repeat each run once without each of its error sources, and report the contribution of each source',
    )
    parser.add_argument(
        '--trust',
        action='store_true',
        help='with --by-source: run code named in the run directory, such as the class of a custom controller',
    )
    return parser


@command('report', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Report runs; exit code 0, or 3 if a run cannot be read or, with ``--by-source``, repeated."""
    options = command_line().parse_args(arguments)
    runs = []
    for path in options.run:
        with reading(path):
            runs.append(RecordedRun.open(path))
            _check(runs[-1])
    reject_different_units(runs)
    written, remarks = [], []
    by_source: list[ErrorBySource | None] = []
    jobs = tqdm(runs, desc='report', unit='run', disable=not sys.stderr.isatty() or len(runs) < 2)
    for directory, name, run in zip(_directories(runs, options.output), run_names(runs), jobs, strict=True):
        with reading(run.path):
            by_source.append(_by_source(run, options.after, trusted=options.trust) if options.by_source else None)
            files, lines = report_run(run, directory, options.after, by_source[-1])
        written += files
        remarks += [f'{name}: {line}' for line in lines]
    if len(runs) > 1:
        directory = options.run[0].resolve().parent if options.output is None else options.output
        written += compare_runs(runs, directory, options.after)
    table = comparison_table(runs, options.after, by_source)
    _print_table(*table)
    for line in remarks:
        print(line)
    for path in written:
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
