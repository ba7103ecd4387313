"""
Make the campaigns of faults, and write their tables into ``docs/reliability.md``.

Exit code 1 if there is a fault; ``python -m faults NAME --first K --trials 1`` makes its trial K again.
"""

import argparse
import dataclasses
import shutil
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from faults import (
    campaign,
    disk_full,
    files,
    kills,
    long_run,
    parameter_services,
    parameter_values,
    stray_messages,
    tables,
)
from faults.workers import at_the_same_time

_MODULES = (kills, stray_messages, parameter_values, parameter_services, files, disk_full, long_run)
CAMPAIGNS = {made.CAMPAIGN.name: made.CAMPAIGN for made in _MODULES}


def main(arguments: Sequence[str] | None = None) -> int:
    """Make campaigns; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m faults',
        description=(__doc__ or '').strip().splitlines()[0],
        epilog='\n'.join(['campaigns:', *map(_told, CAMPAIGNS.values()), '', tables.HOW_LONG]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('names', nargs='*', metavar='NAME', help='of the campaigns; all if none')
    parser.add_argument('--trials', type=int, help='as many of each, instead of a whole campaign; no table is written')
    parser.add_argument('--first', type=int, default=0, help='number of the first trial (0)')
    parser.add_argument('--minutes', type=float, help='end each campaign after so long, instead of its own time')
    parser.add_argument('--jobs', type=int, default=2, help='trials at a time (2)')
    parser.add_argument('--folder', help='where to make a temporary folder, instead of the usual one')
    parser.add_argument('--no-write', action='store_true', help='leave the document as it is')
    parsed = parser.parse_args(arguments)
    unknown = [name for name in parsed.names if name not in CAMPAIGNS]
    if unknown:
        parser.error(f'there is no campaign {unknown[0]}; there are {", ".join(CAMPAIGNS)}')
    # So that what the trials have started is ended with them.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    folder = Path(tempfile.mkdtemp(prefix='hdd_servo_ros-faults-', dir=parsed.folder))
    results = []
    for name in parsed.names or CAMPAIGNS:
        chosen = CAMPAIGNS[name]
        if parsed.minutes is not None:
            chosen = dataclasses.replace(chosen, seconds=60.0 * parsed.minutes)
        count = chosen.trials if parsed.trials is None else parsed.trials
        _say(f'{name}: {count} trials, {chosen.seconds / 60.0:.0f} min at most')
        made = at_the_same_time(parsed.jobs)
        result = campaign.run(chosen, folder, count, first=parsed.first, say=_say, made=made)
        print('\n'.join(result.lines()), flush=True)
        if parsed.trials is None and not parsed.no_write:
            tables.write(result, [each.title for each in CAMPAIGNS.values()])
        results.append(result)
    faults = sum(len(result.faults) for result in results)
    if faults:
        _say(f'{faults} faults; what they left is in {folder}')
    else:
        shutil.rmtree(folder)
    return int(faults > 0)


def _told(chosen: campaign.Campaign) -> str:
    return f'  {chosen.name:12} {chosen.trials:6} trials, {chosen.seconds / 60.0:3.0f} min at most: {chosen.title}'


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == '__main__':
    sys.exit(main())
