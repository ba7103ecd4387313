"""Swept sines of figs. 5.3 and 5.4."""

import math

from hdd_servo_ros.analysis.identification import identify_measured
from hdd_servo_ros.analysis.rational_fit import LEVY, METHODS
from hdd_servo_ros.analysis.transfer_model import Model
from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.recorded_response import response_of_run
from hdd_servo_ros.studies.chapter5.cases import FILE
from hdd_servo_ros.studies.swept_sine import FROM, POLES, ZEROS

SANATHANAN_KOERNER = METHODS[0]

WIDE = Case('swept_sine', 'signal_analyzer', (FILE, 'swept_sine.yaml'))
"""Sweep from 10 Hz to 20 kHz, with a sample time short enough for the fourth mode."""
AMPLITUDES = (0.1, 0.05, 0.03, 0.01)
"""Amplitudes in fig. 5.4 [V]."""


def _low(amplitude: float) -> Case:
    overrides = {
        'deterministic_timer:sample_time': 1e-4,
        'signal_analyzer:stop_frequency': 400.0,
        'signal_analyzer:range_limits': (200.0,),  # a ROS node does not accept an empty list
        'signal_analyzer:points_per_decade': (30,),
        'signal_analyzer:amplitudes': (amplitude,),
    }
    return Case(f'swept_sine_{amplitude:g}_v', 'signal_analyzer', (FILE, 'swept_sine.yaml'), overrides)


LOW = {amplitude: _low(amplitude) for amplitude in AMPLITUDES}
"""Sweeps from 10 to 400 Hz, by amplitude."""


def response(runs: RecordedRuns, case: Case) -> FrequencyResponse:
    """Return the response measured by the analyzer, from the bag."""
    return response_of_run(runs[case])


def identified(measured: FrequencyResponse) -> dict[str, Model]:
    """Return the models by Levy's method and by the iteration, by name of the method, above the range of friction."""
    used = measured.between(FROM, math.inf)
    return {method: identify_measured(used, POLES, ZEROS, method=method) for method in (LEVY, SANATHANAN_KOERNER)}
