"""Last part of a long run, as a run in memory."""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import SignalRows, Signals
from hdd_servo_ros.messages.topics import ESTIMATES, SIGNAL_TOPICS
from hdd_servo_ros.recording.parameter_history import ParameterHistory
from hdd_servo_ros.recording.recorded_run import RecordedRun


class RunStretch(RecordedRun):
    """
    Last ticks of a run, with one row per tick; parameters and ``run.yaml`` are those of the whole run.

    Parameters
    ----------
    run
        A long run.
    first_tick
        First tick of the part.

    Raises
    ------
    BagError
        See :meth:`RecordedRun.pieces`.
    """

    is_long = False

    def __init__(self, run: RecordedRun, first_tick: int) -> None:
        super().__init__(run.path, run._bag, run.description, run._topics)
        self.is_checked = run.is_checked
        self._signals = joined(list(run.pieces(first_tick=first_tick)))
        self._history = run._parameter_history

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """Ticks, shape (n,)."""
        return self._signals.ticks

    def __getitem__(self, topic: str) -> NDArray[Any]:
        """Return a topic by its name, with one row per tick; raise KeyError if the topic is missing."""
        try:
            return self._signals[topic]
        except KeyError:
            raise self._missing(topic) from None

    def __contains__(self, topic: str) -> bool:
        """Return whether the stretch has a topic."""
        return topic in self._signals

    @functools.cached_property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``run['estimates']``."""
        return self._signals.estimate_names

    @functools.cached_property
    def _parameter_history(self) -> ParameterHistory:
        return self._history


def joined(pieces: list[Signals]) -> SignalRows:
    """Return pieces of consecutive ticks with the same topics as a single one."""
    first = pieces[0]
    if len(pieces) == 1 and isinstance(first, SignalRows):
        return first
    arrays = {
        topic.name: np.concatenate([piece[topic.name] for piece in pieces])
        for topic in SIGNAL_TOPICS
        if topic.name in first
    }
    names = first.estimate_names if ESTIMATES.name in first else ()
    return SignalRows(int(first.ticks[0]), first.sample_time, arrays, names, first.units)
