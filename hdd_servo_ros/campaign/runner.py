"""Runs the cases of a study, through the graph or without middleware, and keeps what is there already."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from tqdm import tqdm

from hdd_servo_ros.campaign.case import Case, PlannedRun
from hdd_servo_ros.campaign.folder import StudyError as StudyError
from hdd_servo_ros.campaign.folder import alone_in, make_folder
from hdd_servo_ros.campaign.run_server import RunServer, ServedRun
from hdd_servo_ros.campaign.start import run_environment, start_run
from hdd_servo_ros.graph.help import COMPILING
from hdd_servo_ros.messages.outcome import FAILED
from hdd_servo_ros.numerics.kernel_folder import first_compilation
from hdd_servo_ros.recording.run_folder import read_run_yaml

_POLL = 0.02
_LAST_LINES = 6
_PROGRESS = re.compile(r'(\d+\.\d+) of (\d+\.\d+) s')


def run_cases(
    cases: Iterable[Case],
    directory: Path,
    *,
    without_ros: bool = False,
    defaults: Mapping[str, object] | None = None,
    keep_failed: bool = False,
    say: Callable[[str], None] = print,
) -> None:
    """
    Run all cases that are not on disk already, each in a process of its own.

    Through the graph one case runs at a time, for it uses two cores; without ROS as many as there are cores, as
    copies of one process (:mod:`~hdd_servo_ros.campaign.run_server`).

    Parameters
    ----------
    cases
        What to run; a case that comes twice runs once.
    directory
        Where each case has its run's folder, by its name.
    without_ros
        Whether by `simulate` instead of `rig`.
    defaults
        Overrides that hold for all cases, under ``'node:parameter'``; those of a case win.
    keep_failed
        Whether to go on after a run that has failed in the loop, such as one that diverged: its ``run.yaml`` says so.
    say
        Gets a line for a person.

    Raises
    ------
    ParameterError, ArgumentError
        If a case's parameters are not allowed, or the folder cannot be made; nothing has run then.
    StudyError
        If a run fails, something that is no run stands in its place, or another study is at work in the folder.
    """
    by_name: dict[str, Case] = {}
    for case in cases:
        if by_name.setdefault(case.name, case) != case:
            raise StudyError(f'two different cases have the name {case.name!r}')
    planned = [PlannedRun(case, defaults or {}, directory) for case in by_name.values()]
    make_folder(directory)
    with alone_in(directory):
        due = [run for run in planned if not _is_there(run, say)]
        if len(due) < len(planned):
            say(f'{len(planned) - len(due)} of {len(planned)} runs are in {directory} already, with these parameters')
        if due:
            _Runner(due, without_ros, keep_failed, say).run()


def _is_there(run: PlannedRun, say: Callable[[str], None]) -> bool:
    """Say whether a run's folder holds this very run; one that does not is removed."""
    if not run.directory.exists():
        return False
    try:
        obstacle = run.obstacle(read_run_yaml(run.directory))
    except OSError as error:
        raise StudyError(f'{error}: move it out of the way') from None
    if obstacle:
        say(f'{run.case.name} runs again: {obstacle}')
        shutil.rmtree(run.directory)
    return not obstacle


def _failure(run: PlannedRun) -> str:
    """Return why a recorded run has failed; empty if it has not, or there is none."""
    try:
        content = read_run_yaml(run.directory)
    except FileNotFoundError:
        return ''
    return str(content['reason']) if content['status'] == FAILED else ''


class _Runner:
    """Keeps so many processes going, and shows how far they are."""

    def __init__(self, due: list[PlannedRun], without_ros: bool, keep_failed: bool, say: Callable[[str], None]) -> None:
        self._due = due
        self._keep_failed = keep_failed
        self._say = say
        self._jobs = min(len(due), len(os.sched_getaffinity(0))) if without_ros else 1
        self._without_ros = without_ros
        self._server: RunServer | None = None
        # It takes as long to start as a run, so that a run for each core is sooner done without it.
        if without_ros and len(due) > self._jobs:
            if first_compilation():
                say(COMPILING)
            self._server = RunServer(run_environment({}))
        self._running: dict[PlannedRun, subprocess.Popen[bytes] | ServedRun] = {}
        self._ticks_due = sum(run.ticks for run in due)
        self._ticks_done = 0
        self._started = time.monotonic()
        self._bar = tqdm(
            total=self._ticks_due,
            disable=not sys.stderr.isatty(),
            bar_format='{percentage:3.0f}% |{bar:30}| {postfix}, {remaining} left',
        )

    def run(self) -> None:
        """Run all; raises :class:`StudyError` at the first that fails, and leaves no process behind."""
        count, finished = len(self._due), 0
        waiting = list(self._due)
        self._say(f'{count} runs to make, {self._jobs} at a time')
        try:
            while waiting or self._running:
                while waiting and len(self._running) < self._jobs:
                    run = waiting.pop(0)
                    self._running[run] = self._start(run)
                ended = {run: code for run, process in self._running.items() if (code := process.poll()) is not None}
                for run, code in ended.items():
                    del self._running[run]
                    self._finish(run, code)
                    finished += 1
                    if self._bar.disable:
                        self._say(f'{finished} of {count} runs: {run.case.name}, {self._time_left()}')
                self._show(f'{finished} of {count} runs, now ' + ', '.join(run.case.name for run in self._running))
                time.sleep(_POLL)
        finally:
            self._bar.close()
            self._end_all()

    def _start(self, run: PlannedRun) -> 'subprocess.Popen[bytes] | ServedRun':
        if self._server is not None:
            return self._server.start(run.arguments, run.log)
        with run.log.open('wb') as log:
            return start_run(run.arguments, without_ros=self._without_ros, stdout=log)

    def _finish(self, run: PlannedRun, exit_code: int) -> None:
        kept = self._keep_failed and exit_code and _failure(run)
        if kept:
            self._say(f'{run.case.name} failed: {kept}')
        elif exit_code:
            last = '\n'.join(run.log.read_text(errors='replace').splitlines()[-_LAST_LINES:])
            raise StudyError(f'the run {run.case.name} failed with exit code {exit_code} ({run.log}):\n{last}')
        run.log.replace(run.directory / 'log.txt')
        self._ticks_done += run.ticks

    def _ticks(self) -> float:
        """Return how many ticks are done, those of the running ones by what they say."""
        total = float(self._ticks_done)
        for run in self._running:
            said = _PROGRESS.findall(run.log.read_text(errors='replace'))
            if said:
                total += run.ticks * float(said[-1][0]) / float(said[-1][1])
        return total

    def _show(self, text: str) -> None:
        if not self._bar.disable:
            self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(self._ticks() - self._bar.n)

    def _time_left(self) -> str:
        done = self._ticks()
        left = (time.monotonic() - self._started) * (self._ticks_due / done - 1.0)
        return f'about {left / 60.0:.0f} min left' if left > 90.0 else f'about {left:.0f} s left'

    def _end_all(self) -> None:
        for process in self._running.values():
            process.terminate()
        for process in self._running.values():
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(10.0)
        if self._server is not None:
            self._server.close()
