"""Fig. 5.4: frequency response at low frequency for different amplitudes of the excitation."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.bode import bode
from hdd_servo_ros.studies.chapter5.sweeps import LOW, response

CASES = tuple(LOW.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw gain, phase and coherence."""
    curves = {f'{amplitude:g} V': response(runs, case) for amplitude, case in LOW.items()}
    file = path.with_suffix('.png')
    bode(curves, 'Fig. 5.4: influence of the excitation on the response').savefig(file, dpi=100)
    return file
