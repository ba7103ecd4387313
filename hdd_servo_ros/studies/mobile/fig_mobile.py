"""PID in rotational vibration and during a shock, with and without feedforward from accelerometers."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import IN_VIBRATION, NO_VIBRATION, SHOCK
from hdd_servo_ros.studies.mobile.drawing import (
    NO_VIBRATION_NAME,
    STYLES,
    common_legend,
    density,
    error,
    over_frequency,
)
from hdd_servo_ros.studies.mobile.fig_shock import draw_error, legend
from hdd_servo_ros.studies.output import draw, new_figure, save

_METHODS = ('none', 'fixed', 'fxlms')
_START = 0.4
"""Duration drawn at the start [s]."""
_IN_VIBRATION = {method: IN_VIBRATION['pid'][method] for method in _METHODS}
CASES = (*_IN_VIBRATION.values(), NO_VIBRATION['pid'], *SHOCK[63.0]['pid'].values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the error at the start, its spectra, and the error during the shock."""
    figure = new_figure('PID in mobile use, with and without feedforward from accelerometers', width=9.0, height=5.6)
    panels = figure.subplot_mosaic([['start', 'start'], ['spectrum', 'shock']])
    for method, case in _IN_VIBRATION.items():
        run = runs[case]
        rows = run.time <= _START
        draw(panels['start'], run.time[rows], error(run)[rows], **{**STYLES[method], 'linewidth': 0.9})
    panels['start'].set_ylabel('error [nm]')
    panels['start'].set_xlabel('time [s]: rotational vibration of 12.5 rad/s² from 10 to 500 Hz')
    spectra = {**_IN_VIBRATION, NO_VIBRATION_NAME: NO_VIBRATION['pid']}
    for method, case in spectra.items():
        frequencies, power = density(runs[case])
        panels['spectrum'].semilogy(frequencies, np.sqrt(power), linewidth=1.0, **STYLES[method])
    over_frequency(panels['spectrum'])
    panels['spectrum'].set_ylim(3e-3, 5.0)
    panels['spectrum'].set_ylabel('error [nm/√Hz]')
    panels['spectrum'].set_xlabel('frequency [Hz], the same vibration after 2 s')
    for case in SHOCK[63.0]['pid'].values():
        draw_error(runs, panels['shock'], case)
    panels['shock'].set_ylabel('error [nm]')
    panels['shock'].set_xlabel('time after the start of a 63 g shock [ms]')
    legend(panels['shock'])
    common_legend(figure, panels['spectrum'])
    return save(figure, path)
