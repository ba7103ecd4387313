"""
The first difference between two recorded runs, bit by bit.

``python -m hdd_servo_ros.recording.compare_bags RUN RUN`` says where two runs part: topic, tick and field.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from hdd_servo_ros.recording.cdr import array_names_and_offset, unpack_vector
from hdd_servo_ros.recording.recorded_run import Run
from hdd_servo_ros.topics import ARRAY_TYPE, LOOP_TOPICS, VECTOR_TYPE, LoopTopic

_AXES = ('x', 'y', 'z')


def first_difference(left: Path, right: Path, last_tick: int | None = None) -> str | None:
    """
    Compare the payload bytes of all loop topics of two runs.

    Parameters
    ----------
    left, right
        Run folders or bags; namespaces and storages may differ.
    last_tick
        The last tick to compare; all if None.

    Returns
    -------
    str or None
        The earliest difference in words, None if every payload is identical.
    """
    differences = list(_differences(left, right, None if last_tick is None else last_tick + 1))
    # Of several at one tick the first in the order of the topics, along which data flows.
    return min(differences, key=lambda difference: difference[0])[1] if differences else None


def _differences(left: Path, right: Path, ticks: int | None) -> Iterator[tuple[int, str]]:
    """Yield for every loop topic the tick of its first difference, and that difference in words."""
    both = [_loop_messages(path) for path in (left, right)]
    for topic in LOOP_TOPICS:
        missing = [path for path, messages in zip((left, right), both, strict=True) if topic.name not in messages]
        if missing:
            yield -1, f'{topic.name} is missing in {missing[0]}'
            continue
        ours, theirs = (messages[topic.name][:ticks] for messages in both)
        for tick, (one, other) in enumerate(zip(ours, theirs, strict=False)):
            if one != other:
                yield tick, f'{topic.name} differs first at tick {tick}: {_field(topic, one, other)}'
                break
        else:
            if len(ours) != len(theirs):
                count = min(len(ours), len(theirs))
                yield count, f'{topic.name} has {len(ours)} messages in {left} and {len(theirs)} in {right}'


def _loop_messages(path: Path) -> dict[str, list[bytes]]:
    run = Run.open(path)
    return {topic: run.column(topic).as_bytes() for topic in run.counts}


def _field(topic: LoopTopic, one: bytes, other: bytes) -> str:
    """Return the first field in which two messages differ, with both values."""
    if topic.type_name == VECTOR_TYPE:
        pairs = list(zip(_AXES, unpack_vector(one), unpack_vector(other), strict=True))
    elif topic.type_name == ARRAY_TYPE and len(one) == len(other):
        names, offset = array_names_and_offset(one)
        pairs = list(zip(names, _array(one, offset), _array(other, offset), strict=False))
    else:
        pairs = []
    for name, ours, theirs in pairs:
        if ours != theirs:
            return f'{name} = {ours!r} and {theirs!r}'
    return f'{one.hex()} and {other.hex()}'


def _array(message: bytes, offset: int) -> Sequence[float]:
    return memoryview(message)[offset:].cast('B').cast('d').tolist()


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two runs; exit code 0 if they are identical, 1 if not."""
    parser = argparse.ArgumentParser(description='Compare the loop topics of two recorded runs, byte by byte.')
    parser.add_argument('run', type=Path, nargs=2, help='run folder or bag')
    left, right = parser.parse_args(arguments).run
    difference = first_difference(left, right)
    print(difference or 'identical')
    return 0 if difference is None else 1


if __name__ == '__main__':
    sys.exit(main())
