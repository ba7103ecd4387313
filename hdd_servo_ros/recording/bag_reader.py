"""A recorded run as numpy arrays."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader

from hdd_servo_ros.recording.cdr import STAMP, array_names_and_offset
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.ticks import NANOSECONDS
from hdd_servo_ros.topics import ARRAY_TYPE, CLOCK_TYPE, DISTURBANCE, ESTIMATES, LOOP_TOPICS, VECTOR_TYPE


def bag_directory(path: Path) -> Path:
    """
    Return the bag of a run folder, or the path itself if it is a bag.

    Raises
    ------
    FileNotFoundError
        If it is neither.
    """
    for candidate in (path / 'bag', path):
        if (candidate / 'metadata.yaml').is_file():
            return candidate
    raise FileNotFoundError(f'{path} is neither a run folder nor a closed bag: no metadata.yaml in it or in its bag/')


def loop_topic_names(path: Path, names: Iterable[str]) -> dict[str, str]:
    """
    Return for each loop topic's own name the full name that it has in a bag.

    Parameters
    ----------
    path
        Run folder or bag; the ``run.yaml`` beside the bag knows of remappings.
    names
        Full names of the bag's topics.
    """
    for directory in (path, path.parent):
        if (directory / 'run.yaml').is_file():
            return dict(read_run_yaml(directory)['topics'])
    own = {topic.name for topic in (*LOOP_TOPICS, DISTURBANCE)}
    return {name.rsplit('/', 1)[-1]: name for name in names if name.rsplit('/', 1)[-1] in own}


def read_messages(path: Path) -> dict[str, tuple[NDArray[np.int64], list[bytes]]]:
    """
    Return for every topic of a bag the receive times [ns], shape (n,), and the n payloads.

    Parameters
    ----------
    path
        Run folder or bag.
    """
    messages: dict[int, tuple[list[int], list[bytes]]] = {}
    with Reader(bag_directory(path)) as reader:
        for connection in reader.connections:
            messages[connection.id] = ([], [])
        for connection, stamp, payload in reader.messages():
            stamps, payloads = messages[connection.id]
            stamps.append(stamp)
            payloads.append(bytes(payload))
        return {
            connection.topic: (np.array(messages[connection.id][0], dtype=np.int64), messages[connection.id][1])
            for connection in reader.connections
        }


@dataclasses.dataclass(frozen=True)
class Signals:
    """
    The loop's signals, aligned by tick; N + 1 rows.

    Attributes
    ----------
    time
        Time of each tick [s], shape (N + 1,).
    reference, head, ldv, control
        The vectors of these topics, shape (N + 1, 3), in the topics' units.
    estimates
        Array of shape (N + 1, m), its columns named by ``estimate_names``.
    """

    time: NDArray[np.float64]
    reference: NDArray[np.float64]
    head: NDArray[np.float64]
    ldv: NDArray[np.float64]
    control: NDArray[np.float64]
    estimates: NDArray[np.float64]
    estimate_names: tuple[str, ...]


def read_signals(path: Path) -> Signals:
    """
    Return the loop's signals of a run.

    Raises
    ------
    FileNotFoundError
        If there is no bag.
    ValueError
        If a loop topic is missing or its messages are not those of consecutive ticks.
    """
    messages = read_messages(path)
    names = loop_topic_names(path, messages)
    by_name: dict[str, list[bytes]] = {}
    times: NDArray[np.int64] | None = None
    for topic in LOOP_TOPICS:
        name = names.get(topic.name, '')
        if name not in messages:
            raise ValueError(f'{path}: the bag holds no topic {topic.name}')
        stamps, payloads = messages[name]
        if times is None:
            times = stamps
        if not np.array_equal(stamps, times):
            raise ValueError(f'{path}: the stamps of {name} are not those of the clock')
        if len(stamps) and (stamp := _first_wrong_stamp(topic.type_name, stamps, payloads)) is not None:
            raise ValueError(f'{path}: {name}: message {stamp} does not carry the stamp of its tick')
        by_name[topic.name] = payloads
    assert times is not None
    if len(times) == 0:
        raise ValueError(f'{path}: the bag holds no tick')
    labels, offset = array_names_and_offset(by_name[ESTIMATES.name][0])
    return Signals(
        time=times / NANOSECONDS,
        **{name: _doubles(by_name[name], -24) for name in ('reference', 'head', 'ldv', 'control')},
        estimates=_doubles(by_name[ESTIMATES.name], offset),
        estimate_names=labels,
    )


def _doubles(payloads: list[bytes], start: int) -> NDArray[np.float64]:
    """Return the float64 numbers from byte ``start`` on of messages of equal length."""
    rows = np.frombuffer(b''.join(payloads), dtype=np.uint8).reshape(len(payloads), -1)
    return np.ascontiguousarray(rows[:, start:]).view('<f8')


def _first_wrong_stamp(type_name: str, stamps: NDArray[np.int64], payloads: list[bytes]) -> int | None:
    """Return the place of the first message whose own stamp is not its receive time."""
    if type_name not in (CLOCK_TYPE, VECTOR_TYPE):
        return None
    assert type_name != ARRAY_TYPE
    rows = np.frombuffer(b''.join(payload[STAMP] for payload in payloads), dtype=[('s', '<i4'), ('ns', '<u4')])
    wrong = np.flatnonzero(rows['s'].astype(np.int64) * NANOSECONDS + rows['ns'] != stamps)
    return int(wrong[0]) if len(wrong) else None
