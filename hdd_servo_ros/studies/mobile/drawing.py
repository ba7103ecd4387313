"""Colors, names and quantities shared by the figures."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import NANOMETRES, power_spectral_density
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, IN_VIBRATION, NO_VIBRATION, TRANSIENT

RUNNING = 0.05
"""Window of the running rms [s]."""
RESOLUTION = 5.0
"""Frequency resolution of the spectra [Hz]."""
NO_VIBRATION_NAME = 'no vibration'
STYLES: dict[str, dict[str, Any]] = {
    'none': {'color': '0.35', 'label': 'no feedforward'},
    'fixed': {'color': 'C1', 'label': 'fixed'},
    'fxlms': {'color': 'C0', 'label': 'fxlms'},
    'iir': {'color': 'C4', 'label': 'iir'},
    'network': {'color': 'C3', 'label': 'network'},
    NO_VIBRATION_NAME: {'color': 'C2', 'label': NO_VIBRATION_NAME, 'linestyle': '--'},
}
"""Line styles, by method of feedforward."""
COMPARED = {
    controller: {**IN_VIBRATION[controller], NO_VIBRATION_NAME: NO_VIBRATION[controller]} for controller in CONTROLLERS
}
"""Runs drawn together, by controller and line."""


def error(run: RecordedRun) -> NDArray[np.float64]:
    """Return the error x - x_d of the true head position [nm], shape (n,)."""
    return run.error * NANOMETRES


def running_rms(run: RecordedRun) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times [s] and the rms error over the ``RUNNING`` seconds before each of them [nm]."""
    count = round(RUNNING / run.sample_time)
    squares = np.concatenate([[0.0], np.cumsum(error(run) ** 2)])
    rms = np.sqrt((squares[count:] - squares[:-count]) / count)
    every = max(1, count // 25)
    return run.time[count - 1 :: every], rms[::every]


def density(run: RecordedRun) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies above 0 [Hz] and the one-sided power spectral density of the error [nm^2/Hz]."""
    late = error(run)[run.since(TRANSIENT)]
    segment = min(len(late), round(1.0 / (RESOLUTION * run.sample_time)))
    frequencies, power = power_spectral_density(late, run.sample_time, segment)
    return frequencies[1:], power[1:]


def cumulative(frequencies: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 3 sigma of the components below each frequency, for a density in unit^2/Hz in this unit."""
    pieces = 0.5 * (power[1:] + power[:-1]) * np.diff(frequencies)
    return np.asarray(3.0 * np.sqrt(np.concatenate([[0.0], np.cumsum(pieces)])))


def over_frequency(axes: Axes) -> None:
    """Set a logarithmic frequency axis from 10 Hz to 5 kHz."""
    axes.set_xscale('log')
    axes.set_xlim(10.0, 5000.0)


def common_legend(figure: Figure, axes: Axes) -> None:
    """Add one legend below all axes of a figure, with the lines of the given axes."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=len(labels), fontsize=9, frameon=False)
