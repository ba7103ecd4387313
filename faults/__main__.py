"""
Run the fault campaigns, and write their tables into ``docs/reliability.md``.

The exit code is 1 if a fault was found; ``python -m faults NAME --first K --trials 1`` repeats trial K of a campaign.
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
from faults.workers import parallel

_MODULES = (kills, stray_messages, parameter_values, parameter_services, files, disk_full, long_run)
CAMPAIGNS = {made.CAMPAIGN.name: made.CAMPAIGN for made in _MODULES}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run campaigns; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m faults',
        description=(__doc__ or '').strip().splitlines()[0],
        epilog='\n'.join(['campaigns:', *map(_described, CAMPAIGNS.values()), '', tables.DURATIONS]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('names', nargs='*', metavar='NAME', help='campaigns to run; default: all')
    parser.add_argument('--trials', type=int, help='number of trials per campaign, instead of all; no table is written')
    parser.add_argument('--first', type=int, default=0, help='number of the first trial (default 0)')
    parser.add_argument('--minutes', type=float, help='time limit per campaign, instead of its own')
    parser.add_argument('--jobs', type=int, default=2, help='number of parallel trials (default 2)')
    parser.add_argument('--folder', help='parent of the temporary directory, instead of the default')
    parser.add_argument('--no-write', action='store_true', help='do not write docs/reliability.md')
    parsed = parser.parse_args(arguments)
    unknown = [name for name in parsed.names if name not in CAMPAIGNS]
    if unknown:
        parser.error(f'unknown campaign {unknown[0]}; expected one of {", ".join(CAMPAIGNS)}')
    # SIGTERM must also end the processes that the trials have started.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    folder = Path(tempfile.mkdtemp(prefix='hdd_servo_ros-faults-', dir=parsed.folder))
    results = []
    for name in parsed.names or CAMPAIGNS:
        chosen = CAMPAIGNS[name]
        if parsed.minutes is not None:
            chosen = dataclasses.replace(chosen, seconds=60.0 * parsed.minutes)
        count = chosen.trials if parsed.trials is None else parsed.trials
        _log(f'{name}: {count} trials, at most {chosen.seconds / 60.0:.0f} min')
        runner = parallel(parsed.jobs)
        result = campaign.run(chosen, folder, count, first=parsed.first, log=_log, runner=runner)
        print('\n'.join(result.lines()), flush=True)
        if parsed.trials is None and not parsed.no_write:
            tables.write(result, [each.title for each in CAMPAIGNS.values()])
        results.append(result)
    faults = sum(len(result.faults) for result in results)
    if faults:
        _log(f'{faults} faults; the directories of their trials are in {folder}')
    else:
        shutil.rmtree(folder)
    return int(faults > 0)


def _described(chosen: campaign.Campaign) -> str:
    return f'  {chosen.name:12} {chosen.trials:6} trials, at most {chosen.seconds / 60.0:3.0f} min: {chosen.title}'


def _log(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == '__main__':
    sys.exit(main())
