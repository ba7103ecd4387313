"""Run with its signals in memory and the interface of a recorded run, but without a bag."""

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.recording.bag_columns import Bag
from hdd_servo_ros.recording.parameter_history import ParameterChange, ParameterHistory
from hdd_servo_ros.recording.recorded_run import RecordedRun

PATH = Path('run in memory')


class RunInMemory(RecordedRun):
    """
    Run that was computed but not recorded.

    Parameters
    ----------
    rows
        Signals from tick 0 on.
    description
        Content that ``run.yaml`` would have.
    changes
        Parameter changes during the run.
    """

    # The arrays of a run of any length are in memory already.
    is_long = False

    def __init__(self, rows: SignalRows, description: Mapping[str, Any], changes: Iterable[ParameterChange]) -> None:
        # An empty bag, so that access to messages raises the error of a missing topic.
        nothing = SimpleNamespace(path=PATH, types={}, counts={}, custom_data={})
        super().__init__(PATH, cast(Bag, nothing), dict(description), dict(description['topics']))
        self._rows_in_memory = rows
        self._changes = tuple(changes)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages that every loop topic would have."""
        return {name: len(self._rows_in_memory) for name in self._topics}

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """Ticks from 0 on, shape (n,)."""
        return self._rows_in_memory.ticks

    def __getitem__(self, topic: str) -> NDArray[Any]:
        """Return a topic by its name, with one row per tick; raise KeyError if the run lacks the topic."""
        try:
            return self._rows_in_memory[topic]
        except KeyError:
            raise self._missing(topic) from None

    def __contains__(self, topic: str) -> bool:
        """Return whether the run has a topic."""
        return topic in self._rows_in_memory

    @functools.cached_property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``run['estimates']``."""
        return self._rows_in_memory.estimate_names

    @functools.cached_property
    def _parameter_history(self) -> ParameterHistory:
        return ParameterHistory(self.path, self.description.get('nodes', {}), self._changes)
