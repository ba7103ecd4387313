"""Kills of every process of a run at random ticks: the others end, say why, and what is left can be recovered."""

import os
import random
import signal
import time
from pathlib import Path

from faults.campaign import WRONG, Campaign, Fault, Trial
from faults.judging import call, false_claims, first_line, status_of, wait_until
from faults.processes import NODES, Processes, processes
from faults.reference import LENGTH, reference_run
from hdd_servo_ros.tools.recover import main as recover

_SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_COMPLETE = 'finished before the signal'


def trial(folder: Path, choice: random.Random) -> Trial:
    """Run the graph, in one process or in many, and send one of its processes a signal."""
    with processes(folder) as run:
        return _killed(run, folder / 'run', choice)


def _killed(run: Processes, recorded: Path, choice: random.Random) -> Trial:
    arguments = ('-p', f'duration:={LENGTH}', '-p', 'run_dir:=run', '-p', 'rate:=1.0', '-p', 'peer_timeout:=1.0')
    victim = choice.choice(['rig', 'writer', *NODES])
    for name in ['rig'] if victim in ('rig', 'writer') else NODES:
        run.start(name, *arguments, *(('-p', 'rig:plot:=false') if name == 'rig' else ()))
    if not wait_until(lambda: (recorded / 'bag').exists() or _one_has_ended(run), 120.0):
        return Trial('did not start', [Fault(WRONG, first_line(run.outputs(), 'ERROR') or 'it never started')])
    time.sleep(choice.uniform(0.0, 3.0))
    number = choice.choice(_SIGNALS)
    target = _pid(run, victim)
    if target is None:
        return Trial(_COMPLETE, run.ended())
    os.kill(target, number)
    faults = run.ended()
    if faults:
        return Trial(f'{victim} and {number.name}', faults)
    codes = {name: process.returncode for name, process in run.started.items()}
    killed = number == signal.SIGKILL and victim != 'writer'
    faults += _wrong_codes(codes, victim, number)
    status = status_of(recorded)
    if status == 'none':
        return Trial('before there was a run', faults)
    code = codes.get('bag_recorder', codes.get('rig'))
    keeper_is_dead = killed and victim in ('rig', 'bag_recorder')
    faults += false_claims(recorded, None if keeper_is_dead else code, reference_run())
    if status == 'running' and not keeper_is_dead:
        faults.append(Fault(WRONG, f'status running after {number.name} to {victim}'))
    if status == 'running':
        faults += _unrecoverable(recorded)
        return Trial(f'{victim} killed: recovered', faults)
    return Trial(f'{"killed" if killed else "asked to end"}: {status}', faults)


def _one_has_ended(run: Processes) -> bool:
    return any(process.poll() is not None for process in run.started.values())


def _pid(run: Processes, victim: str) -> int | None:
    if victim != 'writer':
        process = run.started[victim]
        return process.pid if process.poll() is None else None
    own = run.started['rig'].pid
    return next((pid for pid in run.family() if pid != own), None)


def _wrong_codes(codes: dict[str, int], victim: str, number: signal.Signals) -> list[Fault]:
    """Nobody may count a disturbed run as finished, unless it was over before the signal came."""
    if all(code == 0 for name, code in codes.items() if name != victim) and codes.get(victim, 0) in (0, -number):
        return []
    others = {name: code for name, code in codes.items() if name != victim}
    # A process that was not asked itself ends as interrupted by Ctrl-C.
    allowed = {1, 128 + number, 128 + signal.SIGINT} if number != signal.SIGKILL else {1}
    wrong = {name: code for name, code in others.items() if code not in allowed}
    return [Fault(WRONG, f'exit codes {wrong} after {number.name} to {victim}')] if wrong else []


def _unrecoverable(recorded: Path) -> list[Fault]:
    code, printed, faults = call(recover, [str(recorded)])
    if code not in (0, 1):
        faults.append(Fault(WRONG, f'recover: exit code {code}: {printed[-200:]}'))
    elif code == 0 and not faults:
        faults += false_claims(recorded, None, reference_run())
    return faults


CAMPAIGN = Campaign('kills', 'Kills of every process at random ticks', 300, 3, 3600.0, trial)
