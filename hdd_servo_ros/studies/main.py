"""
`study`: figures and tables of the thesis, of the best PID controllers, of mobile use and of seeks.

    ros2 run hdd_servo_ros study chapter4|chapter5|baseline|mobile|seek [--without-ros] [--only FIGURE ...]
        [--output DIRECTORY]
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from hdd_servo_ros.campaign.case import Case, PlannedRun
from hdd_servo_ros.campaign.command import exit_code
from hdd_servo_ros.campaign.runner import run_cases
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.studies.chapter import CHAPTERS, figures, make_figures

MINIMUM_SAMPLES = 50
"""Minimum number of samples per reference period with ``--sample-time``; the thesis has 50 at 200 Hz and 0.1 ms."""


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='study',
        description='Run a set of experiments, of the thesis or of this package, and make its figures and tables.',
        epilog='A finished run with the same parameters is reused.',
    )
    parser.add_argument(
        'chapter',
        choices=CHAPTERS,
        help='set of experiments; chapter4, chapter5: those of the thesis; baseline: the best PID controllers; mobile: '
        'vibration, shock, feedforward and runout; seek: seek times and settling',
    )
    parser.add_argument(
        '--without-ros',
        action='store_true',
        help='use simulate instead of the node graph: faster, with bit-identical results',
    )
    parser.add_argument('--only', nargs='+', default=[], metavar='FIGURE', help='make only these figures and tables')
    parser.add_argument('--list', action='store_true', help='list the figures and tables with their runs, and exit')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIRECTORY',
        help='output directory; default: runs/CHAPTER, or runs/CHAPTER-without-ros',
    )
    parser.add_argument(
        '--sample-time',
        type=float,
        metavar='T',
        help='sample time T [s] for a quick look, instead of that of the parameter files; the default output directory '
        f'then has the suffix -TVALUE; every reference needs at least {MINIMUM_SAMPLES} samples per period',
    )
    return parser


def _default_output(options: argparse.Namespace) -> Path:
    parts = [options.chapter]
    parts += ['without-ros'] if options.without_ros else []
    parts += [f'T{options.sample_time:g}'] if options.sample_time is not None else []
    return Path('runs') / '-'.join(parts)


def _reject_too_coarse(cases: Iterable[Case], defaults: Mapping[str, object], directory: Path) -> None:
    """Reject a sample time with too few samples per reference period."""
    for case in cases:
        run = PlannedRun(case, defaults, directory)
        samples = run.period / run.sample_time
        if samples < MINIMUM_SAMPLES * (1.0 - 1e-9):
            raise ArgumentError(
                f'--sample-time {run.sample_time:g} is rejected: {case.name} would have {samples:.3g} samples per '
                f'reference period, fewer than {MINIMUM_SAMPLES}; expected at most {run.period / MINIMUM_SAMPLES:.3g} s'
            )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; exit code 0 done, 1 a run failed, 2 invalid arguments or parameters, 130 interrupted."""
    options = command_line().parse_args(arguments)
    defaults = {} if options.sample_time is None else {'deterministic_timer:sample_time': options.sample_time}
    directory = options.output or _default_output(options)

    def work() -> int:
        wanted = figures(options.chapter, options.only)
        if options.list:
            for name, figure in wanted.items():
                runs = ', '.join(case.name for case in figure.CASES)
                print(f'{name}: {figure.__doc__.strip().splitlines()[0]}\n    {runs}')
            return 0
        cases = [case for figure in wanted.values() for case in figure.CASES]
        if options.sample_time is not None:
            _reject_too_coarse(cases, defaults, directory)
        run_cases(cases, directory, without_ros=options.without_ros, defaults=defaults)
        for path in make_figures(wanted, directory):
            print(path)
        return 0

    return exit_code('study', work)


if __name__ == '__main__':
    sys.exit(main())
