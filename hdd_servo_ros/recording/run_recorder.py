"""Recorder of one run: directory, bag and outcome."""

import contextlib
import itertools
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.graph.catalog import CONTROLLERS
from hdd_servo_ros.messages.errors import DiskError, RunError
from hdd_servo_ros.messages.outcome import FAILED, FINISHED
from hdd_servo_ros.messages.tick_messages import TickMessages
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import CONTROL, PARAMETER_EVENT_TYPE, PARAMETER_EVENTS, QUEUE_DEPTH, LoopTopic
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.recording.bag_columns import Bag, BagError
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.run_folder import RunFolder, default_run_directory
from hdd_servo_ros.recording.writer_process import WriterProcess

_PARAMETER_EVENT_DEPTH = 1000
_ATTEMPTS = 100


class _Faults:
    """Record of a writer failure: later messages must not be written, and earlier ones may be missing in the bag."""

    def __init__(self) -> None:
        self.has_failed = False

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        self.has_failed |= kind is not None
        if isinstance(error, OSError) and not isinstance(error, DiskError):
            raise DiskError.of(error) from error


class RunRecorder:
    """
    Writer of a run's messages into its bag.

    Parameters
    ----------
    run_dir
        Run directory; empty for ``runs/<date-time>-<controller>``.
    storage
        ``mcap`` or ``sqlite3``.
    topics
        For every topic with one message per tick: the loop topic and its full name.
    recorded
        Names of the topics to record; all if empty.
    options
        Compression and splitting of the bag.
    description
        Entries of ``run.yaml``; ``nodes`` are those of :class:`hdd_servo_ros.ros.run_plan.RunPlan`.
    separate_process
        Whether a second process writes the bag; faster if the loop alone keeps one core busy.
    process
        This process, from :func:`~hdd_servo_ros.recording.writer_process.launch_writer`; started here if not given.

    Raises
    ------
    FileExistsError
        If the directory exists.
    ParameterError
        If none of the topics is recorded.
    """

    def __init__(
        self,
        run_dir: str,
        storage: str,
        topics: Sequence[tuple[LoopTopic, str]],
        description: Mapping[str, Any],
        *,
        separate_process: bool,
        recorded: Sequence[str] = (),
        options: BagOptions = BagOptions(),  # noqa: B008 - a frozen value
        process: 'subprocess.Popen[bytes] | None' = None,
    ) -> None:
        self._chosen = _chosen(topics, recorded)
        published, topics = topics, [topics[index] for index in self._chosen]
        self.topics: list[LoopTopic] = [topic for topic, _ in topics]
        """Loop topics that are recorded."""
        controller = controller_name(description['nodes'])
        names = self._names = {topic.name: full_name for topic, full_name in topics}
        entries = {'controller': controller, 'storage': storage, 'topics': names, **description}
        left_out = {topic.name: full_name for topic, full_name in published if topic.name not in names}
        if left_out:
            entries['topics_left_out'] = left_out
        self._folder = RunFolder(Path(run_dir), entries) if run_dir else _default_folder(controller, entries)
        listed = [(full_name, topic.type_name, queue_depth(full_name)) for topic, full_name in topics]
        listed.append((PARAMETER_EVENTS, PARAMETER_EVENT_TYPE, queue_depth(PARAMETER_EVENTS)))
        metadata = bag_metadata(description)
        self._writer: WriterProcess | BagWriter | None = None
        try:
            if separate_process:
                self._writer = WriterProcess(self._folder.bag, storage, listed, metadata, options, process)
            else:
                self._writer = BagWriter(self._folder.bag, storage, listed, metadata, options)
        except Exception as error:
            self._folder.close(FAILED, f'the bag cannot be opened: {error}', -1)
            raise
        self._noting_faults = _Faults()
        self._loop_topics = tuple(range(len(topics)))
        self._parameter_events = len(topics)
        self._last_tick = -1
        self._last_tick_planned = description.get('last_tick_planned')
        self._started = self._first_tick_at = time.monotonic()
        self._last_tick_at: float | None = None
        self._sample_time = float(description['sample_time'])

    @property
    def directory(self) -> Path:
        """Run directory."""
        return self._folder.directory

    @property
    def is_open(self) -> bool:
        """Whether the bag accepts messages: it is not closed, and its writer has not failed."""
        return self._writer is not None and not self._noting_faults.has_failed

    def write_tick(self, tick: int, stamp_ns: int, messages: Sequence[bytes]) -> None:
        """Write the messages of one tick, one per topic of the run; their receive time is the time of the tick [ns]."""
        assert self._writer is not None
        if len(self._chosen) < len(messages):
            messages = [messages[index] for index in self._chosen]
        with self._noting_faults:
            self._writer.write(self._loop_topics, (stamp_ns,) * len(messages), messages)
        self._set_last_tick(tick)

    def write_columns(self, first_tick: int, stamps_ns: Sequence[int], columns: Sequence[Sequence[bytes]]) -> None:
        """
        Write the messages of consecutive ticks; equivalent to :meth:`write_tick` for each tick.

        Parameters
        ----------
        first_tick
            First tick.
        stamps_ns
            Time of each tick [ns].
        columns
            Messages of each topic of the run, one per tick.
        """
        assert self._writer is not None
        chosen = [columns[index] for index in self._chosen]
        count, topics = len(stamps_ns), len(chosen)
        stamps = itertools.chain.from_iterable(zip(*[stamps_ns] * topics, strict=True))
        messages = itertools.chain.from_iterable(zip(*chosen, strict=True))
        with self._noting_faults:
            self._writer.write(self._loop_topics * count, list(stamps), list(messages))
        self._set_last_tick(first_tick + count - 1)

    def _set_last_tick(self, tick: int) -> None:
        if tick == 0:
            self._first_tick_at = time.monotonic()
        elif tick == self._last_tick_planned:
            # The bag is closed after all processes have shut down, which does not count towards the real-time factor.
            self._last_tick_at = time.monotonic()
        self._last_tick = tick

    def write_ticks(self, last_tick: int, messages: TickMessages) -> None:
        """Write the messages of many ticks up to ``last_tick``, one per tick and topic of :attr:`topics`."""
        assert isinstance(self._writer, BagWriter)
        with self._noting_faults:
            self._writer.write_ticks(self._loop_topics, messages)
        self._last_tick = last_tick

    def write_parameter_event(self, stamp_ns: int, message: bytes) -> None:
        """Write a parameter event with the time [ns] of the tick at which it took effect."""
        assert self._writer is not None
        with self._noting_faults:
            self._writer.write((self._parameter_events,), (stamp_ns,), (message,))

    def close_bag(self) -> None:
        """Close the bag; a second call has no effect."""
        writer, self._writer = self._writer, None
        if writer is not None:
            if self._last_tick_at is None:
                self._last_tick_at = time.monotonic()
            writer.close()

    def finish(self, status: str, reason: str) -> None:
        """
        Close the bag if it is still open, and record in ``run.yaml`` how the run ended.

        After a writer failure, the last tick is the last one on the disk, and a finished run counts as failed.

        Raises
        ------
        RunError
            If the bag cannot be closed; ``run.yaml`` then records this.
        OSError
            If ``run.yaml`` cannot be written.
        """
        fault: RunError | None = None
        try:
            with self._noting_faults:
                self.close_bag()
        except RunError as error:
            fault = error
        if self._noting_faults.has_failed:
            self._last_tick = self._last_tick_on_disk()
            if status == FINISHED:
                status, reason = FAILED, str(fault or 'a part of the bag could not be written')
        looped = max((self._last_tick_at or time.monotonic()) - self._first_tick_at, 1e-9)
        self._folder.close(
            status,
            reason,
            self._last_tick,
            wall_time=round(time.monotonic() - self._started, 3),
            real_time_factor=float(f'{max(self._last_tick, 0) * self._sample_time / looped:.4g}'),
        )
        if fault is not None:
            raise fault

    def flush(self) -> None:
        """Hand over all messages queued in this process, so that they survive its end."""
        if self._writer is not None and self.is_open:
            with self._noting_faults:
                self._writer.flush()

    def _last_tick_on_disk(self) -> int:
        """Return the last complete tick in the bag after a writer failure; -1 if no tick is complete."""
        from hdd_servo_ros.recording.salvage import last_tick_of

        step = sample_time_to_nanoseconds(self._sample_time)
        topics = [self._names[topic.name] for topic in self.topics]
        try:
            if (self._folder.bag / 'metadata.yaml').is_file():
                # The bag was closed with all messages written before the failure.
                counts = Bag(self._folder.bag).counts
                return min(counts[topic] for topic in topics) - 1
            return last_tick_of(self._folder.bag, topics, step)
        except (OSError, BagError):
            return -1


