"""Repair of a run directory after a crash: a new bag of all complete ticks, and an updated `run.yaml`."""

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
"""Directory within the run directory for the original `run.yaml` and the damaged bag."""
_WORKSHOP = 'recovering'
_COMPANIONS = ('-journal', '-wal', '-shm', '.tmp')
"""Endings of files that a database or a writer leaves next to those of a bag."""
_BATCH = 4096
"""Largest number of messages that are written at once."""
_LEAST_SPACE = 2**20
"""Space that a repaired bag needs in addition to its messages [bytes]."""
_MEGA = 1e6
_NO_TICK = 'no complete tick is left'


class RecoveryError(Exception):
    """A run that cannot be repaired; the text gives the reason."""

    exit_code = UNREADABLE


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    Damage found in a run, and the part that can be recovered.

    Attributes
    ----------
    faults
        Description of each fault; empty if the run is intact.
    status, reason
        Entries of `run.yaml` after the repair.
    last_tick
        The last tick that is complete on every loop topic; -1 if no tick is.
    kept, left
        Number of messages in a repaired bag, and number of messages after them, which remain in the original only.
    """

    faults: tuple[str, ...]
    status: str
    reason: str
    last_tick: int
    kept: int
    left: int


class Recovery:
    """
    Examination and repair of a run directory.

    Parameters
    ----------
    run
        The run directory.

    Raises
    ------
    RecoveryError
        If it is not a run directory, or a process still has its bag open.
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        if not (run / 'run.yaml').is_file() and not (run / 'bag').is_dir():
            raise RecoveryError(f'{run} is not a run folder: it has neither run.yaml nor bag/')
        self._description_fault = ''
        self._description = self._read_run_yaml()
        self._files = bag_files(run / 'bag')
        for file in self._files:
            if (user := _user_of(file)) is not None:
                raise RecoveryError(f'{run}: process {user} still has the bag open')
        self._intact_run: RecordedRun | None = None
        self._bag_fault = '' if self._is_given_up() else self._find_bag_fault()
        # An intact bag stays unchanged, so its messages need not be salvaged.
        self._salvage = Salvage() if self._intact_run is not None else self._salvage_all()
        self._topics = self._loop_topics()
        self._step = self._tick_ns()
        self.finding = self._judge()

    def _read_run_yaml(self) -> dict[str, Any]:
        try:
            content, faults = read_right_entries(self.run)
        except OSError as error:
            self._description_fault = str(error)
            return {}
        if faults:
            self._description_fault = f'run.yaml: {"; ".join(faults)}'
        return content

    def _is_given_up(self) -> bool:
        """Return whether an earlier repair found no complete tick and moved the bag away."""
        moved = not (self.run / 'bag').exists() and any(self.run.glob(f'{BACKUP}*/bag'))
        return moved and self._description.get('last_tick') == -1

    def _find_bag_fault(self) -> str:
        bag = self.run / 'bag'
        if not (bag / 'metadata.yaml').is_file():
            fault = 'metadata.yaml is missing: the bag was never closed'
        else:
            try:
                # Read all of it, as `report` would; how the run ended according to run.yaml is checked separately.
                run = RecordedRun.open_bag(
                    bag, self._description.get('sample_time'), self._description.get('topics', {})
                )
                run.verify()
            except (BagError, OSError) as error:
                fault = str(error)
            else:
                self._intact_run = run
                return ''
        if unknown := self._unknown_files():
            raise RecoveryError(
                f'{unknown[0]} is neither an .mcap nor a .db3 file, so recover cannot repair it; {fault}'
            )
        return fault if self._files else 'bag/ contains neither an .mcap nor a .db3 file'

    def _unknown_files(self) -> list[Path]:
        """Return the files that this package cannot read, such as files compressed by rosbag2."""
        others = {path for path in (self.run / 'bag').glob('*') if path.is_file()} - set(self._files)
        return sorted(path for path in others if not path.name.endswith(('metadata.yaml', *_COMPANIONS)))

    def _salvage_all(self) -> Salvage:
        """Return the messages that can be read from all files of the bag."""
        total = Salvage()
        faults = []
        unchecked = False
        for file in self._files:
            found = salvage(file)
            unchecked |= not found.is_checked
            if found.unknown:
                raise RecoveryError(f'{file}: {found.unknown}, so recover cannot repair it')
            total.types |= found.types
            total.messages += found.messages
            if found.fault:
                faults.append(f'{file}: {found.fault}')
        total.fault = '; '.join(faults)
        if self._bag_fault.endswith((WRONG_DIGEST, WRONG_DATA)) and unchecked:
            raise RecoveryError(
                f'{self._bag_fault}: the bag contains a changed value that cannot be located; use a copy of the bag'
            )
        return total

    def _loop_topics(self) -> dict[str, str]:
        """Return the full names of the loop topics, by their names without namespace."""
        if isinstance(self._description.get('topics'), dict):
            return dict(self._description['topics'])
        types = self._types()
        own = {topic.name for topic in ALL_LOOP_TOPICS}
        return {name.rsplit('/', 1)[-1]: name for name in types if name.rsplit('/', 1)[-1] in own}

    def _types(self) -> dict[str, str]:
        return self._salvage.types if self._intact_run is None else self._intact_run.topics

    def _tick_ns(self) -> int:
        if 'sample_time' in self._description:
            return sample_time_to_nanoseconds(self._description['sample_time'])
        times = [time for topic, time, _ in self._salvage.messages if topic == self._topics.get(CLOCK.name)]
        return times[1] - times[0] if len(times) > 1 else 1

    def _complete_ticks(self) -> int:
        if self._intact_run is not None:
            return min((self._intact_run.counts.get(name, 0) for name in self._topics), default=0)
        return complete_ticks(self._salvage.messages, list(self._topics.values()), self._step)

    def _kept(self, ticks: int) -> Iterator[tuple[str, int, bytes]]:
        """Iterate over the messages of the first ``ticks`` ticks and the parameter events up to their end."""
        return (message for message in self._salvage.messages if self._is_kept(message, ticks))

    def _is_kept(self, message: Message, ticks: int) -> bool:
        topic, time, _ = message
        return time < ticks * self._step or (topic == PARAMETER_EVENTS and time == ticks * self._step)

    def _judge(self) -> Finding:
        ticks = self._complete_ticks()
        if self._intact_run is None:
            kept = self._salvage.messages.count(lambda message: self._is_kept(message, ticks), ticks * self._step)
            left = len(self._salvage.messages) - kept
        else:
            kept, left = self._intact_run.message_count, 0
        status, reason = self._description.get('status', RUNNING), self._description.get('reason', '')
        faults = [self._bag_fault] if self._bag_fault else []
        if self._salvage.fault:
            faults.append(self._salvage.fault)
        if self._description_fault:
            faults.append(self._description_fault)
        if status == RUNNING:
            if not self._description_fault:
                faults.append(self._status_fault())
        elif ticks - 1 != ((claimed := self._description.get('last_tick')) or 0):
            faults.append(f'last_tick in run.yaml is {claimed}, but the last tick in the bag is {ticks - 1}')
            status = RUNNING if status == FINISHED else status
        if status == RUNNING:
            status = RECOVERED if ticks else FAILED
            reason = f'the run was killed; recovered up to tick {ticks - 1}' if ticks else _NO_TICK
        elif faults and status != FINISHED:
            reason += f' (bag repaired up to tick {ticks - 1})' if ticks else f' ({_NO_TICK})'
        return Finding(tuple(faults), status, reason, ticks - 1, kept, left)

    def _status_fault(self) -> str:
        if 'status' not in self._description:
            return 'run.yaml has no status'
        return 'status in run.yaml is still running'

    @property
    def space_needed(self) -> int:
        """Largest additional disk space that a repair needs [bytes]; 0 if no bag is written."""
        is_written = self._files and self.finding.last_tick >= 0 and self._is_damaged
        # For a bag of one tick, index and metadata can be larger than the whole damaged file.
        size = sum(file.stat().st_size for file in self._files)
        # An sqlite3 bag without checksums per block grows by 0.1 %.
        return _LEAST_SPACE + size + size // 500 if is_written else 0

    @property
    def _is_damaged(self) -> bool:
        return bool(self._bag_fault or self._salvage.fault)

    def repair(self, output: Path | None = None) -> tuple[Path, ...]:
        """
        Repair the run and keep the originals in a separate directory.

        A damaged bag is moved there even if no tick can be recovered; the run directory then has no bag.

        Parameters
        ----------
        output
            New directory for the repaired run, possibly on another disk; the run directory then stays unchanged. None
            repairs the run in place.

        Returns
        -------
        tuple of Path
            The originals; empty if the run is intact.

        Raises
        ------
        RecoveryError
            If the disk has no room for the repaired bag; the run directory is then unchanged.
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
        return {'topics': self._topics, **self._description, **found}

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
            f'{self.run}: the repaired bag needs up to {needed} MB of disk space, but only {free / _MEGA:.1f} MB are '
            'free; free some space, or write to another disk with --output'
        )

    def _write_bag_into(self, workshop: Path) -> Path:
        types = self._salvage.types
        indices = {topic: index for index, topic in enumerate(types)}
        writer = BagWriter(
            workshop / 'bag',
            STORAGE_BY_ENDING[self._files[0].suffix],
            [(topic, kind, queue_depth(topic)) for topic, kind in types.items()],
            bag_metadata(self._description),
            self._options(),
        )
        kept = self._kept(self.finding.last_tick + 1)
        # Complete ticks are written many times faster than single messages.
        per_tick = max(1, len(self._topics))
        while batch := list(itertools.islice(kept, _BATCH // per_tick * per_tick)):
            topics, times, payloads = zip(*batch, strict=True)
            writer.write([indices[topic] for topic in topics], times, payloads)
        writer.close()
        try:
            RecordedRun.open_bag(workshop / 'bag', self._description.get('sample_time'), self._topics).verify()
        except BagError as error:
            shutil.rmtree(workshop)
            raise RecoveryError(f'the recovered part of the bag cannot be read either: {error}') from None
        return workshop / 'bag'

    def _options(self) -> BagOptions:
        """Return compression and splitting by the recorder's parameters, or the defaults if they are unknown."""
        nodes = self._description.get('nodes', {})
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
    """Return the id of a process that has a file open and is visible to this user; None without /proc."""
    target = file.resolve()
    for process in Path('/proc').glob('[0-9]*'):
        # A process can end, and a descriptor can be closed, during the search.
        with contextlib.suppress(OSError):
            for descriptor in (process / 'fd').iterdir():
                with contextlib.suppress(OSError):
                    if descriptor.readlink() == target:
                        return int(process.name)
    return None
