"""Long runs, which are read in blocks, and their last stretch, which is read as arrays."""

import weakref
from collections.abc import Collection, Iterator

from hdd_servo_ros.messages.signals import SignalRows, Signals
from hdd_servo_ros.recording.recorded_run import LONG_RUN, RecordedRun
from hdd_servo_ros.recording.run_stretch import RunStretch, joined

STRETCH = LONG_RUN
"""Ticks at the end of a long run that are read as arrays, like a short run."""
BLOCK = 2**14
"""Ticks per block."""

_FOUND: weakref.WeakKeyDictionary[RecordedRun, RunStretch] = weakref.WeakKeyDictionary()


def stretch_of(run: RecordedRun) -> RecordedRun:
    """Return the last :data:`STRETCH` ticks of a long run as a run; a short run unchanged."""
    if not run.is_long:
        return run
    if run not in _FOUND:
        _FOUND[run] = RunStretch(run, max(0, run.row_count - STRETCH))
    return _FOUND[run]


def begins_within(run: RecordedRun) -> bool:
    """Return whether the first row is later than the first tick of the run."""
    return isinstance(run, RunStretch) and int(run.ticks[0]) > 0


def stretch_in_words(run: RecordedRun) -> str:
    """Return the ticks of the :func:`stretch_of` a long run as text; empty for a short run."""
    if not run.is_long:
        return ''
    first = max(0, run.row_count - STRETCH)
    last = run.row_count - 1
    return f'ticks {first} to {last}, {run.time_at(first):g} s to {run.time_at(last):g} s'


def rows_of(run: RecordedRun, rows: slice) -> SignalRows:
    """Return consecutive rows of a long run; a slice beyond the end is cut."""
    wanted = min(rows.stop, run.row_count) - rows.start
    found: list[Signals] = []
    held = 0
    for piece in run.pieces(first_tick=rows.start):
        found.append(piece)
        held += len(piece.ticks)
        if held >= wanted:
            break
    return joined(found).part(rows.start, wanted)


def blocks(run: RecordedRun, size: int = BLOCK, topics: Collection[str] | None = None) -> Iterator[SignalRows]:
    """
    Yield the signals of a long run in blocks of ``size`` ticks; the last block may be shorter.

    Parameters
    ----------
    run
        The run.
    size
        Ticks per block.
    topics
        Names of the topics to read, without namespace; None for all topics with fields.
    """
    waiting: list[Signals] = []
    held = 0
    for piece in run.pieces(topics):
        waiting.append(piece)
        held += len(piece.ticks)
        if held < size:
            continue
        rows = joined(waiting)
        whole = held - held % size
        for begin in range(0, whole, size):
            yield rows.part(rows.first_tick + begin, size)
        held -= whole
        waiting = [rows.part(rows.first_tick + whole, held)] if held else []
    if waiting:
        yield joined(waiting)
