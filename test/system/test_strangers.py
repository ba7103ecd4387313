"""Messages that no process of the run sends: ignored on topics that serve a run, the end of it on those of the loop."""

import time

import pytest
from geometry_msgs.msg import Vector3Stamped
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from std_msgs.msg import Float64MultiArray, Header, String, UInt64

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.ros.publishers import UNDISCOVERED_NODE

DURATION = ('-p', 'duration:=0.4', '-p', 'plot:=false')
RATE = ('-p', 'rate:=0.05')
"""Eight seconds: time for a stranger to be discovered."""
LONG = ('-p', 'duration:=10.0', '-p', 'rate:=0.05', '-p', 'plot:=false')
OVER_DDS = ('-p', 'rig:intra_process:=false')


@pytest.fixture
def simulated(bench):
    """Give the run that every undisturbed one equals."""
    bench.run('simulate', *DURATION, '-p', 'run_dir:=simulated')
    return bench.directory / 'simulated'


def disturb(outside, process, publishers):
    """Publish all messages again and again while a process runs; return how often."""
    rounds = 0
    while process.popen.poll() is None:
        for publisher, messages in publishers:
            for message in messages:
                publisher.publish(message)
        rounds += 1
        outside.spin_for(0.02)
    return rounds


def header(seconds, nanoseconds=0, frame_id=''):
    made = Header(frame_id=frame_id)
    made.stamp.sec, made.stamp.nanosec = seconds, nanoseconds
    return made


def event(node, value, seconds=0, nanoseconds=0):
    made = ParameterEvent(node=node, changed_parameters=[Parameter(name='gain', value=value)])
    made.stamp.sec, made.stamp.nanosec = seconds, nanoseconds
    return made


NUMBER = ParameterValue(type=3, double_value=1.0)
STRAY = {
    '/recorded': (Header, [header(0), header(-5), header(10**6), header(0, 6_400_000), header(0, 0, 'host:1:abc')]),
    '/lockstep': (
        String,
        [
            String(data=text)
            for text in (
                '{"process": "x"}',
                '[' * 5000,
                '{"process": "x", "state": "failed", "reason": "for fun"}',
                '{"process": "x", "state": "failed", "ticks": {"/vcm_plant": 1e9}}',
                '{"process": "x", "state": "running", "ticks": "many"}',
            )
        ],
    ),
    '/scope': (Float64MultiArray, [Float64MultiArray(data=[1.0])]),
    '/parameter_events': (
        ParameterEvent,
        [
            event('/vcm_plant', NUMBER, seconds=-3),
            event('/vcm_plant', NUMBER, nanoseconds=4_000_000_000),
            event('/vcm_plant', ParameterValue(type=10)),
            event('/vcm_plant', ParameterValue(type=5, byte_array_value=[b'\x01'])),
            event('/vcm_plant', ParameterValue(type=4, string_value='much')),
            event('/somebody_else', ParameterValue(type=10), seconds=-3),
        ],
    ),
}


@pytest.mark.parametrize('how', [(), OVER_DDS], ids=['rig', 'over_dds'])
def test_strangers_on_all_service_topics_change_nothing(bench, outside, simulated, how):
    process = bench.start('rig', *DURATION, *RATE, *how, '-p', 'run_dir:=run')
    publishers = [(outside.create_publisher(kind, topic, 10), messages) for topic, (kind, messages) in STRAY.items()]
    process.wait_for('real-time factor')
    assert disturb(outside, process, publishers) > 10
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None
    for topic in ('/lockstep', '/parameter_events', *(('/recorded',) if how else ())):
        lines = [line for line in process.output.splitlines() if f'{topic}: ignored a message' in line]
        assert len(lines) == 1, process.output
        # Events come from every node of the domain.
        assert '/outside' in lines[0]
    assert 'Traceback' not in process.output


def test_a_stranger_with_another_type_on_recorded(bench, outside, simulated):
    """DDS matches no subscription of another type, but counts the publisher."""
    publisher = outside.create_publisher(UInt64, '/recorded', 10)
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    disturb(outside, process, [(publisher, [UInt64(data=0), UInt64(data=2**63)])])
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None


def test_a_change_that_a_node_did_not_make_is_not_recorded(bench, outside):
    """Nodes of the recorder's process hand their changes over; test_no_false_record.py has those of other processes."""
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    publisher = outside.create_publisher(ParameterEvent, '/parameter_events', 10)
    process.wait_for('real-time factor')
    outside.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(event('/vcm_plant', NUMBER, nanoseconds=15_000_000))
    assert process.wait() == 0, process.output
    assert not Run.open(bench.directory / 'run').parameter_changes


