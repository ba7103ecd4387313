"""All metrics of runs of all kinds are among the known names."""

from pathlib import Path

import pytest

from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.reporting.metric_names import METRIC_NAMES
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.simulation.in_memory import run_in_memory
from hdd_servo_ros.simulation.run_setup import Simulation

PARAMS = Path(__file__).parents[2] / 'params'


def metrics(files, *parameters):
    arguments = ['--ros-args']
    for file in files:
        arguments += ['--params-file', str(PARAMS / file)]
    for parameter in parameters:
        arguments += ['-p', parameter]
    return [metric.name for metric in run_metrics(run_in_memory(Simulation(parse_ros_arguments(arguments))))]


KINDS = {
    'sine': (['seagate_7200_10.yaml'], 'deterministic_timer:duration:=0.3'),
    'pid': (['seagate_7200_10.yaml'], 'deterministic_timer:duration:=0.3', 'rig:controller:=pid'),
    'steps': (
        ['seagate_7200_10.yaml'],
        'deterministic_timer:duration:=0.1',
        'reference_generator:waveform:=square',
        'reference_generator:frequency:=50.0',
    ),
    'seeks': (['seagate_7200_10.yaml', 'seek.yaml'],),
    'modes': (['seagate_7200_10.yaml', 'seek.yaml'], 'seek_controller:seek.method:=ptos'),
    'estimates': (['seagate_7200_10.yaml', 'thesis_law.yaml'], 'deterministic_timer:duration:=0.1'),
    'stops': (
        ['seagate_7200_10.yaml'],
        'deterministic_timer:duration:=0.1',
        'vcm_plant:travel.lower:=-1.0',
        'vcm_plant:travel.upper:=1.0',
    ),
    'bound': (
        ['seagate_7200_10.yaml', 'nss_100ktpi.yaml'],
        'rig:controller:=pid',
        'deterministic_timer:duration:=3.0000168',
    ),
    'track': (['seagate_7200_10.yaml', 'nss_100ktpi.yaml', 'mobile_car.yaml'], 'rig:controller:=pid'),
}


@pytest.fixture(scope='module')
def found():
    return {kind: metrics(*arguments) for kind, arguments in KINDS.items()}


@pytest.mark.parametrize('kind', KINDS)
def test_every_metric_is_known(found, kind):
    assert set(found[kind]) <= set(METRIC_NAMES)


def test_every_known_name_is_that_of_a_metric(found):
    assert set().union(*found.values()) == set(METRIC_NAMES)


def test_no_name_is_there_twice():
    assert len(set(METRIC_NAMES)) == len(METRIC_NAMES)


def test_every_metric_is_defined_in_the_reference():
    page = (PARAMS.parent / 'docs' / 'reference' / 'metrics.md').read_text('utf8')
    assert [name for name in METRIC_NAMES if f'`{name}`' not in page] == []
