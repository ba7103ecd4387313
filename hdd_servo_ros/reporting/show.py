"""What `rig` and `simulate` do once a run is on disk."""

from pathlib import Path

from hdd_servo_ros.bench.response import read_csv
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.reporting.response import CSV, describe
from hdd_servo_ros.reporting.summary import summary


def show_run(directory: Path, *, plot: bool) -> None:
    """Print the summary of a recorded run, and draw it into its folder as ``run.png`` if asked to."""
    if (directory / CSV).is_file():
        # A sweep follows no reference: what there is to show has been written when it ended.
        print(f'{"response":>16}  {describe(read_csv(directory / CSV))}\n{"run folder":>16}  {directory}')
        return
    signals, run = RecordedRun.open(directory), read_run_yaml(directory)
    print(summary(signals, run, directory))
    if plot:
        from hdd_servo_ros.reporting.plot import plot_run

        picture = directory / 'run.png'
        plot_run(signals, run, picture)
        print(f'{"picture":>16}  {picture}')
