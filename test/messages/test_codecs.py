"""Each topic of the loop declares once how its messages are packed and unpacked."""

import numpy as np
import pytest

from hdd_servo_ros.messages.cdr import STAMP, names_and_start, numbers, row_layout, stamp_rows
from hdd_servo_ros.messages.codecs import CODECS, REPORTS
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, ESTIMATES, RECORDED

NAMES = ('t', 'r', 'm_hat', 'e')


@pytest.mark.parametrize('topic', ALL_LOOP_TOPICS, ids=lambda topic: topic.name)
@pytest.mark.parametrize('frame_id', ['', 'drive', 'a longer name'])
def test_what_is_packed_is_read_again(topic, frame_id):
    codec = topic.codec
    width = len(NAMES) if codec.width is None else codec.width
    stamps = stamp_rows(np.array([7_000_000_100, 8_000_000_200]))
    values = np.random.default_rng(1).normal(size=(2, width))
    layout = row_layout(codec, frame_id, NAMES)
    rows = np.tile(np.frombuffer(layout.template, np.uint8), (2, 1))
    layout.fill(rows, stamps, values)
    messages = [row.tobytes() for row in rows]
    assert len(messages) == 2
    for message, stamp, expected in zip(messages, stamps, values, strict=True):
        assert (message[STAMP] == stamp.tobytes()) == codec.is_stamped
        if width:
            names, start = names_and_start(codec, message)
            assert names == (NAMES if topic is ESTIMATES else codec.components)
            assert np.frombuffer(message[start:]).tolist() == expected.tolist() == numbers(codec, message)


@pytest.mark.parametrize('topic', [*ALL_LOOP_TOPICS, RECORDED], ids=lambda topic: topic.name)
def test_a_topic_declares_no_more_than_its_messages_carry(topic):
    assert CODECS[topic.type_name] is topic.codec
    assert len(topic.fields) <= len(topic.codec.components)


def test_reports_are_made_one_by_one():
    with pytest.raises(KeyError):
        row_layout(REPORTS, 'drive', NAMES)
