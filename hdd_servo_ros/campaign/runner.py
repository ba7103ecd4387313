"""Runs the cases of a study, with `rig` or with `simulate`; existing runs are kept."""

import contextlib
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from hdd_servo_ros.campaign.all_cores import completed, cores
from hdd_servo_ros.campaign.case import Case, PlannedRun
from hdd_servo_ros.campaign.case_progress import CaseProgress
from hdd_servo_ros.campaign.folder import StudyError as StudyError
from hdd_servo_ros.campaign.folder import alone_in, make_folder
from hdd_servo_ros.campaign.recording import Recording, prepare, record
from hdd_servo_ros.campaign.start import start_run
from hdd_servo_ros.graph.help import COMPILING
from hdd_servo_ros.messages.exit_codes import one_line
from hdd_servo_ros.messages.outcome import FAILED
from hdd_servo_ros.numerics.kernel_folder import first_compilation
from hdd_servo_ros.recording.run_folder import read_run_yaml

_POLL = 0.02
_LAST_LINES = 6
_PATIENCE = 10.0
"""Time that a run has to end after SIGTERM [s]."""


def run_cases(
    cases: Iterable[Case],
    directory: Path,
    *,
    without_ros: bool = False,
    defaults: Mapping[str, object] | None = None,
    keep_failed: bool = False,
    report: Callable[[str], None] = print,
) -> None:
    """
    Run all cases that are not on disk yet.

    With ROS one case runs at a time, in a process of `rig`, which uses two cores. Without ROS one case per core runs
    in the worker processes of campaigns (:mod:`~hdd_servo_ros.campaign.all_cores`).

    Parameters
    ----------
    cases
        The cases; a repeated case runs once.
    directory
        Parent of the run directories, which have the names of the cases.
    without_ros
        Whether to use `simulate` instead of `rig`.
    defaults
        Overrides for all cases, by ``'node:parameter'``; those of a case win.
    keep_failed
        Whether to continue after a run that failed in the loop, for example by diverging; ``run.yaml`` records it.
    report
        Called with each progress line.

    Raises
    ------
    ParameterError, ArgumentError
        If the parameters of a case are invalid, or the directory cannot be created; no case has run then.
    StudyError
        If a run fails, a file or directory that is not a run has its name, or another study uses the directory.
    """
    by_name: dict[str, Case] = {}
    for case in cases:
        if by_name.setdefault(case.name, case) != case:
            raise StudyError(f'two different cases have the name {case.name!r}')
    planned = [PlannedRun(case, defaults or {}, directory) for case in by_name.values()]
    make_folder(directory)
    with alone_in(directory):
        due = [run for run in planned if not _is_there(run, report)]
        if len(due) < len(planned):
            report(f'{len(planned) - len(due)} of {len(planned)} runs with these parameters are in {directory} already')
        if due:
            runner = _Runner(due, keep_failed, report)
            if without_ros:
                runner.in_workers()
            else:
                runner.through_the_graph()


def _is_there(run: PlannedRun, report: Callable[[str], None]) -> bool:
    """Return whether the run directory holds this run; a different run is removed."""
    if not run.directory.exists():
        return False
    try:
        obstacle = run.obstacle(read_run_yaml(run.directory))
    except OSError as error:
        raise StudyError(f'{error}: move or remove it') from None
    if obstacle:
        report(f'{run.case.name} runs again: {obstacle}')
        shutil.rmtree(run.directory)
    return not obstacle


def _failure(run: PlannedRun) -> str:
    """Return why a recorded run has failed; empty if it has not failed or does not exist."""
    try:
        content = read_run_yaml(run.directory)
    except FileNotFoundError:
        return ''
    return str(content['reason']) if content['status'] == FAILED else ''


class _Runner:
    """Makes all runs and shows the progress; the first failure ends the others."""

    def __init__(self, due: list[PlannedRun], keep_failed: bool, report: Callable[[str], None]) -> None:
        self._due = due
        self._keep_failed = keep_failed
        self._report = report
        self._progress = CaseProgress(due, report)

    def through_the_graph(self) -> None:
        """Make the runs with `rig`, one at a time; raises :class:`StudyError` at the first failure."""
        self._report(f'{len(self._due)} runs to make, 1 at a time')
        process: subprocess.Popen[bytes] | None = None
        try:
            for run in self._due:
                with run.log.open('wb') as log:
                    process = start_run(run.arguments, without_ros=False, stdout=log)
                while (code := process.poll()) is None:
                    self._progress.show()
                    time.sleep(_POLL)
                self._finish(run, code)
        finally:
            self._progress.close()
            if process is not None:
                _end(process)

    def in_workers(self) -> None:
        """Make the runs with `simulate` in workers; raises :class:`StudyError` at the first failure."""
        jobs = min(len(self._due), cores())
        self._report(f'{len(self._due)} runs to make, {jobs} at a time')
        if first_compilation():
            self._report(COMPILING)
        prepare()
        recordings = [Recording(tuple(run.arguments), run.directory, run.log) for run in self._due]
        try:
            with contextlib.closing(completed(record, recordings, jobs, watch=self._progress.show)) as made:
                for index, _, code in made:
                    run = self._due[index]
                    if isinstance(code, Exception):
                        raise StudyError(f'the run {run.case.name} failed: {one_line(code)}')
                    self._finish(run, code)
        finally:
            self._progress.close()

    def _finish(self, run: PlannedRun, exit_code: int) -> None:
        kept = self._keep_failed and exit_code and _failure(run)
        if kept:
            self._report(f'{run.case.name} failed: {kept}')
        elif exit_code:
            last = '\n'.join(run.log.read_text(errors='replace').splitlines()[-_LAST_LINES:])
            raise StudyError(f'the run {run.case.name} failed with exit code {exit_code} ({run.log}):\n{last}')
        run.log.replace(run.directory / 'log.txt')
        self._progress.finished(run)


def _end(process: 'subprocess.Popen[bytes]') -> None:
    """End a process, if it still runs."""
    process.terminate()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(_PATIENCE)
