"""A measured frequency response on disk: its CSV file and Bode plot."""

from pathlib import Path

from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer
from hdd_servo_ros.recording.run_folder import default_run_directory

CSV = 'response.csv'
PICTURE = 'response.png'


def write_response(analyzer: SignalAnalyzer, directory: Path | None) -> list[str]:
    """
    Write the points that an analyzer has measured, and return lines about the files and the points.

    Parameters
    ----------
    analyzer
        The analyzer; its parameter ``plot`` enables the Bode plot.
    directory
        Directory of the run; None for a new one in ``runs``.
    """
    measured = analyzer.response()
    response = measured.at(measured.is_seen)
    lines = []
    for discarded, why in (
        (analyzer.overloaded_frequencies(), 'the vibrometer was overloaded'),
        (measured.frequency[~measured.is_seen].tolist(), 'the output of the vibrometer did not change'),
    ):
        if discarded:
            frequencies = ', '.join(f'{frequency:.5g}' for frequency in discarded)
            lines.append(f'omitted, since {why}: {frequencies} Hz')
    if len(response.frequency) == 0:
        return lines
    if directory is None or not directory.is_dir():
        directory = default_run_directory('signal_analyzer')
        directory.mkdir(parents=True)
    response.write_csv(directory / CSV)
    lines.append(f'{describe(response)}: {directory / CSV}')
    if analyzer.parameters.plot:
        # Imported late: a sweep without a plot does not wait for matplotlib.
        from hdd_servo_ros.reporting.bode import bode

        bode({'measured': response}).savefig(directory / PICTURE, dpi=100)
        lines.append(f'Bode plot: {directory / PICTURE}')
    return lines


def response_line(response: FrequencyResponse) -> str:
    """Return the summary line of a sweep, which follows no reference."""
    return f'{"response":>16}  {describe(response)}'


def describe(response: FrequencyResponse) -> str:
    """Return a short description of a measured response."""
    lowest, highest = response.frequency[0], response.frequency[-1]
    return (
        f'{len(response.frequency)} points from {lowest:.5g} to {highest:.5g} Hz, '
        f'coherence at least {response.coherence.min():.4f}'
    )
