"""Peak sensitivity with the estimates adapted on 2 µm sines, over frequency."""

import math
from pathlib import Path

from hdd_servo_ros.analysis.fragility import MAX_ADAPTED_SENSITIVITY
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.run_sensitivity import RunSensitivity, run_sensitivity
from hdd_servo_ros.studies.baseline.cases import AMPLITUDE, OVER_FREQUENCY
from hdd_servo_ros.studies.output import legend_above, new_figure, save

_SHOWN = ('adaptive NN as shipped', 'law of the thesis')
CASES = tuple(case for name in _SHOWN for case in OVER_FREQUENCY[name].values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw Ms with the final estimates as a line, and the largest Ms during each run as a vertical bar."""
    figure = new_figure(f'Peak sensitivity with the learned estimates frozen, sine of {AMPLITUDE:g} µm', height=5.0)
    axes = figure.subplots()
    for color, name in enumerate(_SHOWN):
        cases = OVER_FREQUENCY[name]
        found = [_sensitivity(runs, case) for case in cases.values()]
        axes.semilogx(list(cases), [each.at_end for each in found], 'o-', markersize=4, color=f'C{color}', label=name)
        axes.vlines(list(cases), [each.at_end for each in found], [each.largest for each in found], color=f'C{color}')
    axes.axhline(MAX_ADAPTED_SENSITIVITY, color='black', linestyle=':', label='limit for learned estimates')
    axes.set_xlabel('frequency [Hz]')
    axes.set_ylabel('Ms')
    axes.set_ylim(bottom=1.0)
    legend_above(axes)
    return save(figure, path)


def _sensitivity(runs: RecordedRuns, case: Case) -> RunSensitivity:
    found = run_sensitivity(runs[case])
    if found is None or not math.isfinite(found.largest):
        raise ValueError(f'{case.name} has no finite peak sensitivity')
    return found
