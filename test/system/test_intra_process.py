"""Messages that stay in the rig's process: the same bits, and an outside node sees what it sees with DDS alone."""

import hashlib
import signal
from pathlib import Path

from geometry_msgs.msg import Vector3Stamped
from std_msgs.msg import Float64MultiArray

from hdd_servo_ros import Run
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, RECORDED
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.ros.loop_topics import LOOP_QOS

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / 'examples' / 'disturbance_node.py'
OFF = ('-p', 'rig:intra_process:=false')


def digests(run):
    """Return a digest of each topic's messages."""
    return {
        topic: hashlib.sha256(b''.join(payloads)).hexdigest()
        for topic, (_, payloads) in Run.open(run).messages_by_topic().items()
    }


class Observer:
    """An ordinary subscriber to `/head` and `/estimates` that notes the tick of each message."""

    def __init__(self, node):
        self._node = node
        self.ticks: dict[str, list[int]] = {'head': [], 'estimates': []}
        self._subscriptions = [
            node.create_subscription(Vector3Stamped, '/head', self._take_head, LOOP_QOS),
            node.create_subscription(Float64MultiArray, '/estimates', self._take_estimates, LOOP_QOS),
        ]

    def _take_head(self, message):
        stamp = message.header.stamp
        self.ticks['head'].append((stamp.sec * 10**9 + stamp.nanosec) // 100_000)

    def _take_estimates(self, message):
        self.ticks['estimates'].append(round(message.data[0] / 1e-4))

    def has(self, count):
        return all(len(ticks) >= count for ticks in self.ticks.values())

    def leave(self):
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)


def test_observers_come_and_go_and_miss_nothing(bench, outside):
    duration = ('-p', 'duration:=0.4', '-p', 'plot:=false')
    bench.run('simulate', *duration, '-p', 'run_dir:=simulated')
    bench.run('rig', *duration, *OFF, '-p', 'run_dir:=over_dds')
    process = bench.start('rig', *duration, '-p', 'rate:=0.04', '-p', 'run_dir:=by_hand')
    process.wait_for('real-time factor')  # the first line of its progress, some seconds after tick 0
    observers = []
    for _ in range(2):
        observer = Observer(outside)
        outside.spin_until(lambda observer=observer: observer.has(100))
        observers.append(observer)
        observer.leave()
        outside.spin_for(0.5)
    last = Observer(outside)
    outside.spin_until(lambda: process.popen.poll() is not None)
    outside.spin_for(0.5)
    assert process.wait() == 0, process.output
    for observer in (*observers, last):
        for ticks in observer.ticks.values():
            assert ticks[0] > 0
            assert ticks == list(range(ticks[0], ticks[-1] + 1))
    for ticks in last.ticks.values():
        assert ticks[-1] == 4000
    assert digests(bench.directory / 'by_hand') == digests(bench.directory / 'over_dds')
    assert digests(bench.directory / 'by_hand') == digests(bench.directory / 'simulated')


def test_the_graph_looks_the_same(bench, outside):
    names = {f'/{topic.name}' for topic in (*ALL_LOOP_TOPICS, RECORDED)}
    seen = []
    for arguments in ((), OFF):
        process = bench.start('rig', *arguments, '-p', 'rate:=0.01', '-p', 'duration:=10.0', '-p', 'plot:=false')
        process.wait_for('real-time factor')
        seen.append(graph(outside, names))
        process.signal(signal.SIGINT)
        assert process.wait() == 130, process.output
        outside.spin_until(lambda: not any(ends for _, *ends in graph(outside, names)))
    assert len(seen[0]) > len(ALL_LOOP_TOPICS)
    assert seen[0] == seen[1]


def graph(node, names):
    """Return what `ros2 topic list` and `ros2 topic info --verbose` show of topics."""
    return sorted(
        (name, types, kind, end.node_name, str(end.qos_profile.reliability), str(end.qos_profile.durability))
        for name, types in node.get_topic_names_and_types()
        if name in names
        for kind, ends in (
            ('publisher', node.get_publishers_info_by_topic(name)),
            ('subscription', node.get_subscriptions_info_by_topic(name)),
        )
        for end in ends
    )


def test_nodes_of_the_run_in_other_processes(bench):
    """The controller, the recorder and a disturbance run elsewhere: what is read there comes from tick 0 on."""
    duration = ('-p', 'duration:=0.05', '-p', 'plot:=false')
    processes = [bench.start('disturbance', *duration, script=EXAMPLE)]
    processes[0].wait_for('waiting for')
    processes += [
        bench.start('part_of_a_rig', *duration, script=HERE / 'part_of_a_rig.py'),
        bench.start('adaptive_nn_controller'),
        bench.start('bag_recorder', '-p', 'run_dir:=run'),
    ]
    for process in processes:
        assert process.wait() == 0, process.output
    run = bench.directory / 'run'
    assert len(Run.open(run).disturbance) == 501
    bench.run('simulate', *duration, '-p', f'recorded_run:={run}', '-p', 'run_dir:=simulated')
    assert first_difference(run, bench.directory / 'simulated') is None


def test_a_second_publisher_ends_the_run(bench, outside):
    duration = ('-p', 'duration:=2.0', '-p', 'plot:=false')
    bench.run('simulate', *duration, '-p', 'run_dir:=simulated')
    process = bench.start('rig', *duration, '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    publisher = outside.create_publisher(Vector3Stamped, '/ldv', 10)
    while process.popen.poll() is None:
        publisher.publish(Vector3Stamped())
        outside.spin_for(0.05)
    assert process.wait() == 1, process.output
    assert '/ldv has 2 publishers at tick' in process.output
    run, simulated = Run.open(bench.directory / 'run'), Run.open(bench.directory / 'simulated')
    assert 0 < run.last_tick < 20_000
    for name in ('head', 'ldv', 'control', 'estimates'):
        assert run[name].tobytes() == simulated[name][: run.last_tick + 1].tobytes()
