"""Errors of the adaptive NN controller and both PID controllers over frequency and over amplitude."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import AMPLITUDE, FREQUENCY, OVER_AMPLITUDE, OVER_FREQUENCY, TRANSIENT
from hdd_servo_ros.studies.output import legend_above, new_figure, save

CASES = tuple(case for cases in (OVER_FREQUENCY, OVER_AMPLITUDE) for own in cases.values() for case in own.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the rms errors, one panel over frequency and one over amplitude."""
    figure = new_figure('Adaptive NN and the best PID controllers on sines', height=6.5)
    frequency, amplitude = figure.subplots(2, 1)
    _draw(frequency, runs, OVER_FREQUENCY)
    frequency.set_xlabel(f'frequency [Hz], {AMPLITUDE:g} µm')
    _draw(amplitude, runs, OVER_AMPLITUDE)
    amplitude.set_xlabel(f'amplitude [µm], {FREQUENCY:g} Hz')
    legend_above(frequency)
    return save(figure, path)


def _draw(axes: Axes, runs: RecordedRuns, compared: Mapping[str, Mapping[float, Case]]) -> None:
    for name, cases in compared.items():
        errors = [runs.metrics(case, TRANSIENT, NANOMETRES).rms_error for case in cases.values()]
        axes.loglog(list(cases), errors, 'o-', markersize=4, label=name)
    axes.set_ylabel('rms error [nm]')
