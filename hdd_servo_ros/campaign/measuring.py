"""One run of a campaign in this process, and its row of the table."""

import contextlib
import dataclasses
import functools
import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hdd_servo_ros.campaign.planning import CampaignRun
from hdd_servo_ros.campaign.spec import ALL
from hdd_servo_ros.campaign.worker import end_if_signaled
from hdd_servo_ros.graph.catalog import CONTROLLERS
from hdd_servo_ros.messages.exit_codes import described, one_line
from hdd_servo_ros.messages.outcome import FAILED
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_in_memory import RunInMemory
from hdd_servo_ros.recording.signals_digest import signals_digest
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.simulation.in_memory import run_in_memory
from hdd_servo_ros.simulation.run_setup import Simulation

_RAISED = (Exception, SystemExit, KeyboardInterrupt)
"""Exceptions that user code may raise in a run; signals to the process are handled elsewhere."""
_PREPARING_TICKS = 1000
REJECTED = 'rejected'
"""Status of a run with invalid parameters, which has no ticks."""


@dataclasses.dataclass(frozen=True)
class Result:
    """
    Result of a run.

    Attributes
    ----------
    number
        Number of the run.
    status
        ``finished``, ``failed``, or ``rejected`` if its parameters are invalid.
    reason
        Reason if it is not ``finished``, and the metrics that could not be computed.
    verdict
        Verdict, as in a report; may be empty.
    last_tick
        The last tick; -1 without a tick.
    digest
        Digest of all signals by :func:`~hdd_servo_ros.recording.signals_digest.signals_digest`, or empty.
    metrics
        Values by name, without those that the run lacks.
    units
        Units of the metrics.
    """

    number: int
    status: str
    reason: str = ''
    verdict: str = ''
    last_tick: int = -1
    digest: str = ''
    metrics: Mapping[str, float] = dataclasses.field(default_factory=dict)
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)


def failed_result(run: CampaignRun, reason: str) -> Result:
    """Return the row of a run without results."""
    return Result(run.number, FAILED, reason)


@functools.cache
def own_metric(path: str) -> Callable[[RecordedRun], float]:
    """
    Return a metric by its import path ``module:function``.

    Raises
    ------
    ArgumentError
        If it cannot be imported.
    """
    module, _, name = path.partition(':')
    try:
        found = getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:
        raise ArgumentError(f'metrics: {path} cannot be imported: {type(error).__name__}: {one_line(error)}') from None
    if not callable(found):
        raise ArgumentError(f'metrics: {path} is not a function')
    function: Callable[[RecordedRun], float] = found
    return function


def is_own(metric: str) -> bool:
    """Return whether a metric is user-defined, given by its import path."""
    return ':' in metric


def measure_run(metrics: Sequence[str], after: float | None, run: CampaignRun) -> Result:
    """
    Make a run in this process and measure it; a failure gives a row with its reason.

    Parameters
    ----------
    metrics
        Names, ``all`` for all metrics of a report, and import paths of user-defined metrics.
    after
        Start of the window of the metrics [s]; None for that of a report.
    run
        The run.
    """
    try:
        simulation = Simulation(run.arguments())
    except (ParameterError, ArgumentError) as error:
        return Result(run.number, REJECTED, one_line(error))
    except _RAISED as error:
        return failed_result(run, described(error))
    try:
        return _measured(run_in_memory(simulation), run.number, metrics, after)
    except _RAISED as error:
        return failed_result(run, described(error))


def _measured(made: RunInMemory, number: int, metrics: Sequence[str], after: float | None) -> Result:
    reasons = [made.reason] if made.reason else []
    values: dict[str, float] = {}
    units: dict[str, str] = {}
    text = ''
    try:
        judged = verdict_of(made, after)
        text = '' if judged is None else judged.text
        only = None if ALL in metrics else [name for name in metrics if not is_own(name)]
        for metric in run_metrics(made, after, only) if len(made.ticks) else ():
            values[metric.name], units[metric.name] = float(metric.value), metric.unit
    except ValueError as error:
        # For example if the run ends within the transient.
        reasons.append(f'metrics: {one_line(error)}')
    except Exception as error:
        reasons.append(f'metrics: {described(error)}')
    for path in filter(is_own, metrics):
        try:
            values[path] = float(own_metric(path)(made))
        except _RAISED as error:
            values[path] = math.nan
            reasons.append(f'{path}: {type(error).__name__}: {one_line(error)}')
    last_tick, digest = len(made.ticks) - 1, signals_digest(made)
    return Result(number, made.status, '; '.join(reasons), text, last_tick, digest, values, units)


def record_run(directory: Path, run: CampaignRun) -> str:
    """
    Repeat a run and record it.

    Parameters
    ----------
    directory
        Directory of the recorded run; it must not exist.
    run
        The run.

    Returns
    -------
    str
        The digest of the recorded signals.
    """
    # Imported late: most campaigns record nothing.
    from hdd_servo_ros.simulation.simulate import simulate

    further = {'bag_recorder:run_dir': str(directory), 'deterministic_timer:record': True}
    # Its warnings are in the table, or the same for many runs.
    exit_code, _ = simulate(Simulation(run.arguments(further)), progress=False, log=lambda line: None)
    end_if_signaled(exit_code)
    return signals_digest(RecordedRun.open(directory))


def prepare(metrics: Sequence[str], after: float | None, run: CampaignRun) -> None:
    """
    Run the first ticks, so that forked processes share the imports and compiled kernels of a run.

    Parameters
    ----------
    metrics, after, run
        See :func:`measure_run`.
    """
    with contextlib.suppress(Exception):
        simulation = Simulation(run.arguments())
        if simulation.rig.controller not in CONTROLLERS:
            # A custom controller is not compiled, and its errors belong in the table.
            return
        simulation.last_tick = min(simulation.last_tick, _PREPARING_TICKS)
        _measured(run_in_memory(simulation), run.number, [name for name in metrics if not is_own(name)], after)
