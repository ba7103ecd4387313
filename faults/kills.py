"""Kills of any process of a run at random ticks: the others end with a reason, and the recording can be recovered."""

import os
import random
import signal
import time
from pathlib import Path

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from faults.campaign import WRONG, Campaign, Fault, Trial
from faults.external_node import ExternalNode, external_node
from faults.judging import call, false_claims, first_line, status_of
from faults.processes import LONGEST_START, NODES, Processes, processes
from faults.reference import LENGTH, reference_run
from hdd_servo_ros.messages.topics import RECORDER
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.tools.recover import main as recover

_SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_STORAGES = {
    'mcap': (),
    'mcap with zstd': ('-p', 'compression:=zstd'),
    'sqlite3': ('-p', 'storage:=sqlite3'),
}
_SAMPLE_TIME = 1e-4
MOST_LOST = 0.2
"""Longest time that a recording may lose after a kill [s]."""
_COMPLETE = 'ended before the signal, or its writer had not started'


def trial(folder: Path, choice: random.Random) -> Trial:
    """Run the graph in one or more processes, and send a signal to one of them."""
    with processes(folder) as run, external_node(run.domain) as listener:
        return _killed(run, listener, folder / 'run', choice)


def _killed(run: Processes, listener: ExternalNode, recorded: Path, choice: random.Random) -> Trial:
    storage = choice.choice(list(_STORAGES))
    given = ('-p', f'duration:={LENGTH}', '-p', 'run_dir:=run', '-p', 'rate:=1.0', *_STORAGES[storage])
    victim = choice.choice(['rig', 'writer'] if choice.random() < 0.5 else [*NODES, RECORDER, RECORDER])
    number = choice.choice(_SIGNALS)
    clock = _Clock(listener)
    for name in ['rig'] if victim in ('rig', 'writer') else NODES:
        run.start(name, *given, *(('-p', 'rig:plot:=false') if name == 'rig' else ()))
    if choice.random() < 0.1:
        # Some signals are sent before the run starts.
        time.sleep(choice.uniform(0.0, 5.0))
    elif not listener.spin_until(lambda: clock.tick >= 0 or _one_has_ended(run), LONGEST_START):
        return Trial('did not start', [Fault(WRONG, first_line(run.outputs(), 'ERROR') or 'the run did not start')])
    else:
        time.sleep(choice.uniform(0.0, 2.5))
    target = _pid(run, victim)
    if target is None:
        faults = run.ended()
        if not faults and status_of(recorded) != 'none':
            keeper = run.started.get(RECORDER, run.started.get('rig'))
            assert keeper is not None
            faults += false_claims(recorded, keeper.returncode, reference_run(recorded.parent.parent))
        return Trial(_COMPLETE, faults)
    known = clock.last()
    os.kill(target, number)
    faults = run.ended()
    kind = victim if victim in ('rig', 'writer', RECORDER) else 'another node'
    if faults:
        return Trial(f'{kind} and {number.name}', faults)
    codes = {name: process.returncode for name, process in run.started.items()}
    killed = number == signal.SIGKILL and victim != 'writer'
    faults += _wrong_codes(codes, victim, number)
    status = status_of(recorded)
    if status == 'none':
        if known >= 0:
            faults.append(Fault(WRONG, f'run.yaml is missing at tick {known}'))
        return Trial('before the run directory existed', faults)
    code = codes.get(RECORDER, codes.get('rig'))
    keeper_is_dead = killed and victim in ('rig', RECORDER)
    reference = reference_run(recorded.parent.parent)
    if status == 'running' and not keeper_is_dead:
        faults.append(Fault(WRONG, f'status running after {number.name} to {victim}'))
    claimed = _last_tick(recorded)
    is_open = not (recorded / 'bag' / 'metadata.yaml').exists()
    if is_open and status != 'running' and not (victim == 'writer' and number == signal.SIGKILL):
        faults.append(Fault(WRONG, f'the bag was not closed after {number.name} to {victim}'))
    if is_open or status == 'running':
        # No process is left to close the bag.
        faults += _unrecoverable(recorded)
    faults += false_claims(recorded, None if keeper_is_dead else code, reference)
    last_tick = _last_tick(recorded)
    if claimed > last_tick:
        faults.append(Fault(WRONG, f'last tick {claimed} in run.yaml, {last_tick} in the bag'))
    lost = (known - last_tick) * _SAMPLE_TIME
    if lost > MOST_LOST:
        faults.append(Fault(WRONG, f'{lost:.4f} s lost by {number.name} to {victim}, {storage}'))
    outcome = 'recovered' if is_open or status == 'running' else status
    return Trial(
        f'{kind}, {number.name}: {outcome}',
        faults,
        figures={f'lost after a signal to {kind}, {storage} [s]': max(lost, 0.0)},
    )


class _Clock:
    """The last tick received by an external node."""

    def __init__(self, listener: ExternalNode) -> None:
        self.tick = -1
        self._listener = listener
        # Only the newest message: 10,000 per second would overload this process.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # type: ignore[no-untyped-call]
        listener.node.create_subscription(Clock, 'clock', self._take, newest)

    def _take(self, message: Clock) -> None:
        self.tick = round((message.clock.sec + message.clock.nanosec * 1e-9) / _SAMPLE_TIME)

    def last(self) -> int:
        """Return the last tick received so far, -1 before the first."""
        before = self.tick
        if before >= 0:
            self._listener.spin_until(lambda: self.tick != before, 0.1)
        return self.tick


def _last_tick(recorded: Path) -> int:
    """Return the last tick in `run.yaml`, -1 without one."""
    found = read_run_yaml(recorded)['last_tick']
    return -1 if found is None else int(found)


def _one_has_ended(run: Processes) -> bool:
    return any(process.poll() is not None for process in run.started.values())


def _pid(run: Processes, victim: str) -> int | None:
    if victim != 'writer':
        process = run.started[victim]
        return process.pid if process.poll() is None else None
    own = run.started['rig'].pid
    return next((pid for pid in run.family() if pid != own), None)


def _wrong_codes(codes: dict[str, int], victim: str, number: signal.Signals) -> list[Fault]:
    """Return a fault if a process reports a disturbed run as finished, unless it ended before the signal."""
    if all(code == 0 for name, code in codes.items() if name != victim) and codes.get(victim, 0) in (0, -number):
        return []
    others = {name: code for name, code in codes.items() if name != victim}
    # A process that did not get the signal itself ends with the exit code of Ctrl-C.
    allowed = {1, 128 + number, 128 + signal.SIGINT} if number != signal.SIGKILL else {1}
    wrong = {name: code for name, code in others.items() if code not in allowed}
    return [Fault(WRONG, f'exit codes {wrong} after {number.name} to {victim}')] if wrong else []


def _unrecoverable(recorded: Path) -> list[Fault]:
    code, printed, faults = call(recover, [str(recorded)])
    if code not in (0, 1):
        faults.append(Fault(WRONG, f'recover: exit code {code}: {printed[-200:]}'))
    return faults


CAMPAIGN = Campaign('kills', 'Kills of every process at random ticks', 300, 3, 7200.0, trial)
