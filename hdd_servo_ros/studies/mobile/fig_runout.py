"""Cancellation of repeatable runout with PID: error by sector, learning curves over revolutions, and spectra."""

from pathlib import Path
from typing import Any

import numpy as np

from hdd_servo_ros.analysis.metrics import NANOMETRES, power_spectral_density
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.runout_cases import DRAWN, DRAWN_ALONE, FIRST
from hdd_servo_ros.studies.output import new_figure, save

SECTORS = 84
_SHOWN = 40
"""Number of revolutions in the learning curves."""
_SEGMENT = 20
"""Revolutions per segment of the spectra; the resolution is 1/20 of the rotation frequency."""
_STYLES: dict[str, dict[str, Any]] = {'none': {'color': '0.35'}, 'repetitive': {'color': 'C0'}}
_NAMES = {'none': 'no cancellation', 'repetitive': 'repetitive control'}
CASES = (*DRAWN.values(), *DRAWN_ALONE.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the repeatable error by sector above, learning curves and spectra below."""
    figure = new_figure('Repeatable runout at 7200 1/min, 84 sectors, PID', width=9.5, height=6.4)
    panels = figure.subplot_mosaic([['sectors', 'sectors'], ['learning', 'spectrum']])
    for method, case in DRAWN.items():
        run = runs[case]
        error = run.track_error * NANOMETRES
        parts = runout_parts(error[FIRST * SECTORS : len(error) // SECTORS * SECTORS], SECTORS)
        label = (
            f'{_NAMES[method]}: RPE {parts.repeatable_peak_to_peak:.1f} nm peak to peak, '
            f'NRPE {parts.non_repeatable_three_sigma:.1f} nm 3 sigma'
        )
        panels['sectors'].step(np.arange(SECTORS), parts.repeatable, where='mid', label=label, **_STYLES[method])
        panels['learning'].semilogy(
            *_by_revolution(error), **_STYLES[method], label=f'{_NAMES[method]}, all disturbances'
        )
        late = error[FIRST * SECTORS :]
        frequencies, power = power_spectral_density(late, run.sample_time, _SEGMENT * SECTORS)
        panels['spectrum'].semilogy(
            1e-3 * frequencies[1:], np.sqrt(power[1:]), linewidth=0.8, label=_NAMES[method], **_STYLES[method]
        )
    for method, case in DRAWN_ALONE.items():
        error = runs[case].track_error * NANOMETRES
        label = f'{_NAMES[method]}, runout only'
        panels['learning'].semilogy(*_by_revolution(error), linestyle='--', **_STYLES[method], label=label)
    panels['sectors'].set_xlabel(f'servo sector, mean from revolution {FIRST + 1} on')
    panels['sectors'].set_ylabel('repeatable error [nm]')
    low, high = panels['sectors'].get_ylim()
    panels['sectors'].set_ylim(low, high + 0.35 * (high - low))
    panels['sectors'].legend(loc='upper left', fontsize=9, frameon=False)
    panels['learning'].set_xlabel('revolution')
    panels['learning'].set_ylabel('rms error of the revolution [nm]')
    panels['learning'].set_ylim(0.015, 20.0)
    panels['learning'].legend(loc='lower center', ncols=1, fontsize=8, frameon=False)
    panels['spectrum'].set_xlabel('frequency [kHz]')
    panels['spectrum'].set_ylabel('error [nm/√Hz]')
    panels['spectrum'].set_ylim(4e-3, 1.0)
    panels['spectrum'].legend(loc='lower left', fontsize=8, frameon=False)
    return save(figure, path)


def _by_revolution(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the first revolutions and the rms error in each."""
    by_sector = error[: _SHOWN * SECTORS].reshape(_SHOWN, SECTORS)
    return np.arange(1, _SHOWN + 1), np.sqrt(np.mean(by_sector**2, axis=1))
