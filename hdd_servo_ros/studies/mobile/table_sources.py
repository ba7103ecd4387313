"""Table: contribution of each disturbance source to the track error, from runs without the source."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.sources import CASES_BY_NAME, SEEDS, contributions
from hdd_servo_ros.studies.output import write_table

CASES = tuple(CASES_BY_NAME.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per run, and one column per source."""
    found = contributions(runs, SEEDS)
    sources = list(dict.fromkeys(source for each in found.values() for source in each.by_source if source != 'rest'))
    columns = (*sources, 'rest')
    rows = [
        (name, f'{each.total:.3g}', *(f'{each.by_source[s]:.2g}' if s in each.by_source else '' for s in columns))
        for name, each in found.items()
    ]
    title = (
        'PID: 3 sigma of the track error [nm], and contribution of each source: the root of the difference of the '
        f'variances with and without it, over {SEEDS} seeds. Negative: the error is larger without this source. '
        'Rest: the part that no source accounts for.'
    )
    return write_table(path, title, ('', 'all', *columns), rows)
