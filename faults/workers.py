"""Trials at the same time, in worker processes; one that does not return is ended, and the others go on."""

import contextlib
import multiprocessing
import multiprocessing.connection
import multiprocessing.process
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from faults.campaign import HANG, WRONG, Campaign, Fault, Made, Trial, judged

_FORK = multiprocessing.get_context('fork')


def at_the_same_time(jobs: int) -> Made:
    """
    Return what makes trials in worker processes.

    Parameters
    ----------
    jobs
        How many at a time; fewer where the campaign allows fewer.
    """

    def made(campaign: Campaign, folder: Path, numbers: Iterator[int]) -> Iterator[tuple[int, Trial]]:
        workers = [_Worker(campaign, folder) for _ in range(min(jobs, campaign.jobs))]
        try:
            for worker in workers:
                worker.take(next(numbers, None))
            while busy := [worker for worker in workers if worker.number is not None]:
                multiprocessing.connection.wait([worker.pipe for worker in busy], 0.5)
                for worker in busy:
                    trial = worker.trial()
                    if trial is not None:
                        number = worker.number
                        assert number is not None
                        worker.take(next(numbers, None))
                        yield number, trial
        finally:
            for worker in workers:
                worker.end()

    return made


class _Worker:
    """A process that makes one trial after the other, and is replaced if it does not return."""

    def __init__(self, campaign: Campaign, folder: Path) -> None:
        self._campaign, self._folder = campaign, folder
        self.number: int | None = None
        self._since = 0.0
        self._start()

    def _start(self) -> None:
        self.pipe, theirs = _FORK.Pipe()
        self._process = _FORK.Process(target=_work, args=(self._campaign, self._folder, theirs))
        self._process.start()
        theirs.close()

    def take(self, number: int | None) -> None:
        """Begin a trial, none if None."""
        self.number, self._since = number, time.monotonic()
        if number is not None:
            self.pipe.send(number)

    def trial(self) -> Trial | None:
        """Return the trial if it has ended, by itself or since it took too long."""
        if self.pipe.poll():
            with contextlib.suppress(EOFError, ConnectionError):
                found: Trial = self.pipe.recv()
                return found
            fault = Fault(WRONG, 'the process that made the trial ended in the middle of it')
        elif time.monotonic() - self._since > self._campaign.trial_seconds:
            fault = Fault(HANG, f'the trial did not return within {self._campaign.trial_seconds:g} s')
        else:
            return None
        self.end()
        self._start()
        return Trial('did not return', [fault])

    def end(self) -> None:
        """End the process, and what it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._pid(), signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self.pipe.close()

    def _pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid


def _work(campaign: Campaign, folder: Path, pipe: Any) -> None:
    # A group of its own: what a trial that hangs has started is ended with it. Ctrl-C reaches the parent alone.
    os.setpgid(0, 0)
    with contextlib.suppress(EOFError):
        while True:
            pipe.send(judged(campaign, folder, pipe.recv()))
