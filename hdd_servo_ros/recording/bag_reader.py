"""The loop's signals of a run as plain arrays, and the messages of a bag, read by :class:`RecordedRun`."""

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.topics import ESTIMATES, PARAMETER_EVENTS
from hdd_servo_ros.parameters.events import NodeChange, unpack_parameter_event
from hdd_servo_ros.recording.bag_columns import Bag
from hdd_servo_ros.recording.recorded_run import RecordedRun, bag_directory


def read_messages(path: Path) -> dict[str, tuple[NDArray[np.int64], list[bytes]]]:
    """
    Return for every topic of a bag the receive times [ns], shape (n,), and the n payloads.

    Parameters
    ----------
    path
        Run folder or bag.
    """
    bag = Bag(bag_directory(path))
    columns = {topic: bag.column(topic) for topic in bag.types}
    return {topic: (column.times, column.as_bytes()) for topic, column in columns.items()}


def recorded_changes(path: Path) -> list[NodeChange]:
    """
    Return the parameter changes in the bag of a run, in the order in which they were recorded.

    Parameters
    ----------
    path
        Run folder or bag.
    """
    bag = Bag(bag_directory(path))
    messages = bag.column(PARAMETER_EVENTS).as_bytes() if PARAMETER_EVENTS in bag.types else []
    return [unpack_parameter_event(message) for message in messages]


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
    Return the loop's signals of a run, all at once.

    Raises
    ------
    FileNotFoundError
        If there is no bag.
    ValueError
        If a loop topic is missing or its messages are not those of consecutive ticks.
    """
    run = RecordedRun.open(path)
    return Signals(run.time, run.reference, run.head, run.ldv, run.control, run[ESTIMATES.name], run.estimate_names)
