"""A one-hour recording by `simulate`: memory of the commands, and bit-identity with `rig`."""

import random
from pathlib import Path

from faults.campaign import HANG, WRONG, Campaign, Fault, Trial
from faults.judging import tracebacks
from faults.measured import run_measured
from faults.processes import PARAMS
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.run_folder import read_run_yaml

HOUR, RIG = 36_000_000, 1_000_000
"""Ticks of 0.1 ms."""
MOST_MEMORY = 500.0
"""Memory limit of any command [MB]."""
MOST_GROWTH = 100.0
"""Largest difference between the memory of recording one hour and of recording 100 s [MB]."""
_ALONE = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}
_LONGEST = 7200.0
"""Time limit of a command [s]."""


def trial(folder: Path, choice: random.Random) -> Trial:
    """Record one hour, read it and replay it; the trial makes no random choice."""
    return recorded(folder, HOUR, RIG)


def recorded(folder: Path, ticks: int, rig_ticks: int) -> Trial:
    """
    Record a number of ticks, read them and replay them.

    Parameters
    ----------
    folder
        Directory; one hour takes 10 GB, compressed, and its replay another 10 GB.
    ticks
        Ticks of `simulate`.
    rig_ticks
        Ticks of `rig` and of a short recording by `simulate`, whose memory is the baseline of the long one; 0 for none.
    """
    # Fills the kernel cache, because the compiler takes more memory than the commands.
    for module in ('hdd_servo_ros.simulation.simulate', *(['hdd_servo_ros.nodes.rig'] if rig_ticks else [])):
        run_measured(module, *_arguments(folder / module, 100), environment=_ALONE, most_seconds=_LONGEST)
    made = _Recordings(folder)
    if rig_ticks:
        made.record('short', rig_ticks)
        made.run('rig', 'hdd_servo_ros.nodes.rig', *_arguments(folder / 'rig', rig_ticks))
    made.record('long', ticks)
    if not made.faults:
        made.compare('long', ticks, 'again', ticks)
        if rig_ticks:
            made.compare('long', ticks, 'rig', rig_ticks)
            made.reject_growth()
    return Trial(f'{ticks} ticks by simulate, {rig_ticks} by rig', made.faults, figures=made.figures)


class _Recordings:
    """Runner of the commands, with the measured values."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.figures: dict[str, float] = {}
        self.faults: list[Fault] = []

    def record(self, name: str, ticks: int) -> None:
        """Record a run, report it, check it for damage and replay it."""
        run, again = self._folder / name, self._folder / ('again' if name == 'long' else f'{name}-again')
        self.run(f'{name} simulate', 'hdd_servo_ros.simulation.simulate', *_arguments(run, ticks))
        self.run(f'{name} report', 'hdd_servo_ros.tools.report', run)
        self.run(f'{name} recover', 'hdd_servo_ros.tools.recover', run, '--dry-run')
        self.run(f'{name} replay', 'hdd_servo_ros.tools.replay', run, '--without-ros', '--output', again)

    def run(self, name: str, module: str, *arguments: object) -> None:
        """Run a command and measure it, unless an earlier one has failed."""
        if self.faults:
            return
        try:
            done = run_measured(module, *arguments, environment=_ALONE, most_seconds=_LONGEST)
        except TimeoutError as error:
            self.faults.append(Fault(HANG, str(error)))
            return
        self.figures[f'memory of {name} [MB]'] = done.memory
        self.figures[f'time of {name} [s]'] = done.seconds
        self.faults += tracebacks(done.errors, name)
        if done.exit_code:
            self.faults.append(Fault(WRONG, f'{name}: exit code {done.exit_code}: {done.errors[-500:]}'))
        if done.memory > MOST_MEMORY:
            self.faults.append(Fault(WRONG, f'{name}: {done.memory:.0f} MB, more than {MOST_MEMORY:.0f} MB'))

    def compare(self, left: str, left_ticks: int, right: str, right_ticks: int) -> None:
        """Check the lengths of two runs, and that the right one is bit-identical to the start of the left one."""
        for name, ticks in ((left, left_ticks), (right, right_ticks)):
            last_tick = read_run_yaml(self._folder / name)['last_tick']
            if last_tick != ticks:
                self.faults.append(Fault(WRONG, f'{name}: last tick {last_tick}, expected {ticks}'))
        difference = first_difference(self._folder / right, self._folder / left, right_ticks)
        if difference is not None:
            self.faults.append(Fault(WRONG, f'{left} and {right} differ: {difference}'))

    def reject_growth(self) -> None:
        """Check that the memory of recording does not grow with the run."""
        short, long = (self.figures[f'memory of {length} simulate [MB]'] for length in ('short', 'long'))
        if long - short > MOST_GROWTH:
            growth = f'{short:.0f} MB for the short run, {long:.0f} MB for the long one'
            self.faults.append(Fault(WRONG, f'simulate: {growth}'))


def _arguments(run: Path, ticks: int) -> tuple[object, ...]:
    given = ('-p', f'run_dir:={run}', '-p', f'duration:={ticks * 1e-4}', '-p', 'compression:=zstd')
    return '--ros-args', '--params-file', PARAMS, *given, '-p', 'plot:=true', '-p', 'progress:=false'


CAMPAIGN = Campaign('long_run', 'One-hour recording', 1, 0, 14400.0, trial, trial_seconds=14400.0, jobs=1)
