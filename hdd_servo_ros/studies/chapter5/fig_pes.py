"""Spectrum of the position error signal on the 2 µm sines."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import amplitude_spectrum
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import FREQUENCIES, TRANSIENT
from hdd_servo_ros.studies.chapter5.measures import error
from hdd_servo_ros.studies.chapter5.sine_figures import compared
from hdd_servo_ros.studies.output import legend_above, new_figure, save

CASES = tuple(case for frequency in FREQUENCIES for case in compared(frequency).values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the amplitudes over frequency, one panel per sine."""
    figure = new_figure('Position error signal: amplitude spectrum, resolution 2 Hz, 2 to 10 s', height=5.5)
    every = figure.subplots(2, 1, sharex=True)
    for axes, frequency in zip(every, FREQUENCIES, strict=True):
        for index, (name, case) in enumerate(compared(frequency).items()):
            run = runs[case]
            pes = error(run)[run.time >= TRANSIENT]
            lines, amplitudes = amplitude_spectrum(pes, run.sample_time, 2.0)
            axes.semilogy(lines, amplitudes, color=f'C{index}', linewidth=0.9, label=name)
        axes.set_xlim(0.0, 2000.0)
        axes.set_ylim(1e-3, 2e2)
        axes.set_ylabel(f'{frequency:g} Hz: amplitude [nm]')
    legend_above(every[0])
    every[-1].set_xlabel('frequency [Hz]')
    return save(figure, path)
