"""Table: gain and modes identified by Levy's method and by the iteration, without and with 1 % noise."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.studies.chapter5.sweeps import WIDE, identified, response
from hdd_servo_ros.studies.swept_sine import compare, with_noise

CASES = (WIDE,)
_NOISE = 0.01
_SEED = 0


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write both tables."""
    measured = response(runs, WIDE)
    plant = block_parameters('vcm_plant', runs.parameters(WIDE)['vcm_plant'])
    parts = {
        'Identified from the swept sine, with vibrometer noise.': identified(measured),
        f'The same with {100.0 * _NOISE:g} % complex noise added to each point.': identified(
            with_noise(measured, _NOISE, _SEED)
        ),
    }
    file = path.with_suffix('.md')
    file.write_text(
        '\n\n'.join(f'{title}\n\n{compare(plant, models)}' for title, models in parts.items()) + '\n', 'utf8'
    )
    return file
