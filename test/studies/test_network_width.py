"""What the network of section 4.4 takes off the error depends on the width, which the thesis does not give."""

import re
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.experiment import Experiment

ROOT = Path(__file__).parents[2]
SECTIONS = read_parameter_files([ROOT / 'params' / 'simulation_study.yaml'])
TICKS = 200_001


def errors(**changes: object) -> float:
    """Return the rms error of the last half of 20 s [mm]."""
    own = {f'network.{name}': value for name, value in changes.items()}
    controller = {**SECTIONS['adaptive_nn_controller'], **own}
    rows = Experiment(1e-4, 'adaptive_nn', {**SECTIONS, 'adaptive_nn_controller': controller}).run(0, TICKS)
    late = rows.head[TICKS // 2 :, 0] - rows.reference[TICKS // 2 :, 0]
    return 1e3 * float(np.sqrt(np.mean(late**2)))


def test_the_page_has_the_error_over_the_width() -> None:
    text = (ROOT / 'docs' / 'results' / 'thesis.md').read_text('utf8')
    table = text.split('| width (chosen) |')[1].split('\n\n')[0]
    rows = re.findall(r'^\| \**([\d.]+)\** \| ([\d.]+) \| ([\d.]+) % \|', table, flags=re.MULTILINE)
    assert [float(width) for width, _, _ in rows] == [0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0]
    without = errors(enabled=False)
    for width, error, share in rows:
        if float(width) in (1.0, 3.0, 10.0):
            found = errors(width=(float(width),))
            assert found == pytest.approx(float(error), abs=1e-3)
            assert 100.0 * (1.0 - found / without) == pytest.approx(float(share), rel=0.05)
