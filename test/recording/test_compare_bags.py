import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.compare_bags import first_difference, main

TICKS = Ticks(1e-4)
VECTOR, ARRAY = VectorCodec('drive'), ArrayCodec(['t', 'r'])


def bag(path, count=5, changes=None, leave_out=None, without=None):
    """Write a small bag; ``changes`` maps (topic, tick) to another payload, ``without`` is one that is left out."""
    topics = [(f'/{topic.name}', topic.type_name, 10) for topic in LOOP_TOPICS if topic.name != leave_out]
    writer = BagWriter(path, 'mcap', topics, {})
    for tick in range(count):
        stamp = TICKS.stamp(tick)
        for offset, (name, type_name, _) in enumerate(topics):
            payload = VECTOR.pack(stamp, tick, 2.0, 3.0)
            if type_name.endswith('Clock'):
                payload = ClockCodec.pack(stamp)
            elif type_name.endswith('Array'):
                payload = ARRAY.pack([tick * 1e-4, 0.5])
            payload = (changes or {}).get((name, tick), payload)
            if (name, tick) == without:
                continue
            writer.write((offset,), (TICKS.nanoseconds(tick),), (payload,))
    writer.close()
    return path


def test_identical(tmp_path):
    left, right = bag(tmp_path / 'a'), bag(tmp_path / 'b')
    assert first_difference(left, right) is None
    assert main([str(left), str(right)]) == 0


@pytest.mark.parametrize(
    ('other', 'words'),
    [
        (
            {'changes': {('/head', 3): VECTOR.pack(TICKS.stamp(3), 3.0, -2.0, 3.0)}},
            'head differs first at tick 3: velocity = 2.0 in the one and -2.0 in the other',
        ),
        (
            {'changes': {('/control', 3): VECTOR.pack(TICKS.stamp(3), 3.0, -2.0, 3.0)}},
            'control differs first at tick 3: before_saturation = 2.0 in the one and -2.0 in the other',
        ),
        (
            {'changes': {('/ldv', 3): VECTOR.pack(TICKS.stamp(3), 3.0, 2.0, -3.0)}},
            'ldv differs first at tick 3: z = 3.0 in the one and -3.0 in the other',
        ),
        (
            {'changes': {('/estimates', 2): ARRAY.pack([2e-4, 0.25])}},
            'estimates differs first at tick 2: r = 0.5 in the one and 0.25 in the other',
        ),
        (
            {'changes': {('/clock', 1): ClockCodec.pack(TICKS.stamp(9))}},
            'clock: the message of tick 1 is missing in the other',
        ),
        (
            {'changes': {('/ldv', 4): VECTOR.pack(TICKS.stamp(3), 4.0, 2.0, 3.0)}},
            'ldv differs first at tick 4: the stamp of message 4 is that of tick 4 in the one, and of tick 3 in the',
        ),
        (
            {'without': ('/control', 2)},
            'control: the message of tick 2 is missing in the other; that of tick 3 comes instead',
        ),
        ({'count': 4}, 'clock has 5 messages in the one and 4 in the other'),
        ({'leave_out': 'control'}, 'control is missing in'),
    ],
)
def test_the_first_difference_is_named(tmp_path, other, words):
    left, right = bag(tmp_path / 'a'), bag(tmp_path / 'b', **other)
    difference = first_difference(left, right, labels=('the one', 'the other'))
    assert difference is not None
    assert words in difference
    assert first_difference(left, right) is not None
    assert main([str(left), str(right)]) == 1


def test_a_message_missing_on_the_left_is_said_to_be(tmp_path):
    left, right = bag(tmp_path / 'a', without=('/estimates', 3)), bag(tmp_path / 'b')
    words = f'estimates: the message of tick 3 is missing in {left}; that of tick 4 comes instead'
    assert first_difference(left, right, last_tick=4) == words


def test_of_two_the_earlier_tick_then_the_earlier_topic(tmp_path):
    changed = {
        (name, tick): VECTOR.pack(TICKS.stamp(tick), -1.0, 2.0, 3.0)
        for name, tick in (('/reference', 4), ('/control', 2), ('/head', 2))
    }
    difference = first_difference(bag(tmp_path / 'a'), bag(tmp_path / 'b', changes=changed))
    assert difference is not None
    assert difference.startswith('head differs first at tick 2')


def test_signals(tmp_path):
    signals = Run.open(bag(tmp_path / 'a'))
    assert signals.time.tolist() == [0.0, 1e-4, 2e-4, 3e-4, 4e-4]
    assert signals.head[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert signals.estimate_names == ('t', 'r')
    assert signals.estimates['r'].tolist() == [0.5] * 5


@pytest.mark.parametrize(
    ('arguments', 'match'),
    [
        ({'leave_out': 'ldv'}, 'does not contain topic ldv'),
        ({'count': 0}, 'contains no tick'),
        (
            {'changes': {('/ldv', 4): VECTOR.pack(TICKS.stamp(3), 4.0, 2.0, 3.0)}},
            'the stamp of message 4 does not match its tick',
        ),
    ],
)
def test_a_bag_that_is_no_run_is_rejected(tmp_path, arguments, match):
    run = Run.open(bag(tmp_path / 'a', **arguments))
    with pytest.raises(ValueError, match=match):
        [run[topic.name] for topic in LOOP_TOPICS]


def test_no_bag(tmp_path):
    with pytest.raises(FileNotFoundError, match='neither a run folder nor a closed bag'):
        Run.open(tmp_path)


def test_what_is_no_number_is_shown_in_a_few_bytes(tmp_path):
    """A drive with a long name, which is in each message."""
    changed = {('/ldv', 3): VectorCodec('x' * 300).pack(TICKS.stamp(3), 3.0, 2.0, 3.0)}
    difference = first_difference(bag(tmp_path / 'a'), bag(tmp_path / 'b', changes=changed), labels=('the one', 'it'))
    assert difference is not None
    assert difference.startswith('ldv differs first at tick 3: bytes from 12 on: ')
    assert len(difference) < 200
    assert '... of ' in difference
