"""What a run does not import: no time is measured here, `benchmarks/bench_start.py` does that."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

UNUSED = (
    'matplotlib',
    'plotly',
    'pandas',
    'PIL',
    'rosbags',
    'tornado',
    # Numba imports these when it gets its compiler ready, fits and statistics do so when they are asked for.
    'scipy.linalg',
    'scipy.optimize',
    'scipy.signal',
    'scipy.stats',
    'numba.np.linalg',
    'numba.np.arraymath',
    'numba.np.arrayobj',
    'numba.cpython.unicode',
    'hdd_servo_ros.reporting.page',
    'hdd_servo_ros.reporting.plot',
    'hdd_servo_ros.studies',
    'hdd_servo_ros.campaign',
    'hdd_servo_ros.stability.ideal_values',
    # A progress bar is for terminals.
    'tqdm',
    # What belongs to sources, seeks, feedforwards and cancellations that this run does without.
    'hdd_servo_ros.disturbance.parameters',
    'hdd_servo_ros.analysis.feedforward_path',
    'hdd_servo_ros.analysis.initial_values',
    'hdd_servo_ros.analysis.metrics',
    'hdd_servo_ros.analysis.off_track',
    'hdd_servo_ros.analysis.runout',
    'hdd_servo_ros.analysis.runout_sensitivity',
    'hdd_servo_ros.analysis.seek_metrics',
    'hdd_servo_ros.analysis.seek_plans',
    'hdd_servo_ros.reporting.seek_report',
    'hdd_servo_ros.reporting.panel',
    'hdd_servo_ros.messages.scope_blocks',
    # What reads damaged bags, and those of sqlite3.
    'hdd_servo_ros.recording.salvage',
    'hdd_servo_ros.recording.sqlite_reading',
    'hdd_servo_ros.recording.run_in_memory',
)
OF_RIG = {'hdd_servo_ros.disturbance.parameters', 'hdd_servo_ros.messages.scope_blocks'}
"""The nodes of `rig` know each source, and publish for the live view."""
USED_BY_SIMULATE = {'hdd_servo_ros', 'llvmlite', 'numba', 'numpy', 'scipy', 'yaml'}
"""Packages that a run without recording uses; Numba looks at the version of SciPy."""
FOUND_BY_OTHERS = {'coverage', 'cython_runtime', 'ros_wheels_bootstrapper'}
"""What Numba, Cython and the interpreter's start bring along where it is installed."""

CODE = """
import sys
from hdd_servo_ros import executables
code = getattr(executables, sys.argv.pop(1))()
with open('modules', 'w') as file:
    print(*sys.modules, file=file)
sys.exit(code)
"""


def modules_of(bench, name, *ros_arguments):
    """Run an executable to its end; return the modules that it has imported."""
    given = (
        '--params-file',
        str(ROOT / 'params' / 'seagate_7200_10.yaml'),
        '-p',
        'duration:=0.01',
        '-p',
        'plot:=false',
    )
    ended = bench.python('-c', CODE, name, '--ros-args', *given, *ros_arguments)
    assert ended.returncode == 0, ended.stderr
    return (bench.directory / 'modules').read_text().split()


@pytest.mark.parametrize('name', ['simulate', 'rig'])
def test_a_run_does_not_import_what_it_does_not_use(bench, name):
    # What the first two have to compile, if anything, the others find.
    modules_of(bench, name, '-p', 'record:=false')
    modules_of(bench, name, '-p', 'run_dir:=first')
    for recorded in (('-p', 'record:=false'), ('-p', 'run_dir:=recorded')):
        found = modules_of(bench, name, *recorded)
        assert {'numba', 'yaml'} <= set(found)
        imported = {module for module in UNUSED if module in found}
        assert imported == (OF_RIG if name == 'rig' else set()), recorded


def test_simulate_without_recording_uses_few_packages(bench):
    modules_of(bench, 'simulate', '-p', 'record:=false')
    found = {module.partition('.')[0] for module in modules_of(bench, 'simulate', '-p', 'record:=false')}
    packages = {name for name in found - sys.stdlib_module_names if not name.startswith('_')}
    assert packages - FOUND_BY_OTHERS == USED_BY_SIMULATE
