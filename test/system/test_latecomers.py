"""Whoever comes when a graph is there already ends alone, and the run goes on to the same bits."""

import pytest

from hdd_servo_ros.recording.compare_bags import first_difference

DURATION = ('-p', 'duration:=0.4', '-p', 'plot:=false')
RATE = ('-p', 'rate:=0.02')
CURE = 'wait for its end, or choose another namespace (--ros-args -r __ns:=/bench2) or another ROS_DOMAIN_ID'


@pytest.fixture
def simulated(bench):
    """Give the run that every undisturbed one equals."""
    bench.run('simulate', *DURATION, '-p', 'run_dir:=simulated')
    return bench.directory / 'simulated'


def ends_alone(process):
    assert process.wait() == 1, process.output
    lines = [line for line in process.output.splitlines() if 'ERROR' in line]
    assert len(lines) == 1, process.output
    assert 'publishe' in lines[0] or 'a run is in progress here' in lines[0]
    assert CURE in lines[0]
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('how', [(), ('-p', 'rig:intra_process:=false')], ids=['rig', 'over_dds'])
def test_a_second_rig_ends_alone(bench, simulated, how):
    process = bench.start('rig', *DURATION, *RATE, *how, '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    for number, name in enumerate(('rig', 'ldv_sensor', 'rig')):
        ends_alone(bench.start(name, *(['-p', f'run_dir:=late{number}'] if name == 'rig' else [])))
        assert not (bench.directory / f'late{number}').exists()
    assert process.popen.poll() is None, process.output
    assert process.wait() == 0, process.output
    assert 'publishers' not in process.output
    assert first_difference(bench.directory / 'run', simulated) is None


def test_a_second_rig_in_another_namespace_runs_beside(bench, simulated):
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    beside = bench.start('rig', *DURATION, '-r', '__ns:=/bench2', '-p', 'run_dir:=beside')
    assert beside.wait() == 0, beside.output
    assert process.popen.poll() is None
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None


def test_one_that_has_published_before_it_heard_of_the_run_does_not_end_it(bench, simulated):
    """As one from another machine, which DDS has not found in time."""
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    script = bench.directory / 'blind.py'
    script.write_text(
        'import sys\n'
        'from hdd_servo_ros.nodes import main, reference_generator\n'
        'class Blind:\n'
        '    def __init__(self, topics, domain): pass\n'
        '    def close(self): pass\n'
        'main.TopicClaims = Blind\n'
        'sys.exit(reference_generator.main())\n'
    )
    ends_alone(bench.start('reference_generator', script=script))
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None


def test_a_second_node_of_a_graph_that_waits_ends_alone(bench):
    waiting = bench.start('ldv_sensor', '-p', 'start_timeout:=30.0')
    waiting.wait_for('waiting for deterministic_timer')
    second = bench.start('ldv_sensor')
    assert second.wait() == 1
    assert f'/ldv is published by process {waiting.popen.pid} already; {CURE}' in second.output
    assert CURE in second.output
    assert waiting.popen.poll() is None
    processes = bench.start_nodes(
        'run',
        '-p',
        'deterministic_timer:duration:=0.01',
        nodes=['bag_recorder', 'vcm_plant', 'adaptive_nn_controller', 'reference_generator', 'deterministic_timer'],
    )
    for process in (*processes.values(), waiting):
        assert process.wait() == 0, process.output


def test_of_two_that_start_together_one_runs(bench, simulated):
    processes = [bench.start('rig', *DURATION, '-p', f'run_dir:=run{number}') for number in range(2)]
    codes = sorted(process.wait() for process in processes)
    if codes == [0, 0]:
        pytest.skip('one was over before the other began')
    assert codes == [0, 1]
    (run,) = (path for path in bench.directory.glob('run?'))
    assert first_difference(run, simulated) is None


def test_one_of_another_machine_listens_before_it_publishes(bench, simulated):
    """Without the claims of this machine, and with a range beyond it."""
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    script = bench.directory / 'elsewhere.py'
    script.write_text(
        'import sys\n'
        'from hdd_servo_ros.nodes import main, rig\n'
        'class Blind:\n'
        '    def __init__(self, topics, domain): pass\n'
        '    def close(self): pass\n'
        'main.TopicClaims = Blind\n'
        'main.keeps_to_this_machine = lambda environment: False\n'
        'class Fails:\n'
        '    def __init__(self, *_, **__): raise SystemExit("it has begun to publish")\n'
        'main.Lockstep = Fails\n'
        'main.Lookout.__init__.__globals__["_SHORTEST_SEARCH"] = 10.0\n'
        'sys.exit(rig.main())\n'
    )
    ends_alone(bench.start('rig', script=script))
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None
