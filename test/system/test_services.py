"""Start, pause, resume, single step, stop and reset by services; the bits know nothing of them."""

import itertools
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.parameter_history import recorded_changes

HERE = Path(__file__).parent
DURATION = ('-p', 'duration:=0.1')


class Remote:
    """The run's services, called from an ordinary node."""

    def __init__(self, node):
        self._node = node
        # Kept: a server may answer before it has found a client that is new to it.
        self._clients = {}

    def call(self, name):
        """Return success and message of a ``Trigger`` service, once it is there."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(Trigger, name)
        client = self._clients[name]
        assert client.wait_for_service(timeout_sec=200.0), name
        future = client.call_async(Trigger.Request())
        self._node.spin_until(future.done)
        return future.result().success, future.result().message

    def timer(self, name):
        return self.call(f'/deterministic_timer/{name}')

    def timer_at_last(self, name):
        """Call a service of the timer until all nodes are there and it does what it is asked for."""
        end = time.monotonic() + 200.0
        while not (answer := self.timer(name))[0]:
            assert answer[1] == 'the run has not begun: nodes are missing'
            assert time.monotonic() < end
            time.sleep(0.1)
        return answer[1]


@pytest.fixture
def remote(outside):
    return Remote(outside)


def simulated(bench, *arguments):
    bench.run('simulate', *DURATION, '-p', 'run_dir:=simulated', '-p', 'plot:=false', *arguments)
    return bench.directory / 'simulated'


def test_start_step_pause_and_resume_change_no_bit(bench, remote):
    process = bench.start('rig', *DURATION, '-p', 'rate:=0.05', '-p', 'autostart:=false', '-p', 'run_dir:=run')
    assert remote.timer_at_last('step') == 'stepping over tick 0'
    time.sleep(1.0)
    assert remote.timer('step') == (True, 'stepping over tick 1')
    assert remote.timer('start') == (False, 'started already')
    time.sleep(1.0)
    assert remote.timer('pause') == (False, 'not running: paused before tick 2')
    assert remote.timer('step')[0]
    assert remote.timer('step')[0]  # whether the last one is over or not
    time.sleep(1.0)
    assert remote.timer('pause') == (False, 'not running: paused before tick 4')
    assert remote.timer('resume') == (True, 'running, next is tick 4')
    assert remote.timer('resume') == (False, 'not paused')
    assert remote.timer('step') == (False, 'running: call ~/pause first')
    success, message = remote.timer('pause')
    assert success
    paused_before = int(message.removeprefix('paused before tick '))
    assert 4 <= paused_before < 1000
    time.sleep(0.5)
    assert remote.timer('pause') == (False, f'not running: paused before tick {paused_before}')
    remote.timer('resume')
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated(bench)) is None


def test_a_pause_longer_than_any_timeout_in_separate_processes(bench, remote):
    processes = bench.start_nodes('run', *DURATION, '-p', 'rate:=0.1', '-p', 'autostart:=false')
    # Longer than a silent peer (3 s) and a stalled loop (1 s more) are borne, and long enough for what the nodes say to
    # pile up if they did not keep up with it.
    remote.timer_at_last('step')
    time.sleep(16.0)
    assert remote.timer('resume') == (True, 'running, next is tick 1')
    for process in processes.values():
        assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated(bench)) is None


def test_stop_ends_the_run_with_a_closed_bag(bench, remote):
    process = bench.start('rig', '-p', 'duration:=30.0', '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    remote.timer_at_last('pause')
    remote.timer('step')
    time.sleep(0.3)
    assert remote.timer('stop')[0]
    assert process.wait() == 130, process.output
    said = bench.run_yaml('run')
    assert said['status'] == 'interrupted'
    assert said['reason'] == f'~/stop deterministic_timer before tick {said["last_tick"] + 1}'
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'run', '--without-ros')
    assert answer.returncode == 0, answer.stdout + answer.stderr


def test_stop_ends_the_wait_for_peers(bench, remote):
    process = bench.start('deterministic_timer')
    assert remote.timer('stop')[0]
    assert process.wait() == 130, process.output
    assert '~/stop deterministic_timer before the run' in process.output


def test_reset_and_diagnostics(bench, outside, remote):
    reports: list[DiagnosticArray] = []
    outside.create_subscription(DiagnosticArray, '/diagnostics', reports.append, 10)
    # The law that theorem 4.1 is about: the shipped controller has no certificate.
    law = ('--params-file', str(HERE.parents[1] / 'params' / 'thesis_law.yaml'))
    process = bench.start(
        'rig', *law, '-p', 'duration:=30.0', '-p', 'rate:=0.05', '-p', 'run_dir:=run', '-p', 'autostart:=false'
    )

    def latest(name):
        for report in reversed(reports):
            for status in report.status:
                if status.name == name:
                    return status
        return None

    outside.spin_until(lambda: latest('deterministic_timer: ticks') is not None)
    outside.spin_until(lambda: latest('deterministic_timer: ticks').message == 'waiting for ~/start')
    assert remote.timer('start')[0]
    outside.spin_until(lambda: 'x real time' in latest('deterministic_timer: ticks').message)
    names = {status.name for status in reports[-1].status}
    assert names >= {
        'deterministic_timer: ticks',
        'adaptive_nn_controller: control',
        'adaptive_nn_controller: adaptation',
        'adaptive_nn_controller: certificate',
        'adaptive_nn_controller: stability margin',
        'ldv_sensor: range',
        'bag_recorder: recording',
    }
    assert {status.level for status in reports[-1].status} == {b'\x00'}
    values = {value.key: value.value for value in latest('deterministic_timer: ticks').values}
    # On average it keeps to its pace of 0.05; after a stall it catches up.
    assert 0.0 < float(values['real-time factor']) < 0.5
    outside.spin_until(lambda: 'inside the bound' in latest('adaptive_nn_controller: certificate').message)
    margin = {value.key: float(value.value) for value in latest('adaptive_nn_controller: certificate').values}
    assert 0.0 < margin['margin'] == pytest.approx(margin['bound on |r|'] - abs(margin['r']), rel=1e-4)
    stamps = [report.header.stamp.sec + 1e-9 * report.header.stamp.nanosec for report in reports]
    assert min(after - before for before, after in itertools.pairwise(stamps)) > 0.5
    # A vibrometer that cannot follow, then a control limit below what the law asks for; the other way round
    # the head may come to rest inside what is left of the vibrometer's range.
    for node, name, value, what, level in (
        ('ldv_sensor', 'output_range', '0.01', 'range', b'\x01'),
        ('adaptive_nn_controller', 'control_limit', '1e-6', 'control', b'\x02'),
    ):
        answer = bench.python(str(HERE / 'set_parameter.py'), f'/{node}', name, value)
        assert answer.returncode == 0, answer.stderr
        outside.spin_until(lambda what=f'{node}: {what}', level=level: latest(what).level == level)
    assert remote.call('/adaptive_nn_controller/reset')[0]
    success, message = remote.call('/adaptive_nn_controller/reset')
    assert success
    tick = int(message.removeprefix('reset before tick '))
    assert remote.timer('stop')[0]
    assert process.wait() == 130
    changes = [(change.time_ns // 100_000, change.values) for change in recorded_changes(bench.directory / 'run')]
    assert (tick, {'reset_count': 2}) in changes
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'run', '--without-ros')
    assert answer.returncode == 0, answer.stdout + answer.stderr
