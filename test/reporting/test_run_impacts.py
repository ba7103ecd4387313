"""The impacts on the crash stops of a recorded run are those that the drive has counted."""

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.reporting.run_impacts import run_impacts, why_no_impacts
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.simulation.experiment import Experiment

TICKS = 300
SECTIONS: dict[str, dict[str, object]] = {
    'reference_generator': {'waveform': 'step', 'amplitude': 8.0},
    'vcm_plant': {'travel.lower': -5.0, 'travel.upper': 5.0},
    'disturbance_generator': {'force_noise.enabled': True, 'force_noise.sigma': 0.1},
}
ARGUMENTS = ('-p', f'duration:={TICKS / 10_000}', '-p', 'controller:=pid')


def given(sections):
    lines = (f'{node}:{name}:={value}' for node, values in sections.items() for name, value in values.items())
    return [word for line in lines for word in ('-p', line.replace('True', 'true'))]


def values(run):
    return {metric.name: metric.value for metric in run_metrics(run)}


def test_they_are_those_of_the_drive(simulated, tmp_path):
    experiment = Experiment(1e-4, 'pid', SECTIONS)
    experiment.run(0, TICKS + 1)
    counted = experiment.plant.impacts
    assert counted['upper'].count > 1
    run = Run.open(simulated(tmp_path / 'run', *ARGUMENTS, *given(SECTIONS)))
    assert run_impacts(run) == counted
    assert values(run)['stop_impacts'] == counted['upper'].count
    assert values(run)['largest_impact_speed'] == counted['upper'].largest_speed


def test_stops_that_are_not_hit_and_a_drive_without_stops(simulated, tmp_path):
    quiet = {**SECTIONS, 'reference_generator': {'amplitude': 1.0}}
    run = Run.open(simulated(tmp_path / 'quiet', *ARGUMENTS, *given(quiet)))
    assert values(run)['stop_impacts'] == 0.0
    assert 'largest_impact_speed' not in values(run)
    free = Run.open(simulated(tmp_path / 'free', *ARGUMENTS))
    assert 'stop_impacts' not in values(free)
    assert why_no_impacts(free) == ''


@pytest.mark.parametrize(
    ('arguments', 'why'),
    [
        (('-p', "deterministic_timer:schedule:=['0.01 vcm_plant gain 4e7']"), 'parameters of vcm_plant were changed'),
        (('-p', "bag_recorder:topics:=['reference', 'head', 'ldv']"), 'the bag has no /control'),
    ],
)
def test_why_they_are_not_known(simulated, tmp_path, arguments, why):
    run = Run.open(simulated(tmp_path / 'run', *ARGUMENTS, *given(SECTIONS), *arguments))
    assert 'stop_impacts' not in values(run)
    assert any(line.startswith(f'no impacts on the crash stops: {why}') for line in left_out(run))
