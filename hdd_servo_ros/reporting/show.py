"""Summary and plot of a finished run, for `rig` and `simulate`."""

from pathlib import Path

from hdd_servo_ros.bench.response import read_csv
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import may_have_seeks
from hdd_servo_ros.reporting.response import CSV, response_line
from hdd_servo_ros.reporting.run_sensitivity import low_margin_of
from hdd_servo_ros.reporting.run_sums import sums_of
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.reporting.verdict import verdict_of


def show_run(directory: Path, *, plot: bool) -> None:
    """Print the summary of a recorded run, and write ``run.png`` into its directory if requested."""
    if (directory / CSV).is_file():
        # A sweep follows no reference, and wrote its results when it ended.
        print(f'{response_line(read_csv(directory / CSV))}\n{"run folder":>16}  {directory}')
        return
    run = RecordedRun.open(directory)
    print(summary(sums_of(run), run.description, directory, verdict_of(run)))
    if may_have_seeks(run):
        # Imported late: most runs have no seeks.
        from hdd_servo_ros.reporting.seek_report import seek_line
        from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks

        seeks = seek_line(part_with_seeks(run))
        if seeks:
            print(f'{"seeks":>16}  {seeks}')
    low_margin = low_margin_of(run)
    if low_margin:
        print(f'{"margin":>16}  {low_margin}')
    if plot:
        path = directory / 'run.png'
        drawn = draw_run(run, path)
        print(f'{"plot":>16}  {path if drawn else "none: its topics were not recorded"}')


def draw_run(run: RecordedRun, path: Path) -> bool:
    """Write the time plots of a run to a PNG file; return whether the run has any signal to plot."""
    # Imported late: a run without a plot does not wait for matplotlib.
    from hdd_servo_ros.reporting.plot import write_plot
    from hdd_servo_ros.reporting.run_panels import panels_over_time

    title = f'{run.controller} on {run.frame_id}, T = {run.sample_time * 1e3:g} ms'
    panels = panels_over_time(run)
    if panels:
        write_plot(panels, title, path)
    return bool(panels)
