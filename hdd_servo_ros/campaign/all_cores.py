"""Work on all cores, in processes that leave signals to their parent."""

import concurrent.futures
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar('Item')
Result = TypeVar('Result')


def on_all_cores(work: Callable[[Item], Result], items: Sequence[Item], chunksize: int = 1) -> Iterator[Result]:
    """
    Yield what a function returns for each item, in their order, with a process per core.

    Parameters
    ----------
    work
        A function of a module, which the processes import by its name.
    items
        Its arguments.
    chunksize
        Items that are sent to a process at a time.
    """
    cores = len(os.sched_getaffinity(0))
    with concurrent.futures.ProcessPoolExecutor(cores, initializer=_leave_signals_to_the_parent) as pool:
        try:
            yield from pool.map(work, items, chunksize=chunksize)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _leave_signals_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
