"""
`report`: from recorded runs to figures: metrics, a picture and a page of each run, and a comparison of several.

No ROS import, and nothing but the runs' bags and their ``run.yaml`` is read.
"""

import argparse
import itertools
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from tqdm import tqdm

from hdd_servo_ros.recording.recorded_run import Run
from hdd_servo_ros.reporting.panels import comparison_panels, run_name, run_names, run_panels
from hdd_servo_ros.reporting.run_metrics import Metric, run_metrics, shown_unit, steady_start
from hdd_servo_ros.reporting.saturation import saturation_line


def report_run(run: Run, directory: Path, after: float | None = None) -> list[Path]:
    """
    Write the metrics, the picture and the page of a run.

    Parameters
    ----------
    run
        The run.
    directory
        Where to write ``report.html``, ``report.png`` and ``metrics.yaml``; made if need be.
    after
        Time before which errors do not count [s]; None for the first half of the run, 2 s at most.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError
        If the bag holds nothing to report, or nothing lies after that time.
    """
    # Late: an error in the arguments is told before matplotlib is there.
    from hdd_servo_ros.reporting.page import write_page
    from hdd_servo_ros.reporting.picture import write_picture

    metrics = run_metrics(run, after)
    panels = run_panels(run, after)
    if not panels:
        raise ValueError(f'{run.path}: nothing to report: the bag holds neither /control nor /reference with /head')
    title = f'{run.controller} on {run.frame_id}: {run_name(run)}'
    directory.mkdir(parents=True, exist_ok=True)
    written = [directory / name for name in ('metrics.yaml', 'report.png', 'report.html')]
    content = {
        'errors_from': float(run.time[steady_start(run, after)]),
        'metrics': {metric.name: {'value': metric.value, 'unit': metric.unit} for metric in metrics},
    }
    written[0].write_text(yaml.safe_dump(content, sort_keys=False), 'utf8')
    write_picture(panels, title, written[1])
    lines = [(metric.label, f'{_number(metric.value)} {shown_unit(metric.unit)}') for metric in metrics]
    write_page(written[2], title, _subtitle(run, after), (('', 'value'), lines), panels, run.sample_time, _details(run))
    return written


def compare_runs(runs: Sequence[Run], directory: Path, after: float | None = None) -> list[Path]:
    """
    Write one table and overlay of several runs: ``comparison.html``, ``comparison.png``.

    Raises
    ------
    ValueError
        If the runs are in different units.
    """
    from hdd_servo_ros.reporting.page import write_page
    from hdd_servo_ros.reporting.picture import write_picture

    panels = comparison_panels(runs, after)
    directory.mkdir(parents=True, exist_ok=True)
    picture, page = directory / 'comparison.png', directory / 'comparison.html'
    names = run_names(runs)
    write_picture(panels, ', '.join(names), picture)
    details = {'what differs in run.yaml': _differences(runs)}
    table = comparison_table(runs, after)
    write_page(page, f'Comparison of {len(runs)} runs', ', '.join(names), table, panels, runs[0].sample_time, details)
    return [picture, page]


def _refuse_different_units(runs: Sequence[Run]) -> None:
    if len({(run.length_unit, run.control_unit) for run in runs}) > 1:
        said = ', '.join(f'{run.path}: {run.length_unit} and {run.control_unit}' for run in runs)
        raise ValueError(f'runs in different units cannot be compared: {said}')


def comparison_table(runs: Sequence[Run], after: float | None = None) -> tuple[list[str], list[list[str]]]:
    """Return head and lines of the table of metrics of several runs; raises ValueError if their units differ."""
    _refuse_different_units(runs)
    by_run = [{metric.name: metric for metric in run_metrics(run, after)} for run in runs]
    first: dict[str, Metric] = {}
    for metrics in by_run:
        for name, metric in metrics.items():
            first.setdefault(name, metric)
    lines = [
        [
            f'{metric.label} [{shown_unit(metric.unit)}]' if metric.unit else metric.label,
            *(_number(metrics[name].value) if name in metrics else '' for metrics in by_run),
        ]
        for name, metric in first.items()
    ]
    lines.insert(0, ['controller', *(run.controller for run in runs)])
    lines.insert(1, ['errors from [s]', *(_number(float(run.time[steady_start(run, after)])) for run in runs)])
    return ['', *run_names(runs)], lines


