"""The same parameters and seeds give the same bytes, whoever runs the loop and however fast."""

import hashlib
import multiprocessing
from pathlib import Path

import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

TICKS = 2000
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')
IN_NEW_INTERPRETERS = pytest.mark.new_interpreters
"""The one run of its kind that begins and ends as a user's does; the others are copies of a prepared process."""
GOLDEN = Path(__file__).parent / 'golden.yaml'
THESIS_LAW = Path(__file__).parents[2] / 'params' / 'thesis_law.yaml'


def simulate(bench, controller, run='simulated', *arguments):
    bench.run(
        'simulate', *DURATION, '-p', f'controller:={controller}', '-p', f'bag_recorder:run_dir:={run}', *arguments
    )
    return bench.directory / run


def rig(bench, controller, run, *arguments):
    bench.run('rig', *DURATION, '-p', f'rig:controller:={controller}', '-p', f'bag_recorder:run_dir:={run}', *arguments)
    return bench.directory / run


def assert_same(left, right):
    difference = first_difference(left, right)
    assert difference is None, difference
    assert all(
        len(stamps) == TICKS + 1
        for name, (stamps, _) in Run.open(left).messages_by_topic().items()
        if name != '/parameter_events'
    )


@pytest.mark.parametrize('controller', [pytest.param('adaptive_nn', marks=IN_NEW_INTERPRETERS), 'pid'])
def test_rig_twice_paced_and_simulate(bench, controller):
    simulated = simulate(bench, controller, 'simulated', '-p', 'plot:=true')
    drawn = rig(bench, controller, 'first', '-p', 'plot:=true')
    assert_same(simulated, drawn)
    assert all((run / 'run.png').stat().st_size > 10_000 for run in (simulated, drawn))
    assert_same(simulated, rig(bench, controller, 'second'))
    assert_same(simulated, rig(bench, controller, 'paced', '-p', 'deterministic_timer:rate:=0.25'))


@pytest.mark.parametrize(
    ('controller', 'lookahead'),
    [pytest.param('adaptive_nn', 0, marks=IN_NEW_INTERPRETERS), ('pid', 0), ('adaptive_nn', 2), ('pid', 2)],
)
def test_each_node_in_its_own_process(bench, controller, lookahead):
    nodes = ['bag_recorder', f'{controller}_controller', 'ldv_sensor', 'vcm_plant', 'reference_generator']
    processes = bench.start_nodes(
        'processes',
        *DURATION,
        '-p',
        f'deterministic_timer:lookahead:={lookahead}',
        nodes=[*nodes, 'deterministic_timer'],
    )
    for process in processes.values():
        assert process.wait() == 0, process.output
    assert_same(simulate(bench, controller), bench.directory / 'processes')


def spin(stop):
    while not stop.is_set():
        sum(range(1000))


def test_under_load(bench):
    simulated = simulate(bench, 'adaptive_nn')
    context = multiprocessing.get_context('spawn')
    stop = context.Event()
    load = [context.Process(target=spin, args=(stop,)) for _ in range(4)]
    for process in load:
        process.start()
    try:
        in_one = rig(bench, 'adaptive_nn', 'loaded')
        processes = bench.start_nodes('processes', *DURATION)
        for process in processes.values():
            assert process.wait() == 0, process.output
    finally:
        stop.set()
        for process in load:
            process.join()
    assert_same(simulated, in_one)
    assert_same(simulated, bench.directory / 'processes')


def test_sqlite3_holds_the_same(bench):
    assert_same(
        simulate(bench, 'adaptive_nn'), simulate(bench, 'adaptive_nn', 'sqlite3', '-p', 'bag_recorder:storage:=sqlite3')
    )


@pytest.mark.parametrize(
    ('name', 'controller', 'arguments'),
    [
        ('adaptive_nn', 'adaptive_nn', ()),
        ('thesis_law', 'adaptive_nn', ('--params-file', str(THESIS_LAW))),
        ('pid', 'pid', ()),
    ],
)
def test_same_on_every_python_and_machine(bench, name, controller, arguments):
    """
    The digests in golden.yaml were made once; every interpreter and machine must find them again.

    A change of the default drive, sensor, gains or laws changes them, on purpose: then the test's message has the new
    content of the file.
    """
    run = simulate(bench, controller, 'simulated', *arguments)
    digests = {
        topic: hashlib.sha256(b''.join(payloads)).hexdigest()
        for topic, (_, payloads) in Run.open(run).messages_by_topic().items()
        if topic != '/parameter_events'
    }
    golden = yaml.safe_load(GOLDEN.read_text())
    assert golden[name] == digests, f'new digests:\n{yaml.safe_dump({name: digests})}'


def test_another_seed_is_another_run(bench):
    simulated = simulate(bench, 'adaptive_nn')
    other = simulate(bench, 'adaptive_nn', 'other', '-p', 'ldv_sensor:seed:=2')
    difference = first_difference(simulated, other)
    assert difference is not None
    assert difference.startswith('ldv differs first at tick 0: displacement = ')
