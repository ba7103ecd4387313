"""Reports of recorded runs, from their bags: metrics, plots and a page per run, and comparisons of runs."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.messages.units import shown
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.comparison_panels import comparison_panels
from hdd_servo_ros.reporting.evaluation import SIGNAL_ANALYZER, steady_start
from hdd_servo_ros.reporting.from_stretch import from_stretch
from hdd_servo_ros.reporting.metric import Metric
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_names import run_name, run_names
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.reporting.run_sensitivity import low_margin_of
from hdd_servo_ros.reporting.run_sums import sums_of
from hdd_servo_ros.reporting.saturation import has_saturation_data, saturation_line
from hdd_servo_ros.reporting.seek_report import for_yaml, lost_seeks, seek_tables
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks
from hdd_servo_ros.reporting.source_panels import ErrorBySource, source_metrics, source_panel
from hdd_servo_ros.reporting.verdict import Verdict, verdict_of

_TITLE_WIDTH = 150
"""Characters per line of a plot title."""


def report_run(
    run: RecordedRun, directory: Path, after: float | None = None, by_source: ErrorBySource | None = None
) -> tuple[list[Path], list[str]]:
    """
    Write the metrics, the plot and the page of a run.

    Parameters
    ----------
    run
        The run.
    directory
        Directory for ``report.html``, ``report.png`` and ``metrics.yaml``; created if it is missing.
    after
        Start of the window [s]; None to skip the first half of the run, at most 2 s.
    by_source
        Contribution of each source to the error, if it is to be reported.

    Returns
    -------
    written : list of Path
        The files.
    remarks : list of str
        Lines about a run that did not finish or does not track, a low stability margin, and parts that the report
        omits, with reasons.

    Raises
    ------
    ValueError
        If the bag has nothing to report, or the run ends before that time.
    """
    # Imported late: an error in the arguments is reported before matplotlib is imported.
    from hdd_servo_ros.reporting.page import write_page
    from hdd_servo_ros.reporting.plot import write_plot

    metrics = run_metrics(run, after)
    response, missing = _measured_response(run)
    missing = left_out(run, after) + missing
    panels = run_panels(run, after, response)
    if by_source is not None:
        metrics += source_metrics(run, by_source)
        panels.append(source_panel(run, by_source))
    if not panels:
        raise ValueError(f'{run.path}: nothing to report: the bag has neither /control nor /reference with /head')
    title = f'{run.controller} on {run.frame_id}: {run_name(run)}' if run.description else run_name(run)
    directory.mkdir(parents=True, exist_ok=True)
    written = [directory / name for name in ('metrics.yaml', 'report.png', 'report.html')]
    clipped, judged = _saturation(run, after), verdict_of(run, after)
    low_margin = low_margin_of(run)
    part = part_with_seeks(run)
    lost = lost_seeks(part)
    missing += from_stretch(run, after)
    caveats = [*_caveats(run, judged), *filter(None, [lost, low_margin])]
    content = {
        'status': run.status,
        'reason': run.reason,
        'verdict': None if judged is None else {'text': judged.text, 'detail': judged.detail},
        'saturated_samples': None if clipped is None else {name: count for name, (count, _) in clipped.items()},
        'low_stability_margin': low_margin,
        'left_out': missing,
        'errors_from': run.time_at(steady_start(run, after)),
        'metrics': {metric.name: {'value': metric.value, 'unit': metric.unit} for metric in metrics},
        **for_yaml(part),
    }
    written[0].write_text(yaml.safe_dump(content, sort_keys=False), 'utf8')
    write_plot(panels, '\n'.join([title, *textwrap.wrap('; '.join(caveats), _TITLE_WIDTH)]), written[1])
    lines = [('verdict', _in_table(judged))] if judged is not None else []
    lines += [(metric.label, f'{_number(metric.value)} {shown(metric.unit)}') for metric in metrics]
    subtitle = '; '.join([_subtitle(run, after, judged, clipped), *filter(None, [lost, low_margin]), *missing])
    details = seek_tables(part) | _details(run)
    write_page(written[2], title, subtitle, (('', 'value'), lines), panels, run.sample_time, details)
    return written, [*caveats, *missing]


def _measured_response(run: RecordedRun) -> tuple[FrequencyResponse | None, list[str]]:
    """Return the response measured in a run, or None, and at most one line with the reason."""
    if run.controller != SIGNAL_ANALYZER:
        return None, []
    # Imported late: it needs the compiled blocks.
    from hdd_servo_ros.reporting.recorded_response import response_of_run

    try:
        response = response_of_run(run)
    except (ValueError, LookupError) as error:
        return None, [f'no measured response: {error}']
    return response, [] if len(response.frequency) else ['no measured response: no frequency point is complete']


def _ended(run: RecordedRun) -> str:
    """Return the status and the reason of a run that did not finish; empty if it finished or this is unknown."""
    if run.status == FINISHED or not run.description:
        return ''
    return f'{run.status}: {run.reason}' if run.reason else run.status


def _caveats(run: RecordedRun, judged: Verdict | None) -> list[str]:
    """Return the reasons why a run did not finish and why it does not track, one line each."""
    return [*filter(None, [_ended(run)]), *([] if judged is None or judged.tracks else [judged.in_words])]


def _in_table(judged: Verdict | None) -> str:
    return '' if judged is None else judged.in_table


def compare_runs(runs: Sequence[RecordedRun], directory: Path, after: float | None = None) -> list[Path]:
    """
    Write one table and overlay of several runs: ``comparison.html``, ``comparison.png``.

    Raises
    ------
    ValueError
        If the runs are in different units.
    """
    from hdd_servo_ros.reporting.page import write_page
    from hdd_servo_ros.reporting.plot import write_plot

    panels = comparison_panels(runs, after)
    directory.mkdir(parents=True, exist_ok=True)
    plot, page = directory / 'comparison.png', directory / 'comparison.html'
    names = run_names(runs)
    title = ', '.join(_marked_name(name, run, verdict_of(run, after)) for name, run in zip(names, runs, strict=True))
    write_plot(panels, textwrap.fill(title, _TITLE_WIDTH), plot)
    details = {'differences in run.yaml': _differences(runs)}
    table = comparison_table(runs, after)
    write_page(page, f'Comparison of {len(runs)} runs', title, table, panels, runs[0].sample_time, details)
    return [plot, page]


def _marked_name(name: str, run: RecordedRun, judged: Verdict | None) -> str:
    """Return the name of a run, with its faults."""
    marks = [run.status] if _ended(run) else []
    marks += [] if judged is None or judged.tracks else [judged.text]
    return f'{name} ({", ".join(marks)})' if marks else name


def reject_different_units(runs: Sequence[RecordedRun]) -> None:
    """Reject runs whose drives are in different units: raises ValueError."""
    if len({(run.length_unit, run.control_unit) for run in runs}) > 1:
        units = ', '.join(f'{run.path}: {run.length_unit} and {run.control_unit}' for run in runs)
        raise ValueError(f'runs in different units cannot be compared: {units}')


def comparison_table(
    runs: Sequence[RecordedRun], after: float | None = None, by_source: Sequence[ErrorBySource | None] = ()
) -> tuple[list[str], list[list[str]]]:
    """
    Return header and rows of the table of metrics of several runs.

    Parameters
    ----------
    runs
        The runs.
    after
        Start of the window [s].
    by_source
        Contribution of each source to the error of each run, if it is to be in the table.

    Raises
    ------
    ValueError
        If the units of the runs differ.
    """
    reject_different_units(runs)
    by_run = [{metric.name: metric for metric in run_metrics(run, after)} for run in runs]
    for metrics, run, found in zip(by_run, runs, by_source, strict=False):
        metrics |= {metric.name: metric for metric in source_metrics(run, found)} if found is not None else {}
    first: dict[str, Metric] = {}
    for metrics in by_run:
        for name, metric in metrics.items():
            first.setdefault(name, metric)
    lines = [
        [
            f'{metric.label} [{shown(metric.unit)}]' if metric.unit else metric.label,
            *(_number(metrics[name].value) if name in metrics else '' for metrics in by_run),
        ]
        for name, metric in first.items()
    ]
    lines.insert(0, ['controller', *(run.controller for run in runs)])
    lines.insert(1, ['status', *(run.status for run in runs)])
    lines.insert(2, ['verdict', *(_in_table(verdict_of(run, after)) for run in runs)])
    lines.insert(3, ['errors from [s]', *(_number(run.time_at(steady_start(run, after))) for run in runs)])
    clipped = [_saturation(run, after) for run in runs]
    for name in dict.fromkeys(name for found in clipped if found is not None for name in found):
        counts = ('' if found is None else str(found.get(name, (0, 0))[0]) for found in clipped)
        lines.append([f'saturated samples of the {name}', *counts])
    return ['', *run_names(runs)], lines


def _saturation(run: RecordedRun, after: float | None) -> dict[str, tuple[int, int]] | None:
    """Return sample count and first tick of each clipped signal; None if bag or ``run.yaml`` lack the data."""
    return dict(sums_of(run, after).saturated) if has_saturation_data(run) else None


def _number(value: float) -> str:
    return f'{value:.4g}'


def _subtitle(
    run: RecordedRun, after: float | None, judged: Verdict | None, clipped: Mapping[str, tuple[int, int]] | None
) -> str:
    since = run.time_at(steady_start(run, after))
    saturated = f'; clipped: {saturation_line(clipped, run.row_count)}' if clipped else ''
    first_tick = 0 if run.is_long else int(run.ticks[0])
    how = [_ended(run) or run.status, *([] if judged is None else [judged.in_words])]
    return (
        f'{"; ".join(how)}; ticks {first_tick} to {run.last_tick} of {run.sample_time:g} s; '
        f'errors and spectrum from {since:g} s on{saturated}'
    )


def _details(run: RecordedRun) -> dict[str, list[tuple[str, str]]]:
    """Return the content of ``run.yaml`` and the parameter changes as two-column tables."""
    description: dict[str, Any] = {name: value for name, value in run.description.items() if name != 'nodes'}
    details = {'run': list(_flat(description, ''))} if description else {}
    for node, entries in run.description.get('nodes', {}).items():
        details[f'parameters of {node}'] = list(_flat(entries['parameters'], ''))
    changes = [
        (f'tick {change.tick}', f'{change.node} {change.name} = {change.value}') for change in run.parameter_changes
    ]
    if changes:
        details['parameters changed during the run'] = changes
    return details


def _differences(runs: Sequence[RecordedRun]) -> list[list[str]]:
    """Return the differences of the ``run.yaml`` files, one row each, with node names without namespace."""
    contents = []
    for run in runs:
        flat = dict(_flat({name: value for name, value in run.description.items() if name != 'nodes'}, ''))
        for node, entries in run.description.get('nodes', {}).items():
            flat.update(_flat(entries['parameters'], f'{node.rsplit("/", 1)[-1]} '))
        contents.append(flat)
    names = dict.fromkeys(name for flat in contents for name in flat)
    lines = [[name, *(flat.get(name, '') for flat in contents)] for name in names]
    return [['', *run_names(runs)], *(line for line in lines if len(set(line[1:])) > 1)]


def _flat(values: dict[str, Any], prefix: str) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, dict):
            lines += _flat(value, f'{prefix}{name}.')
        else:
            lines.append((f'{prefix}{name}', str(value)))
    return lines