def _number(value: float) -> str:
    return f'{value:.4g}'


def _subtitle(run: Run, after: float | None) -> str:
    ended = run.status + (f': {run.reason}' if run.reason else '')
    since = float(run.time[steady_start(run, after)])
    saturation = saturation_line(run, run.description) if 'ldv' in run and 'control' in run else ''
    clipped = f'; clipped: {saturation}' if saturation else ''
    return (
        f'{ended}; ticks {run.ticks[0]} to {run.last_tick} of {run.sample_time:g} s; '
        f'errors and spectrum from {since:g} s on{clipped}'
    )


def _details(run: Run) -> dict[str, list[tuple[str, str]]]:
    """Return everything that ``run.yaml`` says, and the parameters that were changed, as tables of two columns."""
    description: dict[str, Any] = {name: value for name, value in run.description.items() if name != 'nodes'}
    details = {'run': list(_flat(description, ''))} if description else {}
    for node, said in run.description.get('nodes', {}).items():
        details[f'parameters of {node}'] = list(_flat(said['parameters'], ''))
    changes = [
        (f'tick {change.tick}', f'{change.node} {change.name} = {change.value}') for change in run.parameter_changes
    ]
    if changes:
        details['parameters changed during the run'] = changes
    return details


def _differences(runs: Sequence[Run]) -> list[list[str]]:
    """Return what ``run.yaml`` says differently of the runs, a line each; nodes go by their names without namespace."""
    said = []
    for run in runs:
        flat = dict(_flat({name: value for name, value in run.description.items() if name != 'nodes'}, ''))
        for node, entries in run.description.get('nodes', {}).items():
            flat.update(_flat(entries['parameters'], f'{node.rsplit("/", 1)[-1]} '))
        said.append(flat)
    names = dict.fromkeys(name for flat in said for name in flat)
    lines = [[name, *(flat.get(name, '') for flat in said)] for name in names]
    return [['', *run_names(runs)], *(line for line in lines if len(set(line[1:])) > 1)]


def _flat(values: dict[str, Any], prefix: str) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, dict):
            lines += _flat(value, f'{prefix}{name}.')
        else:
            lines.append((f'{prefix}{name}', str(value)))
    return lines


def _directories(runs: Sequence[Run], output: Path | None) -> list[Path]:
    """Return where each run's own report goes: below ``output``, a name that several have with a number behind it."""
    if output is None or len(runs) == 1:
        return [output or run.path for run in runs]
    directories: list[Path] = []
    for run in runs:
        name = run_name(run)
        numbered = (output / (f'{name}-{number}' if number > 1 else name) for number in itertools.count(1))
        directories.append(next(directory for directory in numbered if directory not in directories))
    return directories


def _print_table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> None:
    widths = [max(len(line[column]) for line in [head, *lines]) for column in range(len(head))]
    for line in [head, *lines]:
        print('  '.join(f'{text:>{width}}' for text, width in zip(line, widths, strict=True)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Report runs; exit code 0, or 2 if one cannot be read."""
    parser = argparse.ArgumentParser(
        prog='report',
        description='Metrics, a picture (report.png) and a page (report.html) of each run, from its bag alone; '
        'of several runs also one table and overlay (comparison.png, comparison.html).',
    )
    parser.add_argument('run', type=Path, nargs='+', help='run folder, or a bag of the same topics')
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help="where to write; of several runs each in a folder of its name below (default: each run's own folder, "
        'the comparison beside the first run)',
    )
    parser.add_argument(
        '--after',
        type=float,
        metavar='SECONDS',
        help='time before which errors do not count (default: half of the run, 2 s at most)',
    )
    options = parser.parse_args(arguments)
    try:
        runs = [Run.open(path) for path in options.run]
        _refuse_different_units(runs)
        written = []
        jobs = tqdm(runs, desc='report', unit='run', disable=not sys.stderr.isatty() or len(runs) < 2)
        for directory, run in zip(_directories(runs, options.output), jobs, strict=True):
            written += report_run(run, directory, options.after)
        if len(runs) > 1:
            beside = options.run[0].resolve().parent if options.output is None else options.output
            written += compare_runs(runs, beside, options.after)
        table = comparison_table(runs, options.after)
    except (ValueError, OSError) as error:
        print(f'report: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print('report: interrupted', file=sys.stderr)
        return 128 + signal.SIGINT
    _print_table(*table)
    for path in written:
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
