"""Each way to go wrong ends the run soon, with one error that names what and when, and a readable bag."""

import os
import signal
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Vector3Stamped

from hdd_servo_ros import Run

HERE = Path(__file__).parent
BYTES_OF_SOME_TICKS = 50_000  # a tick has some 840; what the bag begins with, some 10,000
SLOW = ('-p', 'deterministic_timer:rate:=0.02', '-p', 'deterministic_timer:duration:=10.0')
"""A run that goes on long enough to be disturbed, and leaves the machine idle."""
PATIENCE = ('-p', 'start_timeout:=6.0')
"""For runs that fail before they begin: a node that is only coming up then is left waiting for peers."""
OTHERS = ('bag_recorder', 'ldv_sensor', 'vcm_plant', 'reference_generator', 'deterministic_timer')


def expect_failure(bench, processes, *words, within=100.0):
    """Wait for the end of all; exit codes 1, the words in one line of each, the bag readable up to the last tick."""
    started = time.monotonic()
    for process in processes.values():
        assert process.wait(within + 5.0) == 1, f'{process.name}:\n{process.output}'
    # The run ends within 5 s of the fault on an idle machine, and would otherwise last 500 s.
    assert time.monotonic() - started < within
    for process in processes.values():
        lines = [line for line in process.output.splitlines() if 'run failed' in line and 'ERROR' in line]
        assert len(lines) == 1, process.output
    assert any(all(word in process.output for word in words) for process in processes.values()), [
        process.output for process in processes.values()
    ]


def expect_bag(bench, run='run'):
    content = bench.run_yaml(run)
    assert content['status'] == 'failed'
    assert content['reason']
    signals = Run.open(bench.directory / run)
    assert len(signals.time) == content['last_tick'] + 1
    return content


def wait_for_ticks(bench, run='run'):
    """Wait until the run is under way, and some of its ticks are in the bag."""
    deadline = time.monotonic() + 200.0
    while sum(file.stat().st_size for file in (bench.directory / run / 'bag').glob('*.mcap')) < BYTES_OF_SOME_TICKS:
        assert time.monotonic() < deadline, [(p.name, p.output) for p in bench.processes]
        time.sleep(0.02)


def test_missing_peer(bench):
    nodes = [node for node in (*OTHERS, 'adaptive_nn_controller') if node != 'ldv_sensor']
    processes = bench.start_nodes('run', '-p', 'start_timeout:=3.0', nodes=nodes)
    for process in processes.values():
        assert process.wait() == 1, process.output
    assert 'ldv_sensor (nobody publishes /ldv)' in processes['adaptive_nn_controller'].output
    assert 'start_timeout' in processes['adaptive_nn_controller'].output
    assert not (bench.directory / 'run').exists()


def test_waiting_names_the_missing(bench):
    process = bench.start('vcm_plant')
    process.wait_for('waiting for deterministic_timer')
    assert 'nobody publishes /control' in process.output
    process.signal(signal.SIGINT)
    assert process.wait() == 130


@pytest.mark.parametrize(
    'victim', ['ldv_sensor', 'reference_generator', 'adaptive_nn_controller', 'deterministic_timer']
)
def test_peer_dies(bench, victim):
    processes = bench.start_nodes('run', *SLOW)
    wait_for_ticks(bench)
    processes.pop(victim).signal(signal.SIGKILL)
    expect_failure(bench, processes, victim, 'tick')
    assert victim in expect_bag(bench)['reason']


def test_a_node_that_is_killed_before_the_run_may_be_started_again(bench):
    nodes = [node for node in (*OTHERS, 'adaptive_nn_controller') if node != 'deterministic_timer']
    processes = bench.start_nodes('run', '-p', 'deterministic_timer:duration:=0.01', nodes=nodes)
    processes['adaptive_nn_controller'].wait_for('waiting for deterministic_timer')
    processes.pop('ldv_sensor').signal(signal.SIGKILL)
    bench.interpreters = None  # as long as a new one takes to start, the others take to see that the first node is gone
    again = bench.start_nodes('run', '-p', 'duration:=0.01', nodes=['ldv_sensor', 'deterministic_timer'])
    for process in [*processes.values(), *again.values()]:
        assert process.wait() == 0, process.output


