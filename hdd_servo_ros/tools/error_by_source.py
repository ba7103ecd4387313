"""Contribution of each error source to the track error of a recorded run, from the run repeated without it."""

import dataclasses
import itertools
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hdd_servo_ros.analysis.error_spectrum import error_by_source, shares_by_source
from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.graph.error_sources import Switch, error_sources
from hdd_servo_ros.messages.topics import HEAD
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.parameters.ros_yaml import written_file
from hdd_servo_ros.parameters.schedule import THEN
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_errors import LongSignal
from hdd_servo_ros.reporting.source_panels import ErrorBySource
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.tools.replay import Recording


def error_by_source_of_run(run: RecordedRun, after: float | None = None, *, trusted: bool = False) -> ErrorBySource:
    """
    Repeat a recorded run without each of its error sources, with the compiled loop in memory.

    Parameters
    ----------
    run
        The run.
    after
        Time before which errors are ignored [s]; None for the first half of the run, but at most 2 s.
    trusted
        Whether code named in the run directory may run: the class of a custom controller.

    Raises
    ------
    ValueError
        If the head follows no reference, no source is enabled, the run with all sources differs from the recording,
        or the loop diverges without a source.
    ReplayError
        If the run cannot be repeated.
    """
    if not follows_reference(run):
        raise ValueError(
            f'{run.path}: no track error: the head follows no reference, or /head or /reference is missing'
        )
    recording = Recording(run.path, trusted=trusted)
    sources = _sources_of(run, recording)
    if not sources:
        raise ValueError(f'{run.path}: no error source is enabled in this run')
    late = slice(steady_start(run, after), None)
    repetitions: dict[str, Switch | None] = {'all sources': None, **sources}
    errors: dict[str, NDArray[np.float64]] = {}
    deviations: dict[str, float] = {}
    steps = len(repetitions) * (recording.last_tick + 1)
    with tqdm(total=steps, desc='error by source', unit='tick', disable=not sys.stderr.isatty()) as progress:
        for source, switch in repetitions.items():
            progress.set_postfix_str(source if switch is None else f'without {source}')
            if run.is_long:
                deviations[source] = _deviation(recording, source, switch, progress, run, late.start)
                continue
            repeated = _repeated(recording, switch, progress)
            if switch is None and not np.array_equal(repeated.position[run.ticks], run.position):
                raise _differs(run)
            errors[source] = repeated.track_error[run.ticks][late]
            if not np.isfinite(errors[source]).all():
                raise _diverges(run, source)
    if run.is_long:
        sigma = deviations.pop('all sources')
        return ErrorBySource(3.0 * sigma, shares_by_source(sigma, deviations))
    complete = errors.pop('all sources')
    return ErrorBySource(misregistration(complete), error_by_source(complete, errors))


def _differs(run: RecordedRun) -> ValueError:
    return ValueError(
        f'{run.path}: the repeated run with all sources differs from the recording; `replay {run.path}` shows where'
    )


def _diverges(run: RecordedRun, source: str) -> ValueError:
    return ValueError(f'{run.path}: the loop diverges without {source}')


def _deviation(
    recording: Recording,
    source: str,
    switch: Switch | None,
    progress: 'tqdm[Any]',
    run: RecordedRun,
    start: int,
) -> float:
    """
    Return the standard deviation of the track error of a long run without a source [um], from row ``start`` on.

    The run with all sources is compared with the recorded one.
    """
    simulation = _simulation(recording, switch)
    found = LongSignal()
    recorded = _positions(run)
    for first_tick, length in simulation.pieces(recording.last_tick):
        for _ in simulation.apply_schedule(first_tick):
            pass
        rows = simulation.experiment.run(first_tick, length)
        if switch is None and rows.position.tolist() != list(itertools.islice(recorded, length)):
            raise _differs(run)
        error = rows.track_error[max(start - first_tick, 0) :]
        if not np.isfinite(error).all():
            raise _diverges(run, source)
        found.add(error)
        progress.update(length)
    return found.misregistration / 3.0


def _positions(run: RecordedRun) -> Iterator[float]:
    """Iterate over the head positions of a run [um]."""
    for piece in run.pieces([HEAD.name]):
        yield from piece.position.tolist()


@dataclasses.dataclass(frozen=True)
class _Repeated:
    """True position and track error of all ticks of a run [um]; NaN after divergence."""

    position: NDArray[np.float64]
    track_error: NDArray[np.float64]


def _sources_of(run: RecordedRun, recording: Recording) -> dict[str, Switch]:
    nodes = {recording.kinds[name]: node['parameters'] for name, node in recording.nodes.items()}
    changes = (
        (recording.kinds.get(change.node, change.node), change.name, change.value) for change in run.parameter_changes
    )
    return error_sources(nodes, changes)


def _repeated(recording: Recording, switch: Switch | None, progress: 'tqdm[Any]') -> _Repeated:
    simulation = _simulation(recording, switch)
    count = recording.last_tick + 1
    position, track_error = np.full(count, np.nan), np.full(count, np.nan)
    for first_tick, length in simulation.pieces(recording.last_tick):
        for _ in simulation.apply_schedule(first_tick):
            pass
        rows = simulation.experiment.run(first_tick, length)
        part = slice(first_tick, first_tick + length)
        position[part], track_error[part] = rows.position, rows.track_error
        progress.update(length)
        if not np.isfinite(rows[HEAD.name]).all():
            break
    return _Repeated(position, track_error)


def _simulation(recording: Recording, switch: Switch | None) -> Simulation:
    """Return the recorded run with a source switched off from the start."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / 'run.yaml'
        content = recording.parameter_file(Path(directory) / 'unused')
        if switch is not None:
            _switch_off(content, recording, switch)
        path.write_text(written_file(content), 'utf8')
        return Simulation(parse_ros_arguments(['--ros-args', '--params-file', str(path), *recording.remaps()]))


def _switch_off(content: dict[str, Any], recording: Recording, switch: Switch) -> None:
    node, parameter, off = switch
    for name, section in content.items():
        if recording.kinds.get(name) == node:
            section[parameter] = off
    timer = content[recording.timer]
    timer['schedule'] = list(_without(timer.get('schedule', ()), recording.kinds, node, parameter))
    if not timer['schedule']:
        del timer['schedule']


def _without(schedule: list[str], kinds: Mapping[str, str], node: str, parameter: str) -> Iterator[str]:
    """Iterate over the entries of a schedule that do not change a given parameter."""
    for entry in schedule:
        words = entry.split(None, 4)
        changed, name = words[2:4] if words[0] == THEN else words[1:3]
        if (kinds.get(changed, changed), name) != (node, parameter):
            yield entry