def test_a_stranger_that_says_that_it_failed_ends_no_graph_that_waits(bench, outside, simulated):
    """The plant waits for the others, whoever says whatever of himself."""
    plant = bench.start('vcm_plant')
    publisher = outside.create_publisher(String, '/lockstep', 10)
    plant.wait_for('waiting for')
    outside.spin_until(lambda: publisher.get_subscription_count() > 0)
    for text in (
        '{"process": "x", "state": "failed", "ticks": {"/a": 1}}',
        '{"process": "x", "state": "failed", "nodes": {}}',
        '{"process": "x", "state": "running", "ticks": {"/a": 1}}',
        '{"process": "x", "state": "failed"}',
    ):
        publisher.publish(String(data=text))
    plant.wait_for('/lockstep: ignored a message')
    outside.spin_for(0.5)
    assert plant.popen.poll() is None, plant.output
    assert 'published by /outside' in plant.output


@pytest.mark.parametrize('message', [b'\x00\x01\x00\x00\x00', b'', bytes(48), b'\x00\x00' + bytes(54), bytes(2000)])
def test_bytes_that_are_no_message_end_the_run_with_topic_and_publisher(bench, outside, message):
    process = bench.start('rig', *LONG, *OVER_DDS, '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    publisher = outside.create_publisher(Vector3Stamped, '/ldv', 10)
    while process.popen.poll() is None:
        publisher.publish(message)
        outside.spin_for(0.02)
    assert process.wait() == 1, process.output
    assert '/ldv' in process.output
    # On a busy machine the run may end before DDS has reported the name of the publisher.
    assert '/outside' in process.output or UNDISCOVERED_NODE in process.output
    assert 'Error' not in process.output.replace('ERROR', '')
    content = bench.run_yaml('run')
    assert (content['status'], '/ldv' in content['reason']) == ('failed', True)
    assert len(Run.open(bench.directory / 'run').time) == content['last_tick'] + 1


def test_a_request_with_a_type_that_there_is_not_is_rejected(bench, outside, simulated):
    process = bench.start('rig', *DURATION, *RATE, '-p', 'run_dir:=run')
    for kind in (0, 10, 255):
        parameters = [Parameter(name='gain', value=ParameterValue(type=kind))]
        answer, _ = outside.call(
            SetParameters, '/vcm_plant/set_parameters', SetParameters.Request(parameters=parameters)
        )
        assert not answer.results[0].successful
        assert f'invalid type of parameter gain: {kind}' in answer.results[0].reason
        request = SetParametersAtomically.Request(parameters=parameters)
        answer, _ = outside.call(SetParametersAtomically, '/vcm_plant/set_parameters_atomically', request)
        assert not answer.result.successful
    answer, _ = outside.call(
        SetParametersAtomically, '/vcm_plant/set_parameters_atomically', SetParametersAtomically.Request()
    )
    assert answer.result.successful
    assert process.wait() == 0, process.output
    assert first_difference(bench.directory / 'run', simulated) is None


def test_a_recorder_that_falls_silent_ends_the_run(bench, outside):
    """It lives and announces itself, and reports no progress any more: the timer says what it waits for, and ends."""
    started = time.monotonic()
    script = bench.directory / 'silent.py'
    script.write_text(
        'import sys\n'
        'from hdd_servo_ros.nodes.bag_recorder import BagRecorder\n'
        'from hdd_servo_ros.nodes.main import Composition, run_nodes\n'
        'from hdd_servo_ros.nodes.rig import Rig\n'
        'BagRecorder._report = lambda self, tick: None\n'
        'def make(given):\n'
        '    rig = Rig(given)\n'
        '    return Composition(rig.nodes, [rig.node], rig.parameters.intra_process)\n'
        'sys.exit(run_nodes("rig", make))\n'
    )
    process = bench.start('rig', '-p', 'duration:=100.0', '-p', 'run_dir:=silent', '-p', 'plot:=false', script=script)
    assert process.wait() == 1, process.output
    assert time.monotonic() - started < 60.0
    assert 'no node has fired for' in process.output
    assert '/recorded is missing for tick' in process.output
    content = bench.run_yaml('silent')
    assert content['status'] == 'failed'
    assert 'no node has fired for' in content['reason']
    assert len(Run.open(bench.directory / 'silent').time) == content['last_tick'] + 1