def test_a_writer_that_takes_nothing_ends_the_run(bench):
    # Long enough at full speed, on any machine, for the writer to be stopped in.
    full_speed = ('-p', 'deterministic_timer:rate:=0.0', '-p', 'deterministic_timer:duration:=300.0')
    process = bench.start('rig', *SLOW, *full_speed, '-p', 'bag_recorder:run_dir:=run')
    wait_for_ticks(bench)
    (writer,) = Path(f'/proc/{process.popen.pid}/task/{process.popen.pid}/children').read_text().split()
    os.kill(int(writer), signal.SIGSTOP)
    assert process.wait() == 1
    assert 'the bag writer accepted no data for' in process.output
    assert bench.run_yaml('run')['status'] == 'failed'


def test_parameters_set_before_the_run_are_in_run_yaml(bench):
    nodes = ('bag_recorder', 'ldv_sensor', 'vcm_plant', 'adaptive_nn_controller', 'reference_generator')
    processes = bench.start_nodes('run', nodes=nodes)
    processes['reference_generator'].wait_for('waiting for deterministic_timer')
    assert bench.python(str(HERE / 'set_parameter.py'), '/reference_generator', 'frequency', '250.0').returncode == 0
    processes['deterministic_timer'] = bench.start('deterministic_timer', '-p', 'duration:=0.01')
    for process in processes.values():
        assert process.wait() == 0, process.output
    assert bench.run_yaml('run')['nodes']['/reference_generator']['parameters']['frequency'] == 250.0
    slope = Run.open(bench.directory / 'run').reference[0, 1]
    assert slope == pytest.approx(2.0 * 2.0 * 3.141592653589793 * 250.0)


def test_recorder_dies(bench):
    processes = bench.start_nodes('run', *SLOW)
    wait_for_ticks(bench)
    processes.pop('bag_recorder').signal(signal.SIGKILL)
    expect_failure(bench, processes, 'bag_recorder', 'tick')
    assert bench.run_yaml('run')['status'] == 'running'  # never looks complete


def test_two_publishers_from_the_start(bench):
    """Of the two sensors one ends alone, before it publishes anything; the others do not notice."""
    processes = bench.start_nodes('run', '-p', 'deterministic_timer:duration:=0.01')
    second = bench.start('ldv_sensor', '-p', 'start_timeout:=6.0')
    first = processes.pop('ldv_sensor')
    for process in processes.values():
        assert process.wait() == 0, process.output
    assert {first.wait(), second.wait()} == {0, 1}
    rejected = first if first.wait() else second
    assert 'run failed: /ldv is published by process' in rejected.output or 'run is in progress' in rejected.output


def test_second_publisher_during_the_run(bench, outside):
    processes = bench.start_nodes('run', *SLOW)
    wait_for_ticks(bench)
    # One of our own sensors would end for joining after the start, perhaps before anybody has seen it.
    outside.create_publisher(Vector3Stamped, '/ldv', 10)
    expect_failure(bench, processes, '/ldv has 2 publishers', '/outside', 'tick')
    expect_bag(bench)


@pytest.mark.parametrize('node', ['ldv_sensor', 'vcm_plant'])
def test_mismatched_sample_time(bench, node):
    processes = bench.start_nodes('run', '-p', f'{node}:sample_time:=0.0002', *PATIENCE)
    expect_failure(bench, processes, node, 'sample_time: 0.0002 s', '0.0001 s')


@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ('not_finite', ('/control', 'not finite', 'tick 300')),
        ('repeat', ('/control', 'expected tick 301, got tick 300', 'out of order')),
        ('skip', ('/control', 'expected tick 301, got tick 302')),
        ('exception', ('tick 300', 'ZeroDivisionError')),
    ],
)
def test_misbehaving_controller(bench, fault, words):
    processes = bench.start_nodes('run', nodes=OTHERS)
    script = HERE / 'misbehaving_controller.py'
    processes['misbehaving'] = bench.start('misbehaving_controller', '-p', f'fault:={fault}', script=script)
    expect_failure(bench, processes, *words)
    # With the clock ahead of the loop the other topics have a tick or two more; the bag ends with the last whole one.
    assert 297 <= expect_bag(bench)['last_tick'] <= 300


def test_controller_that_never_answers(bench):
    processes = bench.start_nodes('run', nodes=OTHERS)
    stuck = bench.start('misbehaving_controller', '-p', 'fault:=silence', script=HERE / 'misbehaving_controller.py')
    # Who is the first to miss it, and for want of which message, is chance: /control of tick 300, or what follows it.
    expect_failure(bench, processes, '/misbehaving_controller; /', 'is missing for tick 30')
    expect_bag(bench)
    for _ in range(2):  # the second one, when the first had its time, is for a node whose step never returns
        stuck.signal(signal.SIGTERM)
        time.sleep(2.2)
    assert stuck.wait() == -signal.SIGTERM


