"""`campaign`: many runs from one specification, on all cores or a Dask cluster, and their table. No ROS import."""

import argparse
import functools
import sys
from collections.abc import Sequence
from pathlib import Path

from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.check import same_runs
from hdd_servo_ros.campaign.command import exit_code
from hdd_servo_ros.campaign.dask_cluster import dask_executor
from hdd_servo_ros.graph.help import COMPILING
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import EPILOG
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.numerics.kernel_folder import first_compilation


def _workers(text: str) -> int:
    """Parse a positive number of workers; raise ArgumentTypeError otherwise."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f'{text} is not a valid number of workers; expected an integer at least 1')
    return number


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='campaign',
        description='Make all runs of a specification, without middleware and without bags, and write their table.',
        epilog=f'A failed run is a row of the table with its reason. {EPILOG}',
    )
    parser.add_argument(
        'spec',
        type=Path,
        nargs='?',
        metavar='SPEC.yaml',
        help='specification of the runs, see docs/howto/run-campaigns.md',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help='directory for the results (default: runs/NAME)',
    )
    parser.add_argument('--workers', type=_workers, metavar='N', help='runs at a time (default: one per core)')
    cluster = parser.add_mutually_exclusive_group()
    cluster.add_argument('--dask', action='store_true', help='use a local Dask cluster of N processes')
    cluster.add_argument('--scheduler', metavar='ADDRESS', help='use an existing Dask cluster, such as tcp://host:8786')
    parser.add_argument(
        '--check',
        type=Path,
        nargs=2,
        metavar=('DIR', 'RUN_DIR'),
        help='make no run: print which runs of the campaign in DIR are bit-identical to a recorded run; '
        'exit code 1 without a match',
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign; exit code 0 when its table is written, even if runs failed."""
    parser = command_line()
    options = parser.parse_args(arguments)
    if (options.spec is None) == (options.check is None):
        parser.error('give either SPEC.yaml, or --check DIR RUN_DIR')
    work = functools.partial(_work, options) if options.check is None else functools.partial(_check, *options.check)
    return exit_code('campaign', work)


def _check(folder: Path, run_dir: Path) -> int:
    numbers = same_runs(folder, run_dir)
    if not numbers:
        print(f'{run_dir} matches no run of {folder}')
        return 1
    named = f'run{"s" if len(numbers) > 1 else ""} {", ".join(map(str, numbers))}'
    print(f'{run_dir} is bit-identical to {named} of {folder}')
    return 0


def _work(options: argparse.Namespace) -> int:
    campaign = Campaign(options.spec)
    directory = options.output or Path('runs') / campaign.spec.name
    print(campaign, flush=True)
    if first_compilation():
        print(f'campaign: {COMPILING}', file=sys.stderr, flush=True)
    progress = sys.stderr.isatty()
    if options.dask or options.scheduler:
        with dask_executor(options.scheduler, options.workers) as (executor, workers):
            table = campaign.run(directory, workers=workers, executor=executor, progress=progress)
    else:
        table = campaign.run(directory, workers=options.workers, progress=progress)
    print(table)
    failed = sum(status != FINISHED for status in table['status'])
    if failed:
        print(f'{failed} of {len(table)} runs did not finish; see the column reason')
    # Imported late: they need plotly and matplotlib.
    from hdd_servo_ros.campaign.page import write_page
    from hdd_servo_ros.campaign.plot import write_plot

    print(f'table: {directory / "table.csv"}')
    plot = write_plot(campaign, table, directory)
    if plot is not None:
        print(f'plot: {plot}')
    print(f'page: {write_page(campaign, table, directory)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
