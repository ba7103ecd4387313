"""Table: TMR, repeatable and non-repeatable parts, and third harmonic of the position error signal on the sines."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.metrics import amplitude_spectrum, power_spectral_density, repeatable_parts, rms
from hdd_servo_ros.analysis.misregistration import misregistration, misregistration_from_spectrum
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import FREQUENCIES, TRANSIENT
from hdd_servo_ros.studies.chapter5.measures import error
from hdd_servo_ros.studies.chapter5.sine_figures import compared
from hdd_servo_ros.studies.output import write_table

CASES = tuple(case for frequency in FREQUENCIES for case in compared(frequency).values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per frequency and controller."""
    rows = []
    for frequency in FREQUENCIES:
        for name, case in compared(frequency).items():
            run = runs[case]
            sample_time = run.sample_time
            pes = error(run)[run.time >= TRANSIENT]
            parts = repeatable_parts(pes, 1.0 / (frequency * sample_time))
            lines, amplitudes = amplitude_spectrum(pes, sample_time)
            harmonics = [float(amplitudes[np.argmin(np.abs(lines - n * frequency))]) for n in (1, 3)]
            rows.append(
                (
                    f'{frequency:g}',
                    name,
                    rms(pes),
                    misregistration(pes),
                    misregistration_from_spectrum(*power_spectral_density(pes, sample_time)),
                    parts.repeatable_rms,
                    parts.non_repeatable_rms,
                    *harmonics,
                )
            )
    header = (
        'frequency [Hz]',
        'controller',
        'rms [nm]',
        'TMR = 3 sigma [nm]',
        'TMR from the spectrum [nm]',
        'repeatable rms [nm]',
        'non-repeatable rms [nm]',
        'amplitude at the reference frequency [nm]',
        'at the third harmonic [nm]',
    )
    return write_table(path, 'x - x_d of the head, sine of 2 um, 2 to 10 s.', header, rows)
