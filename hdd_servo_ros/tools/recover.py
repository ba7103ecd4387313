"""`recover`: repair a run's bag and `run.yaml` after a crash."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, command, reading
from hdd_servo_ros.recording.recovery import BACKUP, Recovery


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='recover',
        description='Repair a run after a crash: write a closed bag of all complete ticks, and update run.yaml.',
        epilog=f'A damaged bag is moved into RUN/{BACKUP}/, with a copy of the original run.yaml; a repaired bag '
        'needs at most as much space as the damaged one, on the same disk or, with --output, on another one. '
        'Exit code: 0 the run is intact now, 1 no tick can be recovered, 2 invalid arguments, 3 it cannot be repaired.',
    )
    parser.add_argument('run', type=Path, metavar='RUN', help='run directory')
    parser.add_argument(
        '--output', type=Path, metavar='DIR', help='write the repaired run here and leave RUN unchanged'
    )
    parser.add_argument(
        '--dry-run', action='store_true', help='report the damage and the recoverable part, and change nothing'
    )
    return parser


@command('recover', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Repair a run; return 0 if it is intact now, 1 if no tick can be recovered, 3 if it cannot be read."""
    parsed = command_line().parse_args(arguments)
    with reading(parsed.run):
        recovery = Recovery(parsed.run)
    finding = recovery.finding
    if not finding.faults and finding.last_tick < 0:
        print(f'recover: {parsed.run}: nothing can be repaired: {finding.status}, {finding.reason}')
        return 1
    if not finding.faults:
        print(f'recover: {parsed.run} is intact: {finding.status}, last tick {finding.last_tick}')
        return 0
    for fault in finding.faults:
        print(f'recover: {fault}')
    print(f'recover: {finding.kept} messages, complete up to tick {finding.last_tick}')
    if finding.left:
        print(f'recover: {finding.left} messages after that tick remain in the original only')
    if parsed.dry_run:
        if recovery.space_needed:
            print(f'recover: the repaired bag needs up to {math.ceil(recovery.space_needed / 1e6)} MB of disk space')
    else:
        originals = ' and '.join(str(path) for path in recovery.repair(parsed.output)) or 'none'
        print(f'recover: status in run.yaml is now {finding.status}; originals kept: {originals}')
    return 0 if finding.last_tick >= 0 else 1


if __name__ == '__main__':
    sys.exit(main())
