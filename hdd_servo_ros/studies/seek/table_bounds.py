"""Table: bounds of the seek time: T* of the rigid drive, and LP of the sampled drive with its modes."""

from pathlib import Path

from hdd_servo_ros.analysis.seek_bounds import fastest_seek, time_optimal_seek
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.seek.cases import BASE, FAST

LENGTHS = (1.0, 5.0, 10.0, 50.0, 150.0, 1000.0, 25000.0)
"""Seek lengths [um]."""
LONGEST_PROGRAM = 150.0
"""Maximum seek length for which LP is solved [um]."""
CASES = (BASE['final_state'], FAST)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per length."""
    plant, rows = PlantParameters(), []
    times = [runs[case].sample_time for case in CASES]
    for length in LENGTHS:
        optimal = time_optimal_seek(plant, length)
        programs = [1e3 * fastest_seek(plant, time, length).time if length <= LONGEST_PROGRAM else '' for time in times]
        cells = [f'{program:.3f}' if isinstance(program, float) else '' for program in programs]
        rows.append((f'{length:g}', 1e3 * optimal.time, f'{1e-3 * optimal.peak_velocity:.0f}', *cells))
    title = (
        'From rest to rest with sliding friction, |u| <= 10 V. T*: rigid drive, bang-bang control. LP: the least time '
        'after which a sampled command keeps the head within +-100 nm, with the four modes at their nominal '
        'frequencies, and with frequencies 5 % lower and higher.'
    )
    header = ('length [um]', 'T* [ms]', 'peak velocity [mm/s]', 'LP at 10 kHz [ms]', 'LP at 26.4 kHz [ms]')
    return write_table(path, title, header, rows)
