"""A process that receives forged announcements of others before, during and after a run."""

import dataclasses
import time

import pytest
import rclpy
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED
from hdd_servo_ros.ros.announcement import DONE, READY, RUNNING, WAITING, Announcement, TimerAnnouncement
from hdd_servo_ros.ros.ending import Ending
from hdd_servo_ros.ros.gathering import Gathering
from hdd_servo_ros.ros.member import Member
from hdd_servo_ros.ros.run_plan import RunPlan
from hdd_servo_ros.ros.watching import PeerEnded, Watching

TIMER = TimerAnnouncement(1e-4, 100, 0.0)
CLOCK_NODE = {'inputs': [], 'outputs': ['/clock'], 'offers': {}, 'parameters': {}}
OF_TIMER = Announcement(
    'timer',
    READY,
    ticks={'/deterministic_timer': 0},
    changes={'/deterministic_timer': 2},
    nodes={'/deterministic_timer': CLOCK_NODE},
    timer=TIMER,
)


@pytest.fixture
def member(node):
    node.connect()
    return Member([node])


def receive(member, announcement, **changes):
    send(member, dataclasses.replace(announcement, **changes).encode())


def send(member, text):
    member._receive(serialize_message(String(data=text)))


def start(member, *others):
    nodes = {'/deterministic_timer': CLOCK_NODE, **dict(member.known_nodes(0.0))}
    run = RunPlan(1e-4, 100, 0.0, 'drive', '/deterministic_timer', nodes, ['timer', *others, member.identifier], [])
    receive(member, OF_TIMER, state=RUNNING, run=dataclasses.asdict(run))


def gathered_reason(member):
    """Return the reason of the end announced by a peer; empty if no peer has announced one."""
    return '' if member.outcome_of_peer is None else member.outcome_of_peer.reason


def clock_of(monkeypatch, member, seconds):
    """Set the monotonic clock to a time after the last announcement of the timer [s]."""
    now = member.peers._received_at['timer'] + seconds
    monkeypatch.setattr('time.monotonic', lambda: now)


STRAY = [
    b'',
    b'hello',
    bytes(5),
    b'\x00\x01\x00\x00\xff\xff\xff\xff{}',
    *(
        serialize_message(String(data=text))
        for text in (
            'hello',
            '[' * 5000,
            '{"process":' * 100_000,
            '{"process": "x"}',
            '{"process": "x", "state": "waiting"}',
            '{"process": "x", "state": "failed", "reason": "because"}',
            '{"process": "x", "state": "failed", "ticks": {"/x": 1}}',
            '{"process": "x", "state": "failed", "reason": "because", "ticks": {"/x": 1}}',
            '{"process": "x", "state": "failed", "nodes": {}}',
            '{"process": "x", "state": "interrupted", "nodes": {}, "ticks": {"/x": 1}}',
            '{"process": "x", "state": "waiting", "nodes": {}}',
            '{"process": "x", "state": ["failed"]}',
            '{"process": 7, "state": "ready"}',
            '{"process": "x", "state": "ready", "ticks": {"/x": "one"}}',
            '{"process": "x", "state": "ready", "ticks": [1, 2]}',
            '{"process": "x", "state": "ready", "ticks": {"/x": -1}}',
            '{"process": "x", "state": "ready", "ticks": {"/x": 1e400}}',
            '{"process": "x", "state": "ready", "ticks": {"/x": 1' + 400 * '0' + '}}',
            '{"process": "x", "state": "ready", "nodes": {"/x": {}}}',
            '{"process": "x", "state": "ready", "nodes": {"/x": {"inputs": 3}}}',
            '{"process": "x", "state": "ready", "nodes": {}, "receives": 5}',
            '{"process": "x", "state": "ready", "nodes": {}, "timer": {"sample_time": 0, "last_tick": 1, "rate": 0}}',
            '{"process": "x", "state": "ready", "nodes": {}, "timer": {"sample_time": NaN, "last_tick": 1, "rate": 0}}',
            '{"process": "x", "state": "running", "ticks": {"/x": 0}, "run": {"processes": []}}',
            '{"process": "x", "state": "running", "nodes": {}, "run": {"sample_time": 1e-4, "last_tick": 1, "rate": 0,'
            ' "frame_id": "", "timer": "/t", "nodes": {}, "processes": [], "schedule": []}, "ticks": {"/x": 0}}',
        )
    ),
]
"""Messages on `/lockstep` that no process of this package sends."""


