"""
First difference between two recorded runs, compared byte by byte.

``ros2 run hdd_servo_ros compare_bags RUN RUN`` prints the topic, the tick and the field where two runs first differ.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from hdd_servo_ros.messages.cdr import names_and_start, numbers
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, command, reading
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, LoopTopic
from hdd_servo_ros.recording.bag_columns import BagError, Column
from hdd_servo_ros.recording.decoding import check_layout, stamps_of
from hdd_servo_ros.recording.recorded_run import RecordedRun

_BYTES_SHOWN = 16
"""Number of bytes of a message that are shown if no number differs."""


def first_difference(
    left: Path, right: Path, last_tick: int | None = None, *, labels: tuple[str, str] | None = None
) -> str | None:
    """
    Compare the payload bytes of all loop topics of two runs.

    Parameters
    ----------
    left, right
        Run directories or bags; namespaces and storages may differ.
    last_tick
        The last tick to compare; all if None.
    labels
        Names of the two runs in the result; their paths if None.

    Returns
    -------
    str or None
        Description of the earliest difference; None if every payload is identical.
    """
    left_label, right_label = labels or (str(left), str(right))
    return _first_difference(_Side(left, left_label), _Side(right, right_label), last_tick)


def _first_difference(left: '_Side', right: '_Side', last_tick: int | None) -> str | None:
    ticks = None if last_tick is None else last_tick + 1
    if left.run.is_long and right.run.is_long:
        return _first_difference_in_pieces(left, right, ticks)
    return _earliest(_differences(left, right, ticks))


def _earliest(differences: Iterable[tuple[int, str]]) -> str | None:
    # At one tick, the first in the order of the topics, which is the direction of the data flow.
    return min(differences, key=lambda difference: difference[0], default=(0, None))[1]


class _Side:
    """One of the two runs."""

    def __init__(self, path: Path, label: str) -> None:
        self.label = label
        self.run = RecordedRun.open(path)

    first = 0
    """Number of the first message of each topic."""

    def column(self, topic: LoopTopic) -> Column:
        return self.run.column(topic.name)

    def messages(self, topic: LoopTopic) -> list[bytes]:
        return self.column(topic).as_bytes()

    def stamps(self, topic: LoopTopic) -> list[int]:
        """Return the time stamp of each message [ns]; an empty list if they cannot be read."""
        try:
            column = self.column(topic)
            check_layout(column, topic.type_name)
            stamps: list[int] = stamps_of(column, topic.type_name).tolist() if len(column) else []
        except BagError:
            return []
        return stamps

    def tick(self, stamp: int) -> int:
        return self.run.tick_of(stamp)


class _Part(_Side):
    """Some messages of one of the two runs, the same number for each topic."""

    def __init__(self, side: _Side, columns: Mapping[str, Column], first: int, count: int) -> None:
        self.label, self.run, self.first = side.label, side.run, first
        self._columns = {name: column[:count] for name, column in columns.items()}

    def column(self, topic: LoopTopic) -> Column:
        return self._columns[topic.name]


def _first_difference_in_pieces(left: _Side, right: _Side, ticks: int | None) -> str | None:
    """Return the earliest difference of two long runs, with only a few pieces of each in memory."""
    topics = list(_topics_of(left, right))
    missing = _earliest(_missing(left, right))
    if missing is not None:
        return missing
    names = [topic.name for topic in topics]
    compared = 0
    both = [side.run.column_pieces(names) for side in (left, right)]
    waiting: list[dict[str, Column]] = [{}, {}]
    while ticks is None or compared < ticks:
        for side, pieces in enumerate(both):
            if not any(map(len, waiting[side].values())):
                waiting[side] = next(pieces, {})
        count = min((len(column) for columns in waiting for column in columns.values()), default=0)
        if not all(waiting) or not count:
            break
        if ticks is not None:
            count = min(count, ticks - compared)
        one, other = (_Part(side, part, compared, count) for side, part in zip((left, right), waiting, strict=True))
        if not all(_are_the_same(one.column(topic), other.column(topic)) for topic in topics):
            found = _earliest(_differences(one, other, None))
            if found is not None:
                return found
        waiting = [{name: column[count:] for name, column in columns.items()} for columns in waiting]
        compared += count
    held = {
        topic: [min(side.run.counts[topic.name], ticks or sys.maxsize) for side in (left, right)] for topic in topics
    }
    return _earliest(
        (min(counts), _lengths(topic, left, right, counts)) for topic, counts in held.items() if counts[0] != counts[1]
    )


def _are_the_same(one: Column, other: Column) -> bool:
    """Return whether all messages are equal by a fast comparison; False if that is not possible."""
    if isinstance(one.payloads, list) or isinstance(other.payloads, list):
        return False
    return bool(np.array_equal(one.payloads, other.payloads))


def _missing(left: _Side, right: _Side) -> Iterator[tuple[int, str]]:
    """Yield each topic that one of the runs lacks, at tick -1, so that it comes before any other difference."""
    for topic in _topics_of(left, right):
        for side in (left, right):
            if topic.name not in side.run.counts:
                yield -1, f'{topic.name} is missing in {side.label}'
                break


def _lengths(topic: LoopTopic, left: _Side, right: _Side, held: Sequence[int]) -> str:
    return f'{topic.name} has {held[0]} messages in {left.label} and {held[1]} in {right.label}'


def _differences(left: _Side, right: _Side, ticks: int | None) -> Iterator[tuple[int, str]]:
    """Yield for every loop topic the tick and the description of its first difference."""
    yield from _missing(left, right)
    for topic in _topics_of(left, right):
        if any(topic.name not in side.run.counts for side in (left, right)):
            continue
        own, others = (side.messages(topic)[:ticks] for side in (left, right))
        for index, (one, other) in enumerate(zip(own, others, strict=False)):
            if one != other:
                yield _difference(topic, left, right, index, (one, other))
                break
        else:
            if len(own) != len(others):
                count = min(len(own), len(others))
                yield count, _lengths(topic, left, right, (len(own), len(others)))


def _topics_of(left: _Side, right: _Side) -> Iterator[LoopTopic]:
    """Iterate over the topics of either run; an optional topic counts only if it has messages."""
    for topic in ALL_LOOP_TOPICS:
        runs = (left.run, right.run)
        if any(topic.name in run if topic.is_optional else topic.name in run.counts for run in runs):
            yield topic


def _difference(
    topic: LoopTopic, left: _Side, right: _Side, index: int, messages: tuple[bytes, bytes]
) -> tuple[int, str]:
    """Return tick and description of a difference: of the stamps if they differ, otherwise of the first field."""
    stamps = left.stamps(topic), right.stamps(topic)
    number = left.first + index
    if not all(stamps):
        tick = number
    elif stamps[0][index] == stamps[1][index]:
        tick = left.tick(stamps[0][index])
    else:
        ticks = [left.tick(side[index]) for side in stamps]
        late = int(ticks[1] > ticks[0])
        early = 1 - late
        if stamps[early][index] not in stamps[late]:
            return ticks[early], (
                f'{topic.name}: the message of tick {ticks[early]} is missing in {(left, right)[late].label}; '
                f'that of tick {ticks[late]} comes instead'
            )
        words = f'that of tick {ticks[0]} in {left.label}, and of tick {ticks[1]} in {right.label}'
        return number, f'{topic.name} differs first at tick {number}: the stamp of message {number} is {words}'
    return tick, f'{topic.name} differs first at tick {tick}: {_field(topic, messages, (left.label, right.label))}'


def _field(topic: LoopTopic, messages: tuple[bytes, bytes], labels: tuple[str, str]) -> str:
    """Return the first field that differs between two messages, with both values."""
    one, other = messages
    codec = topic.codec
    # Arrays of different length have no first differing element; vectors may differ in length by their frame_id.
    if codec.width == 0 or (codec.width is None and len(one) != len(other)):
        pairs = []
    else:
        names, _ = names_and_start(codec, one)
        # A component without a declared name has only its own.
        fields = topic.field_names + names[len(topic.fields) :]
        pairs = list(zip(fields, numbers(codec, one), numbers(codec, other), strict=False))
    for name, own, others in pairs:
        if own != others:
            return f'{name} = {own!r} in {labels[0]} and {others!r} in {labels[1]}'
    # The difference is not in a number: it is in frame_id, in the name of an array element, or in invalid bytes.
    start = next(
        (index for index, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(map(len, messages))
    )
    parts = [_hexadecimal(message, start) for message in messages]
    return f'bytes from {start} on: {parts[0]} in {labels[0]} and {parts[1]} in {labels[1]}'


def _hexadecimal(message: bytes, start: int) -> str:
    """Return a few bytes of a message from byte ``start`` on, and the length of the message."""
    end = start + _BYTES_SHOWN
    return f'{message[start:end].hex() or "none"}{"..." if len(message) > end else ""} of {len(message)}'


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='compare_bags',
        description='Compare the loop topics of two recorded runs byte by byte, and print the first difference.',
        epilog='Exit code: 0 the runs are identical, 1 they differ, 2 invalid arguments, 3 one of them cannot be read.',
    )
    parser.add_argument('left', type=Path, metavar='RUN_A', help='run directory or bag')
    parser.add_argument('right', type=Path, metavar='RUN_B', help='run directory or bag to compare it with')
    return parser


@command('compare_bags', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two runs; return 0 if they are identical, 1 if not, 3 if one cannot be read."""
    given = command_line().parse_args(arguments)
    left, right = given.left, given.right
    sides = []
    for path in (left, right):
        with reading(path):
            sides.append(_Side(path, str(path)))
    with reading(Path(f'{left} or {right}')):
        difference = _first_difference(sides[0], sides[1], None)
    print(difference or 'identical')
    return 0 if difference is None else 1


if __name__ == '__main__':
    sys.exit(main())
