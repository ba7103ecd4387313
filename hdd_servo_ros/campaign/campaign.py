"""Many runs from one specification, on all cores or a cluster, and their table."""

import concurrent.futures
import contextlib
import functools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from tqdm import tqdm

from hdd_servo_ros.campaign import all_cores
from hdd_servo_ros.campaign.changes import changes
from hdd_servo_ros.campaign.folder import StudyError, alone_in, make_folder
from hdd_servo_ros.campaign.journal import Journal
from hdd_servo_ros.campaign.kept_runs import KeptRun, keep_run
from hdd_servo_ros.campaign.measuring import (
    Result,
    failed_result,
    is_own,
    measure_run,
    own_metric,
    prepare,
)
from hdd_servo_ros.campaign.planning import CampaignRun, Plan
from hdd_servo_ros.campaign.sources import digests
from hdd_servo_ros.campaign.spec import ALL, Spec, file_name, read_spec, spec_of
from hdd_servo_ros.campaign.table import Table
from hdd_servo_ros.messages.errors import MissingExtra
from hdd_servo_ros.messages.exit_codes import one_line
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.messages.plain_yaml import YamlError, read_yaml
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, did_you_mean
from hdd_servo_ros.recording.run_folder import git_revision, versions
from hdd_servo_ros.reporting.metric_names import METRIC_NAMES
from hdd_servo_ros.reporting.verdict import DIVERGED


class _UnknownMetric(ArgumentError):
    """A metric that is missing in every run."""


Item = TypeVar('Item')
MakeExecutor = Callable[[int], concurrent.futures.Executor]
"""Returns the executor for a number of workers."""


