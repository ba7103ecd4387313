"""Fig. 5.3: measured and identified frequency response."""

from pathlib import Path

from hdd_servo_ros.bench.response import FrequencyResponse, held
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.bode import bode
from hdd_servo_ros.studies.chapter5.sweeps import SANATHANAN_KOERNER, WIDE, identified, response

CASES = (WIDE,)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the responses of the measurement and of the model."""
    measured = response(runs, WIDE)
    model = identified(measured)[SANATHANAN_KOERNER]
    fitted = model.response(measured.frequency) * held(measured.frequency, measured.hold)
    curves = {'measured': measured, 'identified': FrequencyResponse.of(measured.frequency, fitted)}
    file = path.with_suffix('.png')
    bode(curves, 'Fig. 5.3: measured and identified response').savefig(file, dpi=100)
    return file
