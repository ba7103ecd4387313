"""
A pool of worker processes on all cores; the work of a killed process is done again.

Campaigns, the recorded runs of studies without ROS, and their figures all use this one pool.
"""

import collections
import concurrent.futures
import contextlib
import functools
import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Any, Generic, TypeVar

from hdd_servo_ros.campaign import worker

Item = TypeVar('Item')
Result = TypeVar('Result')

_TOGETHER = 2
"""Attempts of an item next to others; after this many killed processes it runs alone, to find the cause."""
ATTEMPTS = 4
"""Attempts of an item whose process is killed each time."""
_AHEAD = 3
"""Items queued per worker: no worker waits, and memory does not grow with the number of items."""
_PATIENCE = 10.0
"""Time that workers have to end before they are killed [s]."""
_PERIOD = 0.2
"""Interval between calls of ``watch`` [s]."""


class WorkerKilled(RuntimeError):
    """An item whose process was killed each time."""

    def __init__(self) -> None:
        super().__init__(f'its process was killed {ATTEMPTS} times, perhaps for lack of memory')


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def processes(workers: int) -> concurrent.futures.Executor:
    """Return an executor with a number of processes, which leave signals to this one."""
    return _Processes(workers)


class _Processes(concurrent.futures.ProcessPoolExecutor):
    """Processes forked from this one, so that they share its imports and compiled kernels."""

    def __init__(self, workers: int) -> None:
        context = multiprocessing.get_context('fork')
        self._pids = context.SimpleQueue()
        super().__init__(workers, mp_context=context, initializer=worker.start, initargs=(os.getpid(), self._pids))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> 'concurrent.futures.Future[Any]':
        return super().submit(worker.work, fn, *args, **kwargs)

    def give_up(self) -> None:
        """Cancel queued work, interrupt running work, and wait until the processes have ended."""
        asked = worker.ask_to_end(self._pids)
        # A custom controller may never return from its step.
        killer = threading.Timer(_PATIENCE, worker.kill, [asked])
        killer.daemon = True
        killer.start()
        try:
            self.shutdown(wait=True, cancel_futures=True)
        finally:
            killer.cancel()


class _Attempt(Generic[Item]):
    def __init__(self, index: int, item: Item) -> None:
        self.index = index
        self.item = item
        self.killed = 0


def completed(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    make_executor: Callable[[int], concurrent.futures.Executor] = processes,
    watch: Callable[[], None] | None = None,
) -> Generator[tuple[int, Item, Result | Exception], None, None]:
    """
    Yield index, item, and the result or exception of a function for each item, in order of completion.

    When a process is killed, new processes repeat its items and those of the other workers. An item whose process is
    killed :data:`ATTEMPTS` times, the last time alone, gives a :class:`WorkerKilled`.

    Parameters
    ----------
    work
        A function of a module, which the processes import by its name.
    items
        Its arguments; they are read as needed.
    workers
        Number of worker processes.
    make_executor
        Returns the executor for a number of workers.
    watch
        Called a few times per second while items run.
    """
    waiting = ((_Attempt(index, item)) for index, item in enumerate(items))
    again: collections.deque[_Attempt[Item]] = collections.deque()
    while True:
        in_flight: dict[concurrent.futures.Future[Result], _Attempt[Item]] = {}
        executor = make_executor(workers)
        is_done = False
        try:
            while True:
                while len(in_flight) < _AHEAD * workers:
                    attempt = again.popleft() if again else next(waiting, None)
                    if attempt is None:
                        break
                    alone = attempt.killed >= _TOGETHER
                    if alone and in_flight:
                        again.appendleft(attempt)
                        break
                    try:
                        in_flight[executor.submit(work, attempt.item)] = attempt
                    except BaseException:
                        again.appendleft(attempt)
                        raise
                    if alone:
                        break
                if not in_flight:
                    is_done = True
                    return
                done = _first_done(in_flight, watch)
                for future in done:
                    error = future.exception()
                    if isinstance(error, concurrent.futures.BrokenExecutor):
                        raise error
                    attempt = in_flight.pop(future)
                    if error is not None and not isinstance(error, Exception):
                        raise error
                    yield attempt.index, attempt.item, future.result() if error is None else error
        except concurrent.futures.BrokenExecutor:
            for future, attempt in in_flight.items():
                # Results from before the process was killed are valid.
                if future.done() and not future.cancelled() and future.exception() is None:
                    yield attempt.index, attempt.item, future.result()
                    continue
                attempt.killed += 1
                if attempt.killed >= ATTEMPTS:
                    yield attempt.index, attempt.item, WorkerKilled()
                else:
                    again.append(attempt)
        finally:
            if isinstance(executor, _Processes) and not is_done:
                # After an error or an abandoned iteration, or after a killed process: the other workers still close the
                # bags that are recorded again.
                executor.give_up()
            executor.shutdown(wait=is_done, cancel_futures=True)


def _first_done(
    in_flight: Iterable['concurrent.futures.Future[Result]'], watch: Callable[[], None] | None
) -> 'set[concurrent.futures.Future[Result]]':
    while True:
        timeout = None if watch is None else _PERIOD
        done, _ = concurrent.futures.wait(in_flight, timeout, return_when=concurrent.futures.FIRST_COMPLETED)
        if watch is not None:
            watch()
        if done:
            return done


def on_all_cores(work: Callable[[Item], Result], items: Sequence[Item], chunksize: int = 1) -> Iterator[Result]:
    """
    Yield the result of a function for each item, in order, with one process per core.

    Parameters
    ----------
    work
        A function of a module, which the processes import by its name.
    items
        Its arguments.
    chunksize
        Items sent to a process at a time.
    """
    chunks = [items[first : first + chunksize] for first in range(0, len(items), chunksize)]
    early: dict[int, list[Result]] = {}
    due = 0
    with contextlib.closing(completed(functools.partial(_each, work), chunks, cores())) as found:
        for index, _, results in found:
            if isinstance(results, Exception):
                raise results
            early[index] = results
            while due in early:
                yield from early.pop(due)
                due += 1


def _each(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    return [work(item) for item in items]
