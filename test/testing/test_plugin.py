"""The plugin in a pytest of its own: the fixture makes runs, and costs a session that does not use it nothing."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DEFAULT = ROOT / 'params' / 'seagate_7200_10.yaml'
HEAVY = ('numpy', 'scipy', 'yaml', 'rosbags', 'matplotlib', 'numba', 'rclpy', 'plotly')

pytest_plugins = ['pytester']


def test_runs_are_made_and_checked(pytester, run_pytest):
    pytester.makepyfile(
        f"""
        import pytest

        @pytest.fixture(scope='module')
        def run(servo_run):
            return servo_run({str(DEFAULT)!r}, controller='pid', without_ros=True,
                             overrides={{'duration': 0.05, 'reference_generator': {{'frequency': 200.0}}}})

        def test_passes(run):
            run.check.finished().samples(501).parameter('reference_generator', 'frequency', 200.0)
            assert run.controller == 'pid'

        def test_fails(run):
            run.check.rms_error(at_most=0.001)

        def test_the_graph_gives_the_same_bits(run, servo_run):
            graph = servo_run({str(DEFAULT)!r}, controller='pid', overrides={{'duration': 0.05, 'frequency': 200.0}})
            assert (graph.head == run.head).all()
            assert graph.description['real_time_factor'] > 0.0
        """
    )
    result = run_pytest('--servo-plots', 'plots')
    result.assert_outcomes(passed=2, failed=1)
    text = result.stdout.str()
    found = re.search(r'plot: (\S+)', text)
    assert found is not None
    plot = Path(found.group(1))
    assert plot.parent == pytester.path / 'plots'
    assert plot.is_file()
    # The failure is shown at the line of the test, not inside the package.
    assert 'run.check.rms_error(at_most=0.001)' in text
    assert 'testing/checks.py' not in text


def test_the_plugin_costs_an_unrelated_session_nothing():
    code = f'import hdd_servo_ros.testing.plugin, sys; print(*sorted({{*{HEAVY!r}}} & set(sys.modules)))'
    answer = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, timeout=250)
    assert (answer.returncode, answer.stdout.strip()) == (0, '')
