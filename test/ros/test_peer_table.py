"""The table of other processes, with times."""

import pytest

from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED
from hdd_servo_ros.ros.announcement import DONE, READY, RUNNING, WAITING, Announcement, TimerAnnouncement
from hdd_servo_ros.ros.peer_table import PeerTable

LDV = {'/ldv_sensor': {'inputs': ['/head'], 'outputs': ['/ldv']}}
TIMER = TimerAnnouncement(1e-4, 100, 0.0)


@pytest.fixture
def table():
    return PeerTable(now=10.0)


def test_a_new_process_is_a_change_and_its_next_announcement_is_not(table):
    assert table.changed_at == 10.0
    assert table.receive(Announcement('a', WAITING, nodes=LDV), now=12.0)
    assert table.receive(Announcement('a', READY, nodes=LDV), now=13.0)
    assert table.changed_at == 12.0
    assert table.announcements['a'].state == READY


@pytest.mark.parametrize(('state', 'received'), [(INTERRUPTED, False), (FINISHED, False), (FAILED, True), (DONE, True)])
def test_the_end_of_an_earlier_run_is_ignored(table, state, received):
    assert table.receive(Announcement('a', state), now=11.0) == received
    assert ('a' in table.announcements) == received
    assert table.changed_at == (11.0 if received else 10.0)


def test_the_end_of_a_known_process_is_received(table):
    table.receive(Announcement('a', RUNNING), now=11.0)
    assert table.receive(Announcement('a', FINISHED), now=12.0)
    assert table.announcements['a'].state == FINISHED


def test_metadata_is_kept_when_it_is_announced_no_more(table):
    table.receive(Announcement('a', READY, nodes=LDV), now=11.0)
    table.receive(Announcement('a', RUNNING), now=11.5)
    assert table.announcements['a'].nodes == LDV
    table.receive(Announcement('b', RUNNING), now=11.5)
    assert table.announcements['b'].nodes == {}


def test_nodes_of_a_process_that_became_silent_are_not_counted(table):
    table.receive(Announcement('a', READY, nodes=LDV), now=11.0)
    assert dict(table.nodes(now=11.9)) == LDV
    assert not dict(table.nodes(now=12.1))


def test_two_processes_with_a_node_of_the_same_name_are_both_listed(table):
    table.receive(Announcement('a', READY, nodes=LDV), now=11.0)
    table.receive(Announcement('b', READY, nodes=LDV), now=11.0)
    assert [name for name, _ in table.nodes(now=11.0)] == ['/ldv_sensor', '/ldv_sensor']


def test_silent_processes_are_removed(table):
    table.receive(Announcement('a', READY), now=11.0)
    table.receive(Announcement('b', READY), now=13.0)
    table.remove_silent(3.0, now=14.0)
    assert table.changed_at == 13.0
    table.remove_silent(3.0, now=14.1)
    assert list(table.announcements) == ['b']
    assert table.changed_at == 14.1


def test_silence_counts_from_the_last_announcement(table):
    assert table.silence('a', now=20.0) == 0.0
    table.receive(Announcement('a', RUNNING), now=20.0)
    table.receive(Announcement('a', RUNNING), now=21.0)
    assert table.silence('a', now=23.0) == 2.0


def test_ticks_of_all_nodes(table):
    table.receive(Announcement('a', RUNNING, ticks={'/x': 3, '/y': 4}), now=11.0)
    table.receive(Announcement('b', RUNNING, ticks={'/z': 5}), now=11.0)
    assert table.ticks() == {'/x': 3, '/y': 4, '/z': 5}


def test_the_timer_is_known_from_its_announcement(table):
    table.receive(Announcement('a', WAITING), now=11.0)
    assert table.timer() is None
    table.receive(Announcement('b', WAITING, timer=TIMER), now=11.0)
    assert table.timer() == TIMER


def test_the_timer_ends_the_run_by_its_announcement_or_by_silence_after_it_was_done(table):
    table.receive(Announcement('a', FINISHED), now=11.0)
    table.receive(Announcement('b', RUNNING, timer=TIMER), now=11.0)
    assert not table.timer_has_finished()
    assert not table.timer_is_gone(3.0, now=20.0)
    table.receive(Announcement('b', DONE, timer=TIMER), now=21.0)
    assert not table.timer_is_gone(3.0, now=23.9)
    assert table.timer_is_gone(3.0, now=24.1)
    assert not table.timer_has_finished()
    table.receive(Announcement('b', FINISHED, timer=TIMER), now=24.1)
    assert table.timer_has_finished()
