"""
Make the campaigns, and write their tables into ``docs/reliability.md``.

``python -m faults [NAME ...] [--trials N] [--first K] [--no-write]``; exit code 1 if there is a fault. A trial is made
again by ``python -m faults NAME --first K --trials 1``, with the K of its fault.
"""

import argparse
import datetime as dt
import os
import platform
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from faults import campaign, files, kills, parameter_values, stray_messages
from faults.processes import ROOT

CAMPAIGNS = {made.CAMPAIGN.name: made.CAMPAIGN for made in (kills, stray_messages, parameter_values, files)}
DOCUMENT = ROOT / 'docs' / 'reliability.md'
_MARK = '<!-- Below: written by `make faults`. -->\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Make campaigns; return the exit code."""
    parser = argparse.ArgumentParser(prog='python -m faults', description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'all if none: {", ".join(CAMPAIGNS)}')
    parser.add_argument('--trials', type=int, help='as many of each, instead of a whole campaign')
    parser.add_argument('--first', type=int, default=0, help='number of the first trial (0)')
    parser.add_argument('--no-write', action='store_true', help='leave the document as it is')
    parsed = parser.parse_args(arguments)
    unknown = [name for name in parsed.names if name not in CAMPAIGNS]
    if unknown:
        parser.error(f'there is no campaign {unknown[0]}; there are {", ".join(CAMPAIGNS)}')
    folder = Path(tempfile.mkdtemp(prefix='hdd_servo_ros-faults-'))
    results = []
    for name in parsed.names or CAMPAIGNS:
        chosen = CAMPAIGNS[name]
        count = chosen.trials if parsed.trials is None else parsed.trials
        results.append(campaign.run(chosen, folder, count, first=parsed.first, say=_say))
        print('\n'.join(results[-1].lines()), flush=True)
    if not parsed.no_write:
        write(results)
    faults = sum(len(result.faults) for result in results)
    if faults:
        _say(f'{faults} faults; what they left is in {folder}')
    return int(faults > 0)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def write(results: Sequence[campaign.Result]) -> None:
    """Put the tables of whole campaigns into the document, in the place of those that were there."""
    introduction = DOCUMENT.read_text('utf8').split(_MARK)[0]
    where = f'{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}'
    lines = [line for result in results for line in result.lines()]
    DOCUMENT.write_text(introduction + _MARK + '\n'.join(['', f'{dt.date.today()}, {where}.', '', *lines]), 'utf8')


if __name__ == '__main__':
    sys.exit(main())
