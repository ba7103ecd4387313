"""Learning curves in rotational vibration: running rms of the error over time."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS
from hdd_servo_ros.studies.mobile.drawing import COMPARED, RUNNING, STYLES, common_legend, running_rms
from hdd_servo_ros.studies.output import new_figure, save

CASES = tuple(case for cases in COMPARED.values() for case in cases.values())
_TICKS = (1, 2, 5, 10, 20, 50, 100)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw one panel per controller."""
    title = f'Running rms of the error over {1e3 * RUNNING:g} ms in rotational vibration'
    figure = new_figure(title, height=6.0)
    every = figure.subplots(2, 1, sharex=True)
    for axes, (controller, name) in zip(every, CONTROLLERS.items(), strict=True):
        for method, case in COMPARED[controller].items():
            axes.semilogy(*running_rms(runs[case]), linewidth=1.1, **STYLES[method])
        axes.set_yticks(_TICKS, [str(tick) for tick in _TICKS])
        axes.minorticks_off()
        axes.set_ylim(1.0, 100.0)
        axes.set_ylabel(f'{name}: rms error [nm]')
    common_legend(figure, every[0])
    every[-1].set_xlabel('time [s]')
    return save(figure, path)
