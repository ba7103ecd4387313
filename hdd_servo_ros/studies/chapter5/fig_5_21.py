"""Fig. 5.21: hysteresis at 80 Hz with and without compensation."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import HYSTERESIS_FREQUENCY, HYSTERESIS_OFF, HYSTERESIS_ON
from hdd_servo_ros.studies.chapter5.measures import last_cycles, loop_areas
from hdd_servo_ros.studies.output import new_figure, save

_RUNS = {'without: only -k r': HYSTERESIS_OFF, 'with: complete law': HYSTERESIS_ON}
CASES = tuple(_RUNS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the feedback part of the command, and the command, over displacement."""
    figure = new_figure(f'Fig. 5.21: a sine of 2 µm at {HYSTERESIS_FREQUENCY:g} Hz, with and without compensation')
    feedback, command = figure.subplots(1, 2, sharey=True)
    for name, case in _RUNS.items():
        run = runs[case]
        rows = last_cycles(run, 4)
        areas = loop_areas(run)
        x = run.position[rows]
        for axes, column, area in ((feedback, 2, areas.feedback), (command, 0, areas.command)):
            text = f'{name}\n{1e3 * area:.1f} mV µm'
            axes.plot(x, run.control[rows, column], linewidth=1.0, label=text)
    for axes, title in ((feedback, 'feedback part -k r'), (command, 'command')):
        axes.set_title(title, fontsize=10)
        axes.set_xlabel('displacement [µm]')
        axes.set_ylim(-0.04, 0.05)
        axes.legend(fontsize=8, loc='upper center', ncols=2)
    feedback.set_ylabel('[V]')
    return save(figure, path)
