"""Figs. 5.7 to 5.10: error and control on the sines."""

from pathlib import Path

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import NN, PID, PID_FOR_SINES, SHIPPED
from hdd_servo_ros.studies.chapter5.drawing import draw_start_and_end
from hdd_servo_ros.studies.chapter5.measures import error


def compared(frequency: float) -> dict[str, Case]:
    """Return the runs of one frequency [Hz] by their name in the legend."""
    return {
        'PID': PID[frequency],
        'law of the thesis': NN[frequency],
        'adaptive NN as shipped': SHIPPED[frequency],
        'PID for sines': PID_FOR_SINES[frequency],
    }


def draw_error(runs: RecordedRuns, path: Path, number: str, frequency: float) -> Path:
    """Draw a figure with the tracking errors."""
    title = f'Fig. {number}: tracking error, sine of 2 µm at {frequency:g} Hz'
    return draw_start_and_end(runs, path, title, 'error [nm]', compared(frequency), error, 3.0 / frequency)


def draw_control(runs: RecordedRuns, path: Path, number: str, frequency: float) -> Path:
    """Draw a figure with the commands."""
    title = f'Fig. {number}: control, sine of 2 µm at {frequency:g} Hz'
    return draw_start_and_end(
        runs,
        path,
        title,
        'u [V]',
        compared(frequency),
        lambda run: run.command,
        3.0 / frequency,
    )
