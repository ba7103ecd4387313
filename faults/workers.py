"""Parallel trials in worker processes; a trial that does not return is killed, and the others continue."""

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

from faults.campaign import HANG, WRONG, Campaign, Fault, Runner, Trial, judged

_FORK = multiprocessing.get_context('fork')


def parallel(jobs: int) -> Runner:
    """
    Return a runner that makes trials in worker processes.

    Parameters
    ----------
    jobs
        Number of parallel trials; a campaign may allow fewer.
    """

    def run(campaign: Campaign, folder: Path, numbers: Iterator[int]) -> Iterator[tuple[int, Trial]]:
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

    return run


class _Worker:
    """A process that makes trials one after another, and is replaced if a trial does not return."""

    def __init__(self, campaign: Campaign, folder: Path) -> None:
        self._campaign, self._folder = campaign, folder
        self.number: int | None = None
        self._since = 0.0
        self._start()

    def _start(self) -> None:
        self.pipe, worker_end = _FORK.Pipe()
        self._process = _FORK.Process(target=_work, args=(self._campaign, self._folder, worker_end))
        self._process.start()
        worker_end.close()

    def take(self, number: int | None) -> None:
        """Start a trial; None starts nothing."""
        self.number, self._since = number, time.monotonic()
        if number is not None:
            self.pipe.send(number)

    def trial(self) -> Trial | None:
        """Return the trial if it has returned or exceeded its time limit."""
        if self.pipe.poll():
            with contextlib.suppress(EOFError, ConnectionError):
                found: Trial = self.pipe.recv()
                return found
            fault = Fault(WRONG, 'the worker process ended during the trial')
        elif time.monotonic() - self._since > self._campaign.trial_seconds:
            fault = Fault(HANG, f'the trial did not return within {self._campaign.trial_seconds:g} s')
        else:
            return None
        self.end()
        self._start()
        return Trial('did not return', [fault])

    def end(self) -> None:
        """Kill the process and its children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._pid(), signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self.pipe.close()

    def _pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid


def _work(campaign: Campaign, folder: Path, pipe: Any) -> None:
    # A process group, so that the children of a hanging trial are killed with it, and Ctrl-C reaches only the parent.
    os.setpgid(0, 0)
    with contextlib.suppress(EOFError):
        while True:
            pipe.send(judged(campaign, folder, pipe.recv()))
