"""Error spectra in rotational vibration, with each feedforward and without."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, DURATION, TRANSIENT
from hdd_servo_ros.studies.mobile.drawing import COMPARED, STYLES, common_legend, cumulative, density, over_frequency
from hdd_servo_ros.studies.output import new_figure, save

CASES = tuple(case for cases in COMPARED.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw density and cumulative 3 sigma over frequency, one column per controller."""
    title = f'Error in rotational vibration, {TRANSIENT:g} to {DURATION:g} s, accelerometers of 1 kHz, gain +12.5 %'
    figure = new_figure(title, width=10.0, height=6.5)
    every = figure.subplots(2, 2, sharex=True, sharey='row')
    for column, (controller, name) in enumerate(CONTROLLERS.items()):
        upper, lower = every[:, column]
        upper.set_title(name, fontsize=10)
        for method, case in COMPARED[controller].items():
            frequencies, power = density(runs[case])
            upper.semilogy(frequencies, np.sqrt(power), linewidth=1.0, **STYLES[method])
            lower.semilogy(frequencies, cumulative(frequencies, power), linewidth=1.2, **STYLES[method])
        for axes in (upper, lower):
            axes.axvspan(10.0, 500.0, color='0.93', zorder=0)
        over_frequency(upper)
        lower.set_xlabel('frequency [Hz]')
    every[0, 0].set_ylim(3e-3, 10.0)
    every[1, 0].set_ylim(0.1, 300.0)
    every[0, 0].set_ylabel('error [nm/√Hz]')
    every[1, 0].set_ylabel('3 sigma below this frequency [nm]')
    common_legend(figure, every[0, 0])
    return save(figure, path)
