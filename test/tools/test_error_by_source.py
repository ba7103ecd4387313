"""Contribution of each source to the error of a recorded run, compared with separate experiments without it."""

import shutil
from typing import Any

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.graph.error_sources import error_sources
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.tools.error_by_source import error_by_source_of_run
from hdd_servo_ros.tools.report import main

T = 1e-4
TICKS = 6000
ARGUMENTS = (
    *('-p', f'duration:={TICKS * T!r}', '-p', 'controller:=pid', '-p', 'waveform:=constant', '-p', 'amplitude:=0.0'),
    *('-p', 'disturbance_generator:vibration.rotational.enabled:=true'),
    *('-p', 'disturbance_generator:flutter.enabled:=true'),
)


@pytest.fixture(scope='module')
def run(tmp_path_factory, simulated):
    return Run.open(simulated(tmp_path_factory.mktemp('by_source') / 'run', *ARGUMENTS))


def late_error(run, **changes):
    """Return the track error of the last half of the run with other parameters, from a separate experiment."""
    sections = {name.lstrip('/'): dict(node['parameters']) for name, node in run.description['nodes'].items()}
    for key, value in changes.items():
        node, name = key.split('__')
        sections[node][name.replace('_dot_', '.')] = value
    sections = {
        node: values for node, values in sections.items() if node not in ('deterministic_timer', 'bag_recorder')
    }
    rows = Experiment(T, 'pid', sections).run(0, TICKS + 1)
    return (rows.position - rows.desired_position - rows.disturbance.track_center)[TICKS // 2 :]


def test_contributions_are_differences_of_variances(run):
    found = error_by_source_of_run(run)
    complete = late_error(run)
    assert found.total == pytest.approx(3.0 * np.std(complete), rel=1e-3)
    off = {
        'vibration.rotational': {'disturbance_generator__vibration_dot_rotational_dot_enabled': False},
        'flutter': {'disturbance_generator__flutter_dot_enabled': False},
        'sensor noise': {'ldv_sensor__noise': False},
    }
    assert [*off, 'rest'] == sorted(found.contributions, key=[*off, 'rest'].index)
    for source, changes in off.items():
        share = np.var(complete) - np.var(late_error(run, **changes))
        assert found.contributions[source] == pytest.approx(3.0 * np.sign(share) * np.sqrt(abs(share)), rel=1e-3)


def test_the_report_has_them_as_table_and_bars(run, tmp_path, capsys):
    assert main([str(run.path), '--by-source', '--output', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'track error from vibration.rotational, 3 sigma [nm]' in printed
    content = yaml.safe_load((tmp_path / 'metrics.yaml').read_text())['metrics']
    found = error_by_source_of_run(run).contributions
    assert content['error_from_flutter']['value'] == pytest.approx(1e3 * found['flutter'])
    assert content['error_from_rest'] == {'value': pytest.approx(1e3 * found['rest']), 'unit': 'nm'}
    assert 'Track error by source' in (tmp_path / 'report.html').read_text()
    assert main([str(run.path), '--output', str(tmp_path)]) == 0
    assert 'error_from_flutter' not in yaml.safe_load((tmp_path / 'metrics.yaml').read_text())['metrics']


def test_a_source_that_a_schedule_switches_on_is_off_all_along_without_it(tmp_path, simulated):
    schedule = (
        "['0.1 disturbance_generator flutter.enabled true', '0.1 disturbance_generator force_noise.enabled true']"
    )
    quiet = ('-p', 'disturbance_generator:flutter.enabled:=false', '-p', f'deterministic_timer:schedule:={schedule}')
    path = simulated(tmp_path / 'run', *ARGUMENTS[:8], *quiet, '-p', 'ldv_sensor:noise:=false')
    found = error_by_source_of_run(Run.open(path))
    assert set(found.contributions) == {'flutter', 'force_noise', 'rest'}
    # Without flutter there is the force noise alone, and the other way round.
    squares = {name: value**2 for name, value in found.contributions.items()}
    assert squares['flutter'] + squares['force_noise'] == pytest.approx(found.total**2, rel=0.05)


def test_the_servo_sensor_and_the_accelerometers_have_noise_too():
    nodes: dict[str, dict[str, Any]] = {
        'servo_sensor': {'noise': 0.003},
        'accelerometer': {'noise': 0.0125},
        'disturbance_generator': {'shock.enabled': True, 'flutter.enabled': False},
        'pid_controller': {'feedforward.method': 'fixed'},
    }
    assert error_sources(nodes) == {
        'shock': ('disturbance_generator', 'shock.enabled', False),
        'sensor noise': ('servo_sensor', 'noise', 0.0),
        'accelerometer noise': ('accelerometer', 'noise', 0.0),
    }
    nodes['pid_controller']['feedforward.method'] = 'none'
    assert 'accelerometer noise' not in error_sources(nodes)
    assert 'flutter' in error_sources(nodes, [('disturbance_generator', 'flutter.enabled', True)])


def rejected(capsys, path, *text):
    capsys.readouterr()
    assert main([str(path), '--by-source']) == 3
    printed = capsys.readouterr().err
    assert printed.count('\n') == 1
    for part in text:
        assert part in printed


def test_what_cannot_be_run_again_is_rejected_in_a_line(run, tmp_path, capsys, simulated):
    other = tmp_path / 'other'
    shutil.copytree(run.path, other)
    description = yaml.safe_load((other / 'run.yaml').read_text())
    description['nodes']['/disturbance_generator']['parameters']['vibration.rotational.rms'] = 12.6
    (other / 'run.yaml').write_text(yaml.safe_dump(description))
    rejected(capsys, other, 'differs from the recording', f'replay {other}')
    (other / 'run.yaml').unlink()
    rejected(capsys, other, 'run.yaml')
    short = ('-p', 'duration:=0.02')
    open_loop = simulated(tmp_path / 'open_loop', *short, '-p', 'controller:=open_loop')
    rejected(capsys, open_loop, 'the head follows no reference')
    silent = simulated(tmp_path / 'silent', *short, '-p', 'ldv_sensor:noise:=false')
    rejected(capsys, silent, 'no error source is enabled')
