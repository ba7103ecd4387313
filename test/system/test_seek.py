"""A run that seeks: the same bits in separate processes, in `rig`, in `simulate`, replayed; assertions on its bag."""

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.simulation.run_setup import Simulation

SEEKING = (
    *('-p', 'duration:=0.1', '-p', 'controller:=seek', '-p', 'plot:=false'),
    *('-p', 'reference_generator:waveform:=seek', '-p', 'reference_generator:seek.trajectory:=step'),
    *('-p', 'reference_generator:seek.targets:=[20.0, 0.0, 60.0, 55.0]'),
    *('-p', 'reference_generator:seek.dwell_times:=[0.02]'),
    *('-p', 'ldv_sensor:displacement_scale:=30.0', '-p', 'ldv_sensor:velocity_scale:=30000.0'),
)
SCHEDULE = (
    '-p',
    "schedule:=['0.03 seek_controller seek.control_limit 4.0', '0.0403 seek_controller seek.learning.gain_memory 0.2',"
    " '0.0405 seek_controller seek.friction.coulomb_level 0.12', '0.0405 seek_controller seek.learning.gain false']",
)
METHODS = {
    'final_state': (CONTROLLERS['seek'], *SEEKING, *SCHEDULE),
    'ptos': (CONTROLLERS['seek'], *SEEKING, '-p', 'seek_controller:seek.method:=ptos'),
    'cnf, late, around the adaptive NN controller': (
        CONTROLLERS['adaptive_nn'],
        *SEEKING,
        *('-p', 'controller:=adaptive_nn', '-p', 'adaptive_nn_controller:seek.method:=cnf'),
    ),
}


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    experiment = Simulation(parse_ros_arguments(['--ros-args', *SEEKING])).experiment
    experiment.run(0, 2)
    assert experiment.seek is not None
    experiment.seek.after_law(0.0, 0.0, 0.0)


@pytest.mark.parametrize('method', METHODS)
def test_the_same_bits_however_it_is_run(bench, method):
    controller, *arguments = METHODS[method]
    for name in ('simulate', 'rig'):
        bench.run(name, *arguments, '-p', f'run_dir:={name}')
    nodes = bench.start_nodes('processes', *arguments, nodes=nodes_of_run({CONTROLLER: controller}))
    for process in nodes.values():
        assert process.wait() == 0, process.output
    simulated = bench.directory / 'simulate'
    for run in ('rig', 'processes'):
        assert first_difference(simulated, bench.directory / run) is None
    recorded = Run.open(bench.directory / 'rig')
    modes = recorded.estimates['seek_mode']
    assert set(modes.tolist()) == {0.0, 1.0, 2.0}
    assert np.count_nonzero(np.diff(modes) == 1.0) >= 4
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'rig', '--without-ros')
    assert 'bit-identical on every topic, ticks 0 to 1000' in answer.stdout, answer.stdout + answer.stderr
    if method == 'final_state':
        # The third seek starts under the new limit, the fourth one without an estimated gain.
        assert abs(recorded.control.voltage[400:600]).max() < 4.5 < abs(recorded.control.voltage[:300]).max()
        assert set(recorded.estimates['seek_gain'][600:].tolist()) == {1.0}


@pytest.mark.parametrize('kind', ['pid', 'adaptive_nn', 'seek'])
def test_a_controller_from_python_seeks_as_the_compiled_loop_does(kind):
    arguments = [
        '--ros-args',
        *SEEKING,
        '-p',
        f'controller:={kind}',
        '-p',
        f'{kind}_controller:seek.method:=final_state',
    ]
    whole, stepped = (Simulation(parse_ros_arguments(arguments)).experiment for _ in range(2))
    stepped._kind = None  # the path of a controller that is called tick by tick
    rows, found = whole.run(0, 700), stepped.run(0, 700)
    for topic in ('head', 'control', 'estimates'):
        assert rows[topic].tobytes() == found[topic].tobytes(), topic


def test_an_outside_controller_is_wrapped_as_well(bench):
    ran = bench.run(
        'simulate',
        *SEEKING,
        *(
            '-p',
            'controller:=hdd_servo_ros.control.pid:Pid',
            '-p',
            'run_dir:=outside',
            '-p',
            'seek.method:=final_state',
        ),
    )
    assert 'seeks' in ran.output
    run = Run.open(bench.directory / 'outside')
    assert 'seek_mode' in run.estimate_names
    assert abs(run.head.position[180:200] - 20.0).max() < 0.1


@pytest.mark.parametrize('name', ['simulate', 'rig'])
@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (
            ('-p', 'controller:=open_loop', '-p', 'open_loop_controller:seek.method:=ptos'),
            "seek.method: 'ptos'; expected none, because this controller does not follow the reference",
        ),
        (
            ('-p', 'seek_controller:seek.model.numerators:=[1.0, 2.0]'),
            'seek.model.numerators: (1.0, 2.0); expected as many numbers as denominators, which has 12',
        ),
        (
            ('-p', 'vcm_plant:length_unit:=m'),
            "seek.method: 'final_state'; expected none with a drive in m and V",
        ),
    ],
)
def test_what_does_not_go_together_is_rejected_in_one_line(bench, name, arguments, message):
    rejected = bench.start(name, *SEEKING, *arguments)
    assert rejected.wait() != 0
    assert message in rejected.output
    assert 'Traceback' not in rejected.output