class Campaign:
    """
    A campaign: ``Campaign('spec.yaml').run()`` makes its runs and returns their table.

    Parameters
    ----------
    spec
        Path of a specification, its entries as a mapping (with paths relative to the working directory), or a
        :class:`~hdd_servo_ros.campaign.spec.Spec`.

    Raises
    ------
    ArgumentError, ParameterError
        If an entry, a parameter file, a parameter or a metric is not allowed.

    Examples
    --------
    >>> from hdd_servo_ros.campaign import Campaign
    >>> campaign = Campaign({
    ...     'name': 'example',
    ...     'set': {'deterministic_timer:duration': 0.02},
    ...     'controllers': ['pid'],
    ...     'vary': [{'reference_generator:frequency': [100.0, 200.0]}],
    ...     'metrics': ['rms_error'],
    ... })
    >>> campaign
    Campaign('example': 2 runs, 2 points x 1 controllers x 1 seeds)
    >>> table = campaign.run(workers=1)
    >>> table['status'].tolist()
    ['finished', 'finished']
    """

    def __init__(self, spec: str | Path | Mapping[str, Any] | Spec) -> None:
        file = Path(spec) if isinstance(spec, str | Path) else None
        if isinstance(spec, str | Path):
            spec = read_spec(Path(spec))
        elif isinstance(spec, Mapping):
            spec = spec_of(spec, Path.cwd())
        self.spec = spec
        try:
            _check_names(spec)
            self.plan = Plan(spec)
            own = {metric: own_metric(metric) for metric in spec.metrics if is_own(metric)}
        except (ArgumentError, ParameterError) as error:
            raise error if file is None else ArgumentError(f'specification {file}: {error}') from error
        # The runs use the code that is imported now, even if the files change later.
        self._sources = digests(self.plan.nodes, self.plan.files, own)

    def __len__(self) -> int:
        return len(self.plan)

    def __repr__(self) -> str:
        return f'Campaign({self.spec.name!r}: {self.plan.extent})'

    def run(
        self,
        directory: str | Path | None = None,
        *,
        workers: int | None = None,
        executor: MakeExecutor = all_cores.processes,
        progress: bool = False,
    ) -> Table:
        """
        Make all runs, and return their table: one row per run in the order of the plan.

        The table is bit-identical for any number of workers and any executor.

        Parameters
        ----------
        directory
            Directory for the results; runs that it already holds are not repeated. None to write nothing.
        workers
            Number of runs at a time; None for one per core.
        executor
            Returns a :class:`concurrent.futures.Executor` for a number of workers; processes of this machine by
            default.
        progress
            Whether to show a bar with the rate and the remaining time.

        Raises
        ------
        ArgumentError
            If the directory holds another campaign or cannot be created, or a metric is missing in every run.
        StudyError
            If another campaign is running in the directory.
        """
        count = all_cores.cores() if workers is None else workers
        if not isinstance(count, int) or isinstance(count, bool) or count < 1:
            raise ArgumentError(f'workers = {shown(workers)} is invalid; expected an integer at least 1')
        crew = _Crew(count, executor, progress)
        if directory is None:
            if self.spec.keep != 'none':
                raise ArgumentError(f'keep: {self.spec.keep} needs a directory for the recorded runs')
            return self._table({result.number: result for result in self._results(range(len(self)), crew)})
        folder = Path(directory)
        make_folder(folder)
        with alone_in(folder):
            self._describe(folder, 'running')
            with Journal(folder / 'results.jsonl') as journal:
                there = {result.number for result in journal}
                due = [number for number in range(len(self)) if number not in there]
                try:
                    for result in self._results(due, crew):
                        journal.add(result)
                except _UnknownMetric:
                    if not there:
                        # Otherwise the directory would reject the campaign with the corrected name.
                        _forget(folder)
                    raise
                table = self._table({result.number: result for result in journal})
            table.write_csv(folder / 'table.csv')
            with contextlib.suppress(MissingExtra):
                table.write_parquet(folder / 'table.parquet')
            self._record_kept(table, folder, crew)
            self._describe(folder, FINISHED, table)
        return table

    def _results(self, due: Sequence[int], crew: '_Crew') -> Iterator[Result]:
        """Make runs and yield their results in order of completion."""
        measure = functools.partial(measure_run, self.spec.metrics, self.spec.after)
        if not due:
            return
        # Forked processes share the imports and compiled kernels of this one.
        for controller in range(min(len(self.spec.controllers), len(self))):
            prepare(self.spec.metrics, self.spec.after, self.plan[controller * len(self.spec.seeds)])
        results = crew.completed(measure, (self.plan[number] for number in due), len(due), 'runs')
        known: dict[str, set[str]] = {}
        for run, result in results:
            if isinstance(result, Exception):
                result = failed_result(run, one_line(result) or type(result).__name__)
            if run.controller not in known and result.status == FINISHED:
                known[run.controller] = set(result.metrics)
                self._check_metrics(known, run)
            yield result

    def _check_metrics(self, known: Mapping[str, set[str]], run: CampaignRun) -> None:
        """Reject a metric that no finished run has, once each controller has a finished run."""
        if len(known) < len(self.spec.controllers):
            return
        measured = set().union(*known.values())
        worst = (self.spec.worst_of,) if self.spec.worst_of else ()
        for metric in (*self.spec.metrics, *worst):
            if metric != ALL and metric not in measured:
                names = list(measure_run((ALL,), self.spec.after, run).metrics)
                entry = 'metrics' if metric in self.spec.metrics else 'keep: of'
                raise _UnknownMetric(f'{entry}: unknown metric {metric!r}; the runs have {", ".join(names)}')

    def _table(self, results: Mapping[int, Result]) -> Table:
        runs = list(self.plan)
        ordered = [results[run.number] for run in runs]
        columns: dict[str, list[Any]] = {
            'run': [run.number for run in runs],
            'controller': [run.controller for run in runs],
        }
        if self.spec.seeds != (None,):
            columns['seed'] = [run.seed for run in runs]
        columns |= {key: [run.varied[key] for run in runs] for key in self.plan.varied}
        for name in ('status', 'reason', 'verdict', 'last_tick'):
            columns[name] = [getattr(result, name) for result in ordered]
        units: dict[str, str] = {}
        for result in ordered:
            units |= result.units
        # In the order of reports, even if the first run lacks some.
        names = _in_order([tuple(result.metrics) for result in ordered])
        # A requested metric that every run lacks has a column of nan.
        asked = (name for name in (*self.spec.metrics, self.spec.worst_of) if name and name != ALL)
        for name in dict.fromkeys([*names, *asked]):
            columns[name] = [float(result.metrics.get(name, math.nan)) for result in ordered]
        columns['digest'] = [result.digest for result in ordered]
        return Table(columns, {name: unit for name, unit in units.items() if unit})

    def worst(self, table: Table, metric: str, count: int) -> list[int]:
        """
        Return the numbers of the worst runs.

        Parameters
        ----------
        table
            All runs, or a selection by :meth:`~hdd_servo_ros.campaign.table.Table.where`.
        metric
            Metric to sort by: unfinished runs come first, then runs without the metric, then the largest absolute
            values. Empty for the unfinished runs only, in the order of the plan.
        count
            Largest number of runs to return.
        """
        failed = table['status'] != FINISHED
        numbers = table['run'].tolist()
        if not metric:
            return [number for number, has_failed in zip(numbers, failed, strict=True) if has_failed][:count]
        values = [math.inf if math.isnan(value) else abs(value) for value in table[metric].tolist()]
        ordered = sorted(zip(~failed, (-value for value in values), numbers, strict=True))
        return [number for _, _, number in ordered[:count]]

    def worst_metric(self, table: Table) -> str:
        """Return the metric that ranks the runs: that of ``keep``, otherwise the first metric of the table."""
        names = table.columns[table.columns.index('last_tick') + 1 : -1]
        return self.spec.worst_of or next(iter(names), '')

    def _kept(self, table: Table) -> list[int]:
        if self.spec.keep == 'all':
            return list(range(len(table)))
        if self.spec.keep == 'failed':
            judged = zip(table['status'], table['verdict'], strict=True)
            return [number for number, (status, text) in enumerate(judged) if status != FINISHED or text == DIVERGED]
        metric = self.worst_metric(table)
        if self.spec.keep == 'none' or not metric:
            return []
        # A rejected run has no signals to record.
        has_signals = [number for number, digest in enumerate(table['digest'].tolist()) if digest]
        return self.worst(table.take(has_signals), metric, self.spec.worst)

    def _record_kept(self, table: Table, folder: Path, crew: '_Crew') -> None:
        """Record the kept runs; each recording is bit-identical to the run that was measured."""
        status, digests = table['status'], table['digest']
        # A missing digest means that the run has no signals.
        due = [
            KeptRun(self.plan[number], str(status[number]), str(digests[number]))
            for number in self._kept(table)
            if digests[number]
        ]
        keep = functools.partial(keep_run, folder / 'runs')
        for kept, error in crew.completed(keep, due, len(due), 'recorded'):
            if isinstance(error, StudyError):
                raise error
            if isinstance(error, Exception):
                raise StudyError(f'run {kept.run.number} cannot be recorded: {one_line(error)}') from error

    def _describe(self, folder: Path, status: str, table: Table | None = None) -> None:
        """Write ``campaign.yaml`` and the base parameter files; raises ArgumentError for another campaign."""
        path, digest = folder / 'campaign.yaml', self.plan.digest
        if path.exists():
            try:
                found = read_yaml(path)
            except YamlError as error:
                raise ArgumentError(f'{path} cannot be read: {error}') from None
            if not isinstance(found, dict) or found.get('digest') != digest:
                what = changes(
                    found.get('contents') if isinstance(found, dict) else None, self._bases_in(folder), self.plan
                )
                raise ArgumentError(
                    f'{folder} holds another campaign{f": {what}" if what else ""}; remove it, or choose another '
                    'directory with --output'
                )
            _check_sources(folder, found.get('sources') or {}, self._sources)
        elif any(folder.iterdir()):
            raise ArgumentError(
                f'{folder} is not empty and is not the directory of a campaign; choose another with --output'
            )
        (folder / 'parameters').mkdir(exist_ok=True)
        for name, text in self.plan.base_files().items():
            base_file(folder, name).write_text(text, 'utf8')
        content = {
            'name': self.spec.name,
            'status': status,
            'runs': len(self),
            'contents': self.plan.contents,
            'keep': self.spec.keep,
            'digest': digest,
            'sources': self._sources,
            'versions': versions(),
            'git_revision': git_revision(),
        }
        if table is not None:
            content['table_digest'] = table.digest()
            content['units'] = table.units
        temporary = path.with_name('campaign.yaml.tmp')
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), 'utf8')
        temporary.replace(path)

    def _bases_in(self, folder: Path) -> dict[str, str]:
        """Return the base parameter files in a directory, by controller of this campaign."""
        files = {controller.name: base_file(folder, controller.name) for controller in self.spec.controllers}
        return {name: file.read_text('utf8', 'replace') for name, file in files.items() if file.is_file()}


