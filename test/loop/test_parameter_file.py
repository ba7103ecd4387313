"""Parameter files: what ROS 2 reads in them, and that every key of the shipped ones is known."""

from pathlib import Path

import pytest

from hdd_servo_ros.loop.experiment import Experiment
from hdd_servo_ros.loop.metrics import tracking_metrics
from hdd_servo_ros.loop.parameter_file import read_parameter_files
from hdd_servo_ros.parameters import from_mapping, to_mapping
from hdd_servo_ros.registry import NODE_PARAMETERS

PARAMS = Path(__file__).parents[2] / 'params'


def test_reads_what_ros_reads(tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text(
        '/**/ldv_sensor:\n  ros__parameters:\n    displacement_noise: 1e-3\n    noise: false\n    seed: 7\n'
        'vcm_plant:\n  ros__parameters:\n    gain: 4.0e7\n    friction: {model: none, stiffness: 2.5}\n'
        '    resonance:\n      numerators: [1.0, 2e3, -.5]\n    frame_id: "1e5"\n'
    )
    assert read_parameter_files([file]) == {
        'ldv_sensor': {'displacement_noise': 1e-3, 'noise': False, 'seed': 7},
        'vcm_plant': {
            'gain': 4.0e7,
            'friction.model': 'none',
            'friction.stiffness': 2.5,
            'resonance.numerators': [1.0, 2000.0, -0.5],
            'frame_id': '1e5',
        },
    }


def test_later_files_win(tmp_path):
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text('/**/n:\n  ros__parameters: {a: 1, b: 2}\n')
    second.write_text('/bench1/n:\n  ros__parameters: {b: 3}\n')
    assert read_parameter_files([first, second]) == {'n': {'a': 1, 'b': 3}}


@pytest.mark.parametrize('text', ['', '- a\n', 'n:\n  parameters: {}\n', 'n: 3\n'])
def test_what_is_refused(tmp_path, text):
    file = tmp_path / 'a.yaml'
    file.write_text(text)
    with pytest.raises(ValueError, match=r'a\.yaml'):
        read_parameter_files([file])


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
