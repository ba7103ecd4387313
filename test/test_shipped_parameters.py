"""The shipped parameter files: every key is known, and the numbers do what they are shipped for."""

from pathlib import Path

import pytest

from hdd_servo_ros.loop.experiment import Experiment
from hdd_servo_ros.loop.metrics import tracking_metrics
from hdd_servo_ros.parameter_files import read_parameter_files
from hdd_servo_ros.parameters import from_mapping, to_mapping
from hdd_servo_ros.registry import NODE_PARAMETERS

PARAMS = Path(__file__).parents[1] / 'params'


@pytest.mark.parametrize('file', sorted(PARAMS.glob('*.yaml')), ids=lambda file: file.stem)
def test_every_key_of_the_shipped_files_is_known(file):
    for node, values in read_parameter_files([file]).items():
        kinds = NODE_PARAMETERS[node]
        names = [set(to_mapping(kind())) for kind in kinds]
        for name in values:
            assert any(name in known for known in names), f'{node}: {name}'
        for kind, known in zip(kinds, names, strict=True):
            from_mapping(kind, {name: value for name, value in values.items() if name in known})


def test_the_drive_of_chapter_5_is_the_default():
    for node, values in read_parameter_files([PARAMS / 'seagate_7200_10.yaml']).items():
        for kind in NODE_PARAMETERS[node]:
            default = to_mapping(kind())
            given = {name: value for name, value in values.items() if name in default}
            assert to_mapping(from_mapping(kind, given)) == default


def test_section_4_4():
    """The ranges that an independent implementation found for section 4.4: rms and largest error of the last half."""
    sections = read_parameter_files([PARAMS / 'simulation_study.yaml'])
    rows = Experiment(1e-4, 'adaptive_nn', sections).run(0, 200001)
    found = tracking_metrics(
        rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient=10.0, unit=1.0
    )
    assert 0.0027 < found.rms_error < 0.0041
    assert 0.0055 < found.max_error < 0.0083
    assert abs(rows.estimate('m_hat')[100000:].mean() - 1.0) < 0.05
    pid = Experiment(1e-4, 'pid', sections).run(0, 200001)
    compared = tracking_metrics(pid.time, pid.reference[:, 0], pid.head[:, 0], pid.control[:, 0], 10.0, 1.0)
    assert compared.peak_control <= 1.001 * found.peak_control
    assert compared.rms_error > 20.0 * found.rms_error