@pytest.mark.parametrize('stray', STRAY)
@pytest.mark.parametrize('is_running', [False, True])
def test_stray_messages_are_ignored(member, stray, is_running):
    if is_running:
        start(member)
    before = (dict(member.peers.announcements), member.state, member.outcome_of_peer)
    member._receive(stray)
    member._receive(stray)
    assert (dict(member.peers.announcements), member.state, member.outcome_of_peer) == before
    assert member.ignored.counts == {'/lockstep': 2}


def test_ignored_messages_are_counted_and_reported_once_with_their_possible_senders(member, monkeypatch):
    logged = []
    monkeypatch.setattr(type(member.ignored._node.get_logger()), 'warning', lambda _, text: logged.append(text))
    external = rclpy.create_node('external')
    external.create_publisher(String, '/lockstep', 10)
    deadline = time.monotonic() + 100.0
    while external.count_publishers('/lockstep') < 2:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for _ in range(300):
        send(member, '{"process": "x"}')
    external.destroy_node()
    assert logged == [
        '/lockstep: ignored a message (state is missing), and will ignore further ones silently; published by /external'
    ]
    member.ignored.report()
    assert logged[1:] == ['/lockstep: ignored 300 messages in all']


def test_a_process_that_does_not_participate_in_the_run_cannot_end_it(member):
    start(member)
    receive(member, Announcement('x', FAILED, 'for fun', ticks={'/x': 3}))
    receive(member, Announcement('x', RUNNING, ticks={'/deterministic_timer': 2**40}))
    assert member.outcome_of_peer is None
    assert 'x' not in member.peers.announcements
    assert member.peers.ticks() == {'/deterministic_timer': 0}
    assert member.ignored.counts == {'/lockstep': 2}


def test_a_process_that_joins_after_the_start_is_recorded_by_its_outputs(member):
    start(member)
    receive(member, OF_TIMER, process='late')
    assert 'late' not in member.peers.announcements
    assert list(member.late_outputs) == ['/clock']
    assert not member.ignored.counts


def test_its_own_announcements_are_ignored(member):
    receive(member, OF_TIMER, process=member.identifier)
    assert not member.peers.announcements


def test_a_process_is_waiting_until_nothing_is_missing(member):
    gathering = Gathering(member)
    assert not gathering.gather()
    assert member.state == WAITING
    assert gathering._missing == ['deterministic_timer', 'deterministic_timer (nobody publishes /clock)']
    receive(member, OF_TIMER)
    gathering.gather()
    assert gathering._missing == ['deterministic_timer (nobody publishes /clock)']


def test_two_nodes_that_announce_one_topic_end_the_run_before_it_begins(member):
    gathering = Gathering(member)
    receive(member, OF_TIMER)
    receive(member, OF_TIMER, process='second', nodes={'/second_timer': CLOCK_NODE})
    with pytest.raises(
        RunError, match='/clock has 2 publishers but must have exactly one: /deterministic_timer, /second_timer'
    ):
        gathering.gather()


def test_a_failed_peer_ends_the_wait_and_an_interrupted_one_is_removed(member):
    gathering = Gathering(member)
    receive(member, OF_TIMER)
    receive(member, OF_TIMER, state=INTERRUPTED)
    assert not member.peers.announcements
    assert not gathering.gather()
    receive(member, OF_TIMER, state=FAILED, reason='no disk')
    with pytest.raises(RunError, match='no disk'):
        gathering.gather()


def test_a_peer_that_fails_without_a_reason_is_named(member):
    receive(member, OF_TIMER)
    receive(member, OF_TIMER, state=FAILED, reason='', nodes=None)
    with pytest.raises(RunError, match='/deterministic_timer has failed and gave no reason'):
        Gathering(member).gather()


def test_a_process_that_shows_no_nodes_does_not_hold_up_a_start(member):
    receive(member, OF_TIMER)
    receive(member, Announcement('x', RUNNING, ticks={'/x': 1}))
    assert member.others_are(READY)


def test_a_peer_of_the_run_that_failed_before_this_process_began_ends_it(member):
    """The run includes it; its nodes need not have been known before."""
    receive(member, OF_TIMER)
    receive(member, Announcement('playback', FAILED, 'no such run', ticks={'/playback': 0}))
    assert not gathered_reason(member)
    start(member, 'playback')
    assert gathered_reason(member) == 'no such run'


def test_a_run_starts_with_the_timer(member, node):
    start(member)
    assert member.state == RUNNING
    assert node.last_tick == 100
    assert Gathering(member).gather()