def test_bad_parameter(bench):
    process = bench.start('vcm_plant', '-p', 'substeps:=-1')
    assert process.wait() == 2
    assert 'substeps: -1;' in process.output


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (('-p', 'gain:=1.0'), 'unrecognized arguments: -p gain:=1.0; put ROS arguments after --ros-args'),
        (('--ros-args', '--bogus'), "unknown ROS argument '--bogus'"),
        (('--ros-args', '-p', 'gain'), "-p 'gain' is not NODE:PARAMETER:=VALUE or PARAMETER:=VALUE"),
        (('--ros-args', '--params-file', 'missing.yaml'), 'parameter file missing.yaml: '),
    ],
)
def test_wrong_arguments(bench, arguments, said):
    answer = bench.python('-m', 'hdd_servo_ros.nodes.vcm_plant', *arguments)
    assert answer.returncode == 2
    assert said in answer.stderr
    assert 'Traceback' not in answer.stderr


def test_unknown_parameter(bench):
    process = bench.start('ldv_sensor', '-p', 'sede:=3')
    assert process.wait() == 2
    assert 'unknown parameter sede; did you mean seed?' in process.output


def test_run_folder_is_never_overwritten(bench):
    short = ('-p', 'deterministic_timer:duration:=0.01', '-p', 'bag_recorder:run_dir:=run')
    bench.run('rig', *short)
    before = (bench.directory / 'run' / 'run.yaml').read_bytes()
    again = bench.start('rig', *short)
    assert again.wait() == 2
    assert 'never overwritten' in again.output
    simulated = bench.start('simulate', *short)
    assert simulated.wait() == 2
    assert 'never overwritten' in simulated.output
    assert (bench.directory / 'run' / 'run.yaml').read_bytes() == before


@pytest.mark.parametrize(('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_interrupted_rig(bench, number, code):
    process = bench.start('rig', *SLOW, '-p', 'bag_recorder:run_dir:=run')
    wait_for_ticks(bench)
    process.signal(number)
    time.sleep(0.05)
    process.signal(number)  # as `ros2 launch` repeats what the terminal has sent to all already
    assert process.wait() == code
    content = bench.run_yaml('run')
    assert content['status'] == 'interrupted'
    assert signal.Signals(number).name in content['reason']
    assert len(Run.open(bench.directory / 'run').time) == content['last_tick'] + 1 > 1


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_after_the_run_changes_nothing(bench, number):
    """It ends the summary at most."""
    process = bench.start('rig', '-p', 'duration:=0.01', '-p', 'bag_recorder:run_dir:=run')
    folder = bench.directory / 'run'
    while not (folder / 'run.yaml').exists() or bench.run_yaml('run')['status'] == 'running':
        assert process.popen.poll() is None, process.output
        time.sleep(0.001)
    process.signal(number)
    assert process.wait() == 0, process.output
    assert bench.run_yaml('run')['status'] == 'finished'


@pytest.mark.parametrize('who', ['bag_recorder', 'vcm_plant', 'all'])
def test_interrupted_processes(bench, who):
    processes = bench.start_nodes('run', *SLOW)
    wait_for_ticks(bench)
    for name, process in processes.items():
        if who in (name, 'all'):
            process.signal(signal.SIGINT)
    for process in processes.values():
        assert process.wait() == 130, process.output
    content = bench.run_yaml('run')
    assert content['status'] == 'interrupted'
    assert len(Run.open(bench.directory / 'run').time) == content['last_tick'] + 1 > 1


def test_killed_rig_leaves_a_readable_bag(bench):
    process = bench.start('rig', *SLOW, '-p', 'bag_recorder:run_dir:=run', '-p', 'deterministic_timer:rate:=1.0')
    wait_for_ticks(bench)
    process.signal(signal.SIGKILL)
    process.wait()
    metadata = bench.directory / 'run' / 'bag' / 'metadata.yaml'
    deadline = time.monotonic() + 100.0
    while not metadata.exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert bench.run_yaml('run')['status'] == 'running'  # never looks complete
    assert len(Run.open(bench.directory / 'run').time) > 1
