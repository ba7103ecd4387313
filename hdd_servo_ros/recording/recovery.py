"""Repairing a run's folder after a crash: a new bag of all complete ticks, and a `run.yaml` that says so."""

import contextlib
import dataclasses
import itertools
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hdd_servo_ros.messages.exit_codes import UNREADABLE
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, RECOVERED, RUNNING
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, CLOCK, PARAMETER_EVENTS, RECORDER
from hdd_servo_ros.recording.bag_columns import WRONG_DIGEST, BagError
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.disk import FULL
from hdd_servo_ros.recording.mcap_checks import WRONG_DATA
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import read_right_entries, rewrite_run_yaml
from hdd_servo_ros.recording.run_recorder import bag_metadata, queue_depth
from hdd_servo_ros.recording.salvage import STORAGE_BY_ENDING, Salvage, bag_files, complete_ticks, salvage
from hdd_servo_ros.recording.salvaged_messages import Message

BACKUP = 'damaged'
"""Folder in the run's folder for the originals of what is repaired: of `run.yaml`, and of a damaged bag."""
_WORKSHOP = 'recovering'
_COMPANIONS = ('-journal', '-wal', '-shm', '.tmp')
"""Endings of files that a database or a writer leaves beside those of a bag."""
_BATCH = 4096
"""Messages that are written at once, or a few less."""
_LEAST_SPACE = 2**20
"""Space for a repaired bag beside its messages [bytes]."""
_MEGA = 1e6
_NO_TICK = 'no tick is left'