def test_a_peer_of_the_run_may_be_discovered_after_its_end(member):
    """No topic of its node had to be known before: it may have finished before its announcement is needed."""
    start(member, 'playback')
    ending = Ending(member)
    receive(member, OF_TIMER, state=DONE)
    assert Gathering(member).gather()
    assert ending.final_changes() is None
    receive(member, Announcement('playback', FINISHED, ticks={'/playback': 101}, changes={'/playback': 1}))
    assert ending.final_changes() == {'/reference_generator': 0, '/deterministic_timer': 2, '/playback': 1}


def test_a_peer_is_not_lost_while_this_process_begins(member, monkeypatch):
    """Its announcements in that time are still unread."""
    gathering = Gathering(member)
    receive(member, OF_TIMER)
    receive(member, Announcement('playback', READY, nodes={'/playback': CLOCK_NODE}))
    clock_of(monkeypatch, member, 60.0)
    start(member, 'playback')
    assert gathering.gather()
    Watching(member).watch()
    assert 'playback' in member.peers.announcements


def test_a_peer_that_is_never_discovered_is_lost_in_the_end(member, monkeypatch):
    start(member, 'playback')
    clock_of(monkeypatch, member, 3.1)
    receive(member, OF_TIMER, state=RUNNING)
    with pytest.raises(RunError, match=r'lost a peer: no message for 3\.1 s \(peer_timeout\) from playback'):
        Watching(member).watch()


def test_a_process_that_joins_after_the_start_is_rejected(member):
    run = RunPlan(1e-4, 100, 0.0, 'drive', '/deterministic_timer', {}, ['timer'], [])
    with pytest.raises(RunError, match='/reference_generator joined after the start: a run is in progress'):
        receive(member, OF_TIMER, state=RUNNING, run=dataclasses.asdict(run))


@pytest.mark.parametrize(('stalled', 'timeout'), [(0.0, 9.0), (2.0, 3.0)])
def test_a_peer_may_be_silent_longer_while_ticks_go_on(member, monkeypatch, stalled, timeout):
    start(member)
    watching = Watching(member)
    clock_of(monkeypatch, member, timeout - 0.1)
    watching.watch(stalled)
    clock_of(monkeypatch, member, timeout + 0.1)
    with pytest.raises(RunError, match=r'from /deterministic_timer; /clock is missing for tick 0'):
        watching.watch(stalled)


@pytest.mark.parametrize('state', [DONE, FINISHED])
def test_a_peer_that_is_done_may_be_silent(member, monkeypatch, state):
    start(member)
    receive(member, OF_TIMER, state=state)
    clock_of(monkeypatch, member, 60.0)
    Watching(member).watch()


def test_the_end_of_a_peer_is_received(member):
    start(member)
    receive(member, OF_TIMER, process='of another run', state=FAILED, reason='its own affair')
    Watching(member).watch()
    receive(member, OF_TIMER, state=INTERRUPTED, reason='SIGINT')
    with pytest.raises(PeerEnded, match='SIGINT') as ended:
        Watching(member).watch()
    assert ended.value.outcome.status == INTERRUPTED


def test_a_message_that_was_published_and_did_not_arrive(member, monkeypatch):
    start(member)
    receive(member, OF_TIMER, state=RUNNING, ticks={'/deterministic_timer': 1})
    watching = Watching(member)
    watching.check_stall(3.9)
    clock_of(monkeypatch, member, 4.1)
    watching.check_stall(4.1)
    clock_of(monkeypatch, member, 4.7)
    with pytest.raises(RunError, match='/clock: tick 0 was published by /deterministic_timer and did not arrive'):
        watching.check_stall(4.7)


def test_a_message_that_was_not_published_yet_is_not_lost(member, monkeypatch):
    start(member)
    watching = Watching(member)
    for seconds in (4.1, 60.0):
        clock_of(monkeypatch, member, seconds)
        watching.check_stall(seconds)


def test_all_end_when_the_timer_has_finished(member):
    start(member)
    ending = Ending(member)
    assert ending.final_changes() is None
    assert not ending.announce_done()
    assert member.state == DONE
    receive(member, OF_TIMER, state=DONE)
    assert ending.final_changes() == {'/reference_generator': 0, '/deterministic_timer': 2}
    assert not ending.announce_done()
    receive(member, OF_TIMER, state=FINISHED)
    assert ending.announce_done()
