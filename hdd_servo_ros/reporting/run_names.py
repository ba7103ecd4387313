"""Names of runs, for titles, legends and directories."""

from collections.abc import Sequence

from hdd_servo_ros.recording.recorded_run import RecordedRun


def run_name(run: RecordedRun) -> str:
    """Return the name of the run directory."""
    path = run.path.resolve()
    return _printable(path.parent.name if path.name == 'bag' and run.description else path.name)


def run_names(runs: Sequence[RecordedRun]) -> list[str]:
    """Return unique names for several runs."""
    names = [run_name(run) for run in runs]
    return [
        name if names.count(name) == 1 else _printable(str(run.path)) for run, name in zip(runs, names, strict=True)
    ]


def _printable(name: str) -> str:
    """Return a file name with escapes for bytes that are not UTF-8, which plots and pages cannot show."""
    return name.encode('utf-8', 'backslashreplace').decode('utf-8')
