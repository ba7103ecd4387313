"""Disturbance of a recorded run, played back unchanged in another run."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.graph.roles import RECORDED_RUN
from hdd_servo_ros.messages.topics import DISTURBANCE_SOURCE, OPTIONAL_TOPICS, LoopTopic
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import DescriptionError

PLAYED_TOPICS = tuple(topic for topic in OPTIONAL_TOPICS if topic.writer == DISTURBANCE_SOURCE)
"""Topics that can be played back: those of a disturbance source, which do not depend on the loop."""


class Playback:
    """
    Disturbance of a recorded run: values and messages of every tick.

    Parameters
    ----------
    path
        Run directory.

    Raises
    ------
    ParameterError
        If the run does not exist or contains no topic of a disturbance source.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        try:
            self._run = RecordedRun.open(Path(path))
            self.topics: tuple[LoopTopic, ...] = tuple(topic for topic in PLAYED_TOPICS if topic.name in self._run)
            self._rows = {topic.name: self._run[topic.name] for topic in self.topics}
            columns = {topic.name: self._run.column(topic.name).payloads for topic in self.topics}
        except (OSError, BagError, DescriptionError) as error:
            raise ParameterError(RECORDED_RUN, path, f'a recorded run: {error}') from None
        if not self.topics:
            names = ', '.join(f'/{topic.name}' for topic in PLAYED_TOPICS)
            raise ParameterError(RECORDED_RUN, path, f'a run that contains one of {names}')
        for name, rows in self._rows.items():
            if not np.isfinite(rows).all():
                raise ParameterError(RECORDED_RUN, path, f'a run with finite values on /{name}')
        self._messages: dict[str, NDArray[np.uint8]] = {}
        for name, payloads in columns.items():
            if isinstance(payloads, list):
                raise ParameterError(RECORDED_RUN, path, f'a run with messages of equal size on /{name}')
            self._messages[name] = payloads

    def check(self, sample_time: float, last_tick: int) -> None:
        """
        Check that the recorded run covers another one.

        Parameters
        ----------
        sample_time, last_tick
            T [s] and N of the other run.

        Raises
        ------
        ParameterError
            If the recorded run has another sample time or ends earlier.
        """
        if self._run.sample_time != sample_time:
            allowed = f'a run with sample_time = {sample_time!r} s, but this run has {self._run.sample_time!r} s'
            raise ParameterError(RECORDED_RUN, self._path, allowed)
        ticks = self._run.ticks
        if ticks[0] != 0 or len(ticks) != ticks[-1] + 1 or ticks[-1] < last_tick:
            allowed = f'a run with ticks 0 to {last_tick}, but this run has {ticks[0]} to {ticks[-1]}'
            raise ParameterError(RECORDED_RUN, self._path, allowed)

    def rows(self, topic: LoopTopic, first_tick: int, count: int) -> NDArray[np.float64]:
        """Return the values of a topic at consecutive ticks, one row per tick."""
        return self._rows[topic.name][first_tick : first_tick + count]

    def messages(self, topic: LoopTopic, first_tick: int, count: int) -> NDArray[np.uint8]:
        """Return the recorded messages of a topic at consecutive ticks, shape (count, size)."""
        return self._messages[topic.name][first_tick : first_tick + count]
