"""Fig. 5.6: hysteresis of the default drive at 80 Hz, open loop."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import HYSTERESIS_FREQUENCY, open_loop
from hdd_servo_ros.studies.chapter5.measures import last_cycles
from hdd_servo_ros.studies.output import new_figure, save

_RUNS = {amplitude: open_loop(amplitude) for amplitude in (0.1, 0.05, 0.02)}
CASES = tuple(_RUNS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw command and friction over displacement."""
    figure = new_figure(f'Fig. 5.6: hysteresis at {HYSTERESIS_FREQUENCY:g} Hz, sinusoidal command, open loop')
    command, friction = figure.subplots(1, 2)
    for amplitude, case in _RUNS.items():
        run = runs[case]
        rows = last_cycles(run, 4)
        x = run.position[rows]
        command.plot(x, run.command[rows], linewidth=1.0, label=f'{amplitude:g} V')
        friction.plot(x, run.head[rows, 2], linewidth=1.0)
    command.set_ylabel('command [V]')
    friction.set_ylabel('pivot friction [V]')
    for axes in (command, friction):
        axes.set_xlabel('displacement [µm]')
    command.legend(fontsize=8, loc='upper left')
    return save(figure, path)
