"""Announcements of a process: encoding and decoding."""

import json

import pytest

from hdd_servo_ros.ros.announcement import (
    READY,
    RUNNING,
    Announcement,
    AnnouncementError,
    TimerAnnouncement,
    decode,
)

OF_TIMER = Announcement(
    'host:1:a',
    READY,
    ticks={'/deterministic_timer': 0},
    changes={'/deterministic_timer': 0},
    nodes={'/deterministic_timer': {'inputs': ['/control'], 'outputs': ['/clock'], 'offers': {}, 'parameters': {}}},
    receives=['host:2:b'],
    timer=TimerAnnouncement(1e-4, 100, 0.0, ['0.005 pid_controller k_p 1.0']),
)


def test_an_announcement_survives_its_encoding():
    assert decode(OF_TIMER.encode()) == OF_TIMER


def test_the_keys_of_the_json():
    """The scope reads `state`; the other keys are used only by the processes of a run."""
    assert list(json.loads(OF_TIMER.encode())) == [
        'process',
        'state',
        'reason',
        'ticks',
        'changes',
        'nodes',
        'receives',
        'timer',
    ]


def test_null_values_are_omitted():
    announcement = Announcement('host:1:a', RUNNING, timer=TimerAnnouncement(1e-4, 100, 0.0))
    content = json.loads(announcement.encode())
    assert not {'nodes', 'receives', 'directory', 'run'} & set(content)
    assert content['timer'] == {'sample_time': 1e-4, 'last_tick': 100, 'rate': 0.0}
    assert decode(announcement.encode()) == announcement


def test_unknown_keys_are_ignored():
    text = (
        '{"process": "a", "state": "ready", "mood": 1, "timer": {"sample_time": 1, "last_tick": 2, "rate": 0, "x": 1}}'
    )
    assert decode(text) == Announcement('a', READY, timer=TimerAnnouncement(1, 2, 0))


@pytest.mark.parametrize(
    'text',
    [
        '',
        'hello',
        '7',
        '"process"',
        '["process", "state"]',
        'null',
        '{}',
        '{"process": "a"}',
        '{"state": "ready"}',
        '{"process": "a", "state": "ready", "timer": null}',
        '{"process": "a", "state": "ready", "timer": {}}',
    ],
)
def test_an_invalid_announcement_is_rejected(text):
    with pytest.raises(AnnouncementError):
        decode(text)