def _check_names(spec: Spec) -> None:
    """Reject metrics that do not exist."""
    for entry, names in (('metrics', spec.metrics), ('keep: of', (spec.worst_of,) if spec.worst_of else ())):
        for name in names:
            if name != ALL and not is_own(name) and name not in METRIC_NAMES:
                raise ArgumentError(
                    f'{entry}: unknown metric {name!r}{did_you_mean(name, METRIC_NAMES)}; expected a name from '
                    'metrics.yaml of a report, or module:function'
                )


def _check_sources(folder: Path, found: Mapping[str, str], due: Mapping[str, str]) -> None:
    """Reject to resume with code or files that differ from those of the existing results."""
    changed = [name for name in {**found, **due} if found.get(name) != due.get(name)]
    if changed:
        raise ArgumentError(
            f'{folder} holds results from before {", ".join(changed)} changed; remove it, or choose another directory '
            'with --output'
        )


def base_file(folder: Path, controller: str) -> Path:
    """Return the path of the common parameters of all runs with a controller."""
    return folder / 'parameters' / f'{file_name(controller)}.yaml'


def _forget(folder: Path) -> None:
    """Remove the files that a campaign writes before its first run."""
    for file in (folder / 'campaign.yaml', folder / 'results.jsonl', *(folder / 'parameters').glob('*.yaml')):
        file.unlink()
    (folder / 'parameters').rmdir()


def _in_order(orders: Sequence[Sequence[str]]) -> list[str]:
    """Return all names once, merged so that each order is kept as far as possible."""
    found: list[str] = []
    for order in dict.fromkeys(orders):
        position = 0
        for name in order:
            if name in found:
                position = found.index(name) + 1
            else:
                found.insert(position, name)
                position += 1
    return found


class _Crew:
    """The workers of a campaign: their number, their executor, and whether a bar shows the progress."""

    def __init__(self, workers: int, executor: MakeExecutor, progress: bool) -> None:
        self._workers = workers
        self._executor = executor
        self._progress = progress

    def completed(
        self, work: Callable[[Item], Any], runs: Iterable[Item], total: int, what: str
    ) -> Iterator[tuple[Item, Any]]:
        """Yield each run with the result or exception of its work, in order of completion."""
        if not total:
            return
        with contextlib.closing(all_cores.completed(work, runs, self._workers, self._executor)) as found:
            for _, run, result in tqdm(found, what, total, unit='run', file=sys.stderr, disable=not self._progress):
                yield run, result
