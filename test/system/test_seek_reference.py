"""A run whose reference seeks: the same bits however it is run, live changes, and what reports make of it."""

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, POSITION_SENSOR, nodes_of_run
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.reference_period import reference_period
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.signals.reference import Reference, ReferenceParameters

TICKS = 600
SEEKS = {'seek.source': 'random', 'seek.seed': 5, 'seek.longest': 40.0, 'seek.dwell_times': '[0.01]'}
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')
PARAMETERS = (
    *DURATION,
    *('-p', 'reference_generator:waveform:=seek'),
    *(word for name, value in SEEKS.items() for word in ('-p', f'reference_generator:{name}:={value}')),
)
PID = ('-p', 'controller:=pid')


def seek_reference(**values):
    given = {name: [0.01] if name == 'seek.dwell_times' else value for name, value in SEEKS.items()}
    return Reference(from_mapping(ReferenceParameters, {'waveform': 'seek', **given, **values}), 1e-4)


@pytest.mark.parametrize('trajectory', ['minimum_jerk', 'time_optimal'])
def test_the_same_bits_however_it_is_run(bench, trajectory):
    parameters = (*PARAMETERS, '-p', f'reference_generator:seek.trajectory:={trajectory}')
    found = {CONTROLLER: CONTROLLERS['pid'], POSITION_SENSOR: 'ldv_sensor'}
    processes = bench.start_nodes('processes', *parameters, nodes=nodes_of_run(found))
    for process in processes.values():
        assert process.wait() == 0, process.output
    recorded = bench.directory / 'processes'
    block = seek_reference(**{'seek.trajectory': trajectory})
    expected = np.array([block.step(tick) for tick in range(TICKS + 1)])
    np.testing.assert_array_equal(Run.open(recorded).reference, expected)
    for name in ('rig', 'simulate'):
        bench.run(name, *PID, *parameters, '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
    ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded))
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_a_live_change_goes_on_in_time(bench):
    schedule = "['0.025 reference_generator seek.seed 6']"
    changed = ('-p', f'deterministic_timer:schedule:={schedule}')
    for name in ('rig', 'simulate'):
        bench.run(name, *PID, *PARAMETERS, *changed, '-p', f'run_dir:={name}')
    assert first_difference(bench.directory / 'rig', bench.directory / 'simulate') is None
    before, after = seek_reference(), seek_reference(**{'seek.seed': 6})
    expected = [(before if tick < 250 else after).step(tick)[0] for tick in range(TICKS + 1)]
    np.testing.assert_array_equal(Run.open(bench.directory / 'rig').desired_position, expected)


@pytest.mark.parametrize('trajectory', ['step', 'minimum_jerk'])
@pytest.mark.parametrize('repeat', [True, False])
def test_a_report_of_it(bench, trajectory, repeat):
    bench.run(
        'simulate',
        *PID,
        *PARAMETERS,
        *('-p', f'reference_generator:seek.trajectory:={trajectory}', '-p', 'reference_generator:seek.count:=3'),
        *('-p', f'reference_generator:seek.repeat:={str(repeat).lower()}', '-p', 'run_dir:=run'),
    )
    run = Run.open(bench.directory / 'run')
    assert reference_period(run) is None
    values = {metric.name: metric.value for metric in run_metrics(run)}
    if trajectory == 'step':
        # The one of tick 0 too, but not one of the last tick.
        assert values['edges'] == (6 if repeat else 3)
        assert (close_up := close_up_of(run)) is not None
        assert close_up.title == 'last seek that arrives'
    else:
        assert 'edges' not in values
        assert any('the period of the reference is unknown' in line for line in left_out(run))
    assert values['max_error'] > 0.0
    assert len(list(run_panels(run))) > 3


def test_a_seek_without_time_is_rejected_with_its_times(bench):
    ended = bench.start('simulate', *PARAMETERS, '-p', 'reference_generator:seek.acceleration:=1e5')
    assert ended.wait() == 2
    assert 'reference_generator:seek.dwell_times' in ended.output
    assert 'the next seek starts after 0.01 s' in ended.output