class RecoveryError(Exception):
    """A run that cannot be repaired; says why."""

    exit_code = UNREADABLE


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    What is wrong with a run and what can be had of it.

    Attributes
    ----------
    faults
        In words; none if there is nothing to repair.
    status, reason
        What `run.yaml` is to say.
    last_tick
        The last tick that is complete on every loop topic, -1 if none is.
    kept, left
        Numbers of messages that a repaired bag holds, and of those of the incomplete tick behind it, which only the
        original holds.
    """

    faults: tuple[str, ...]
    status: str
    reason: str
    last_tick: int
    kept: int
    left: int


class Recovery:
    """
    Look at a run's folder.

    Parameters
    ----------
    run
        The folder.

    Raises
    ------
    RecoveryError
        If it is no run folder, or a process still writes into it.
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        if not (run / 'run.yaml').is_file() and not (run / 'bag').is_dir():
            raise RecoveryError(f'{run} is not a run folder: it has neither run.yaml nor bag/')
        self._said_fault = ''
        self._said = self._read_run_yaml()
        self._files = bag_files(run / 'bag')
        for file in self._files:
            if (user := _user_of(file)) is not None:
                raise RecoveryError(f'{run}: process {user} still has the bag open')
        self._whole_run: RecordedRun | None = None
        self._bag_fault = '' if self._is_given_up() else self._find_bag_fault()
        # What can be read as it is needs no other reader, and stays as it is.
        self._salvage = Salvage() if self._whole_run is not None else self._salvage_all()
        self._topics = self._loop_topics()
        self._step = self._tick_ns()
        self.finding = self._judge()

    def _read_run_yaml(self) -> dict[str, Any]:
        try:
            content, faults = read_right_entries(self.run)
        except OSError as error:
            self._said_fault = str(error)
            return {}
        if faults:
            self._said_fault = f'run.yaml: {"; ".join(faults)}'
        return content

    def _is_given_up(self) -> bool:
        """Return whether an earlier recovery has found that no tick is left, and moved the bag away."""
        moved = not (self.run / 'bag').exists() and any(self.run.glob(f'{BACKUP}*/bag'))
        return moved and self._said.get('last_tick') == -1

    def _find_bag_fault(self) -> str:
        bag = self.run / 'bag'
        if not (bag / 'metadata.yaml').is_file():
            fault = 'metadata.yaml is missing: the bag was never closed'
        else:
            try:
                # As `report` reads it, and all of it; what run.yaml says of its end is looked at on its own.
                run = RecordedRun.open_bag(bag, self._said.get('sample_time'), self._said.get('topics', {}))
                run.verify()
            except (BagError, OSError) as error:
                fault = str(error)
            else:
                self._whole_run = run
                return ''
        if unknown := self._unknown_files():
            raise RecoveryError(
                f'{unknown[0]} is neither an .mcap nor a .db3 file, and cannot be repaired here; {fault}'
            )
        return fault if self._files else 'bag/ holds neither an .mcap nor a .db3 file'

    def _unknown_files(self) -> list[Path]:
        """Return the files of the bag that only another reader knows, such as those that rosbag2 has compressed."""
        others = {path for path in (self.run / 'bag').glob('*') if path.is_file()} - set(self._files)
        return sorted(path for path in others if not path.name.endswith(('metadata.yaml', *_COMPANIONS)))

    def _salvage_all(self) -> Salvage:
        """Return what can be read of all files of the bag."""
        whole = Salvage()
        faults = []
        unchecked = False
        for file in self._files:
            found = salvage(file)
            unchecked |= not found.is_checked
            if found.unknown:
                raise RecoveryError(f'{file}: {found.unknown}, which cannot be repaired here')
            whole.types |= found.types
            whole.messages += found.messages
            if found.fault:
                faults.append(f'{file}: {found.fault}')
        whole.fault = '; '.join(faults)
        if self._bag_fault.endswith((WRONG_DIGEST, WRONG_DATA)) and unchecked:
            raise RecoveryError(
                f'{self._bag_fault}: a value was changed in the file, and nothing tells which; use a copy of the bag'
            )
        return whole

    def _loop_topics(self) -> dict[str, str]:
        """Return the loop topics' full names, by their own."""
        if isinstance(self._said.get('topics'), dict):
            return dict(self._said['topics'])
        types = self._types()
        own = {topic.name for topic in ALL_LOOP_TOPICS}
        return {name.rsplit('/', 1)[-1]: name for name in types if name.rsplit('/', 1)[-1] in own}

    def _types(self) -> dict[str, str]:
        return self._salvage.types if self._whole_run is None else self._whole_run.topics

    def _tick_ns(self) -> int:
        if 'sample_time' in self._said:
            return sample_time_to_nanoseconds(self._said['sample_time'])
        times = [time for topic, time, _ in self._salvage.messages if topic == self._topics.get(CLOCK.name)]
        return times[1] - times[0] if len(times) > 1 else 1

    def _complete_ticks(self) -> int:
        if self._whole_run is not None:
            return min((self._whole_run.counts.get(name, 0) for name in self._topics), default=0)
        return complete_ticks(self._salvage.messages, list(self._topics.values()), self._step)

    def _kept(self, ticks: int) -> Iterator[tuple[str, int, bytes]]:
        """Iterate over the messages of the first ``ticks`` ticks, and the parameter events up to them."""
        return (message for message in self._salvage.messages if self._is_kept(message, ticks))

    def _is_kept(self, message: Message, ticks: int) -> bool:
        topic, time, _ = message
        return time < ticks * self._step or (topic == PARAMETER_EVENTS and time == ticks * self._step)

    def _judge(self) -> Finding:
        ticks = self._complete_ticks()
        if self._whole_run is None:
            kept = self._salvage.messages.count(lambda message: self._is_kept(message, ticks), ticks * self._step)
            left = len(self._salvage.messages) - kept
        else:
            kept, left = self._whole_run.message_count, 0
        status, reason = self._said.get('status', RUNNING), self._said.get('reason', '')
        faults = [self._bag_fault] if self._bag_fault else []
        if self._salvage.fault:
            faults.append(self._salvage.fault)
        if self._said_fault:
            faults.append(self._said_fault)
        if status == RUNNING:
            if not self._said_fault:
                faults.append(self._status_fault())
        elif ticks - 1 != (self._said.get('last_tick') or 0):
            faults.append(f'run.yaml says {self._said.get("last_tick")} for the last tick, the bag holds {ticks - 1}')
            status = RUNNING if status == FINISHED else status
        if status == RUNNING:
            status = RECOVERED if ticks else FAILED
            reason = f'the run did not end by itself; recovered up to tick {ticks - 1}' if ticks else _NO_TICK
        elif faults and status != FINISHED:
            reason += f' (bag repaired up to tick {ticks - 1})' if ticks else f' ({_NO_TICK})'
        return Finding(tuple(faults), status, reason, ticks - 1, kept, left)

    def _status_fault(self) -> str:
        if 'status' not in self._said:
            return 'run.yaml does not say how the run ended: it has no status'
        return 'run.yaml says that the run is still running'

    @property
    def space_needed(self) -> int:
        """Space on the disk that a repair takes at most, in addition [bytes]; 0 if no bag is to be written."""
        is_written = self._files and self.finding.last_tick >= 0 and self._is_damaged
        # Index and metadata of a bag of one tick are larger than the damaged file may be.
        return _LEAST_SPACE + sum(file.stat().st_size for file in self._files) if is_written else 0

    @property
    def _is_damaged(self) -> bool:
        return bool(self._bag_fault or self._salvage.fault)

    def repair(self, output: Path | None = None) -> tuple[Path, ...]:
        """
        Repair what is wrong; the originals of what is repaired are kept in a folder of their own.

        A damaged bag is moved there even if no tick of it is left, and then there is no bag in its place.

        Parameters
        ----------
        output
            New folder for the repaired run, which may be on another disk; the run's folder then stays as it is. None to
            repair the run in its folder.

        Returns
        -------
        tuple of Path
            The originals; none if nothing was to be repaired.

        Raises
        ------
        RecoveryError
            If the disk has no room for the repaired bag; the run's folder is as it was then.
        FileExistsError
            If ``output`` exists.
        """
        if not self.finding.faults:
            return ()
        if output is not None:
            return self._repair_into(output)
        new_bag = self._write_bag(self.run / _WORKSHOP) if self.space_needed else None
        backup = _free_name(self.run / BACKUP)
        backup.mkdir()
        if (self.run / 'run.yaml').exists():
            shutil.copy2(self.run / 'run.yaml', backup / 'run.yaml')
        if self._is_damaged and (self.run / 'bag').exists():
            (self.run / 'bag').rename(backup / 'bag')
        if new_bag is not None:
            new_bag.rename(self.run / 'bag')
            new_bag.parent.rmdir()
        rewrite_run_yaml(self.run, self._new_run_yaml())
        return tuple(sorted(backup.iterdir()))

    def _repair_into(self, output: Path) -> tuple[Path, ...]:
        output.mkdir(parents=True)
        if self.space_needed:
            new_bag = self._write_bag(output / _WORKSHOP)
            new_bag.rename(output / 'bag')
            new_bag.parent.rmdir()
        elif not self._is_damaged and (self.run / 'bag').exists():
            shutil.copytree(self.run / 'bag', output / 'bag')
        rewrite_run_yaml(output, self._new_run_yaml())
        return tuple(path for path in (self.run / 'bag', self.run / 'run.yaml') if path.exists())

    def _new_run_yaml(self) -> dict[str, Any]:
        found = {'status': self.finding.status, 'reason': self.finding.reason, 'last_tick': self.finding.last_tick}
        return {'topics': self._topics, **self._said, **found}

    def _write_bag(self, workshop: Path) -> Path:
        shutil.rmtree(workshop, ignore_errors=True)
        free = shutil.disk_usage(workshop.parent).free
        if free < self.space_needed:
            raise self._no_space(free)
        workshop.mkdir()
        try:
            return self._write_bag_into(workshop)
        except OSError as error:
            shutil.rmtree(workshop, ignore_errors=True)
            if error.errno not in FULL:
                raise
            raise self._no_space(shutil.disk_usage(workshop.parent).free) from None

    def _no_space(self, free: int) -> RecoveryError:
        needed = math.ceil(self.space_needed / _MEGA)
        return RecoveryError(
            f'{self.run}: the repaired bag needs up to {needed} MB of disk space, and {free / _MEGA:.1f} MB are '
            'free: make room, or name a folder on another disk with --output'
        )

    def _write_bag_into(self, workshop: Path) -> Path:
        types = self._salvage.types
        indices = {topic: index for index, topic in enumerate(types)}
        writer = BagWriter(
            workshop / 'bag',
            STORAGE_BY_ENDING[self._files[0].suffix],
            [(topic, kind, queue_depth(topic)) for topic, kind in types.items()],
            bag_metadata(self._said),
            self._options(),
        )
        kept = self._kept(self.finding.last_tick + 1)
        # Whole ticks at a time, which are written many times faster.
        whole = max(1, len(self._topics))
        while batch := list(itertools.islice(kept, _BATCH // whole * whole)):
            topics, times, payloads = zip(*batch, strict=True)
            writer.write([indices[topic] for topic in topics], times, payloads)
        writer.close()
        try:
            RecordedRun.open_bag(workshop / 'bag', self._said.get('sample_time'), self._topics).verify()
        except BagError as error:
            shutil.rmtree(workshop)
            raise RecoveryError(f'what is left of the bag cannot be read either: {error}') from None
        return workshop / 'bag'

    def _options(self) -> BagOptions:
        """Return how the bag was to be stored, by the parameters of its recorder; the defaults where nothing tells."""
        nodes = self._said.get('nodes', {})
        recorders = [node['parameters'] for name, node in nodes.items() if name.rsplit('/', 1)[-1] == RECORDER]
        known = {field.name for field in dataclasses.fields(BagOptions)}
        found = recorders[0] if recorders else {}
        return BagOptions(**{name: value for name, value in found.items() if name in known})


def _free_name(path: Path) -> Path:
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f'{path.name}-{number}')
    return candidate


def _user_of(file: Path) -> int | None:
    """Return a process that has a file open, as far as this user may know; None where there is no /proc."""
    target = file.resolve()
    for process in Path('/proc').glob('[0-9]*'):
        # Processes end while they are looked at, and descriptors are closed.
        with contextlib.suppress(OSError):
            for descriptor in (process / 'fd').iterdir():
                with contextlib.suppress(OSError):
                    if descriptor.readlink() == target:
                        return int(process.name)
    return None
