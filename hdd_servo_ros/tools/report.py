"""
`report`: metrics, a picture and a page of recorded runs, and what each source of error contributes to them.

No ROS import; without ``--by-source`` nothing but the runs' bags and their ``run.yaml`` is read.
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
    """Read all topics of the loop of a bag whose files have no checksums, also those that no metric needs."""
    if run.is_checked:
        return
    if run.is_long:
        run.verify()
        return
    for topic in run.counts:
        if topic in run:
            run[topic]


def _by_source(run: RecordedRun, after: float | None, *, trusted: bool) -> ErrorBySource:
    # Late: it needs the compiled loop.
    from hdd_servo_ros.tools.error_by_source import error_by_source_of_run

    return error_by_source_of_run(run, after, trusted=trusted)


def _directories(runs: Sequence[RecordedRun], output: Path | None) -> list[Path]:
    """Return where each run's own report goes: below ``output``, a name that several have with a number behind it."""
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
    """Return a time [s]; argparse tells what is none."""
    number = float(text)
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is no time: it must be finite and not negative [s]')
    return number


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='report',
        description='Metrics, a picture (report.png) and a page (report.html) of each run, from its bag alone; '
        'of several runs also one table and overlay (comparison.png, comparison.html).',
        epilog=EPILOG,
    )
    parser.add_argument('run', type=Path, nargs='+', help='run folder, or a bag of the same topics')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help="where to write; of several runs each in a folder of its name below (default: each run's own folder, "
        'the comparison beside the first run)',
    )
    parser.add_argument(
        '--after',
        type=_seconds,
        metavar='SECONDS',
        help='time before which errors do not count (default: half of the run, 2 s at most)',
    )
    parser.add_argument(
        '--by-source',
        action='store_true',
        help='repeat each run in this process without each of its sources of error, and report what each contributes',
    )
    parser.add_argument(
        '--trust',
        action='store_true',
        help="with --by-source: run code that a run's folder names, a custom controller's class",
    )
    return parser


@command('report', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Report runs; exit code 0, or 3 if one cannot be read or, with ``--by-source``, run again."""
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
        beside = options.run[0].resolve().parent if options.output is None else options.output
        written += compare_runs(runs, beside, options.after)
    table = comparison_table(runs, options.after, by_source)
    _print_table(*table)
    for line in remarks:
        print(line)
    for path in written:
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
