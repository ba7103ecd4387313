"""A run with filters after the law: the same bits in separate processes, in `rig`, in `simulate` and replayed."""

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.reporting.run_sensitivity import run_sensitivity
from hdd_servo_ros.simulation import Experiment

TICKS = 400
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    Experiment(1e-4, 'pid', {'pid_controller': {'dsp.updates_per_sample': 2}}).run(0, 2)


def arguments(node):
    values = {
        'updates_per_sample': 2,
        'filters.notch.frequencies': '[5476.0,6494.0]',
        'filters.notch.dampings': '[0.1,0.2]',
        'filters.lead.frequencies': '[1500.0]',
    }
    dsp = [part for name, value in values.items() for part in ('-p', f'{node}:dsp.{name}:={value}')]
    changes = (
        f"'0.01 {node} dsp.filters.notch.dampings [0.3]'",
        f"'0.02 {node} dsp.filters.low_pass.frequencies [4000.0]'",
        f"'0.025 {node} dsp.filters.lead.frequencies []'",
    )
    return (*DURATION, *dsp, '-p', f'schedule:=[{", ".join(changes)}]')


@pytest.mark.parametrize('controller', ['pid', 'adaptive_nn'])
def test_the_same_bits_however_it_is_run(bench, controller):
    node = CONTROLLERS[controller]
    given = arguments(node)
    for process in bench.start_nodes('processes', *given, nodes=nodes_of_run({CONTROLLER: node})).values():
        assert process.wait() == 0, process.output
    recorded = bench.directory / 'processes'
    for name in ('rig', 'simulate'):
        bench.run(name, *given, '-p', f'controller:={controller}', '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
    for how in ((), ('--without-ros',)):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded), *how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert f'ticks 0 to {TICKS}' in ended.stdout
    changes = Run.open(recorded).parameter_changes
    assert [change.name for change in changes if 'filters' in change.name] == [
        'dsp.filters.notch.dampings',
        'dsp.filters.low_pass.frequencies',
        'dsp.filters.lead.frequencies',
    ]


def test_the_margin_of_a_run_includes_its_filters(bench):
    low_pass = ('-p', 'pid_controller:dsp.filters.low_pass.frequencies:=[1500.0]')
    for name, given in (('plain', ()), ('filtered', low_pass)):
        bench.run('simulate', *DURATION, '-p', 'controller:=pid', *given, '-p', f'run_dir:={name}')
    plain, filtered = (run_sensitivity(Run.open(bench.directory / name)) for name in ('plain', 'filtered'))
    assert plain is not None
    assert filtered is not None
    assert filtered.largest > plain.largest


@pytest.mark.parametrize('name', ['rig', 'simulate'])
def test_a_frequency_above_the_nyquist_frequency_is_rejected(bench, name):
    filters = ('-p', 'pid_controller:dsp.filters.notch.frequencies:=[5476.0]')
    process = bench.start(name, *DURATION, '-p', 'controller:=pid', *filters)
    assert process.wait() != 0, process.output
    assert 'dsp.filters.notch.frequencies' in process.output
    assert 'each below the Nyquist frequency of the filters, 5000 Hz' in process.output