def _chosen(topics: Sequence[tuple[LoopTopic, str]], recorded: Sequence[str]) -> list[int]:
    """Return the indices of the topics to record."""
    chosen = [index for index, (topic, _) in enumerate(topics) if not recorded or topic.name in recorded]
    if recorded and not chosen:
        present = ', '.join(topic.name for topic, _ in topics)
        raise ParameterError('bag_recorder:topics', tuple(recorded), f'names of topics of this run: {present}')
    return chosen


def queue_depth(topic: str) -> int:
    """Return the queue depth offered by the publishers of a topic, given by its full name."""
    return _PARAMETER_EVENT_DEPTH if topic == PARAMETER_EVENTS else QUEUE_DEPTH


def bag_metadata(description: Mapping[str, Any]) -> dict[str, str]:
    """Return the metadata stored in the bag, for readers without ``run.yaml``."""
    keys = ('sample_time', 'duration', 'frame_id', 'length_unit', 'control_unit')
    return {key: str(description[key]) for key in keys if key in description}


def controller_name(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the short name of the controller: the node among ``nodes`` that publishes the control topic."""
    for full_name, node in nodes.items():
        if any(topic.rsplit('/', 1)[-1] == CONTROL.name for topic in node['outputs']):
            name = full_name.rsplit('/', 1)[-1]
            return next((short for short, long in CONTROLLERS.items() if long == name), name)
    return 'no_controller'


def _default_folder(controller: str, description: Mapping[str, Any]) -> RunFolder:
    """Create a directory with a unique name, even if two runs start in the same second."""
    for _ in range(_ATTEMPTS):
        with contextlib.suppress(FileExistsError):
            return RunFolder(default_run_directory(controller), description)
    raise FileExistsError(f'no free name for a run directory in {Path("runs").absolute()}')
