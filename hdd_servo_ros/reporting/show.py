"""What `rig` and `simulate` do once a run is on disk."""

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
    """Print the summary of a recorded run, and draw it into its folder as ``run.png`` if asked to."""
    if (directory / CSV).is_file():
        # A sweep follows no reference: what there is to show has been written when it ended.
        print(f'{response_line(read_csv(directory / CSV))}\n{"run folder":>16}  {directory}')
        return
    run = RecordedRun.open(directory)
    print(summary(sums_of(run), run.description, directory, verdict_of(run)))
    if may_have_seeks(run):
        # Late: most runs have none.
        from hdd_servo_ros.reporting.seek_report import seek_line
        from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks

        seeks = seek_line(part_with_seeks(run))
        if seeks:
            print(f'{"seeks":>16}  {seeks}')
    low_margin = low_margin_of(run)
    if low_margin:
        print(f'{"margin":>16}  {low_margin}')
    if plot:
        picture = directory / 'run.png'
        drawn = draw_run(run, picture)
        print(f'{"picture":>16}  {picture if drawn else "none: nothing that it shows was recorded"}')


def draw_run(run: RecordedRun, path: Path) -> bool:
    """Draw a run over its time, whole and its last moments, into a PNG file; return whether there is what to draw."""
    # Late: a run that draws nothing need not wait for matplotlib.
    from hdd_servo_ros.reporting.picture import write_picture
    from hdd_servo_ros.reporting.run_panels import panels_over_time

    title = f'{run.controller} on {run.frame_id}, T = {run.sample_time * 1e3:g} ms'
    panels = panels_over_time(run)
    if panels:
        write_picture(panels, title, path)
    return bool(panels)
