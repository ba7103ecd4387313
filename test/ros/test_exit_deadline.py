"""Processes that hang in native code, with the GIL held, as in a deadlock of Fast DDS."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HANG = 'import ctypes; hang = ctypes.PyDLL(None).pause\n'
"""``hang`` never returns and keeps the GIL: no other thread and no signal handler of Python can run."""


def run(code, timeout=100.0):
    """Return exit code and stderr of a Python process."""
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, timeout=timeout)
    return done.returncode, done.stderr


@pytest.mark.parametrize('exit_code', [0, 1, 130])
def test_a_hanging_call_ends_with_the_exit_code_and_shows_where_it_hangs(exit_code):
    code = (
        f'{HANG}from hdd_servo_ros.ros.exit_deadline import exit_deadline\nwith exit_deadline({exit_code}, 1.0): hang()'
    )
    found, printed = run(code)
    assert found == exit_code
    assert 'most recent call first' in printed


def test_a_body_that_ends_in_time_is_not_disturbed():
    code = (
        'import time\nfrom hdd_servo_ros.ros.exit_deadline import exit_deadline\n'
        'with exit_deadline(7, 0.2): pass\ntime.sleep(0.5)'
    )
    assert run(code) == (0, '')


@pytest.mark.parametrize('stage', ['destroy_node', 'exit'])
def test_a_node_whose_shutdown_hangs_ends_with_the_exit_code_of_its_run(stage, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    hook = {
        'destroy_node': 'ReferenceGenerator.destroy_node = lambda self: hang()',
        'exit': 'import atexit; atexit.register(hang)',
    }[stage]
    code = (
        f'import sys\n{HANG}\n'
        'from hdd_servo_ros.nodes import main as module\n'
        'from hdd_servo_ros.nodes.reference_generator import ReferenceGenerator\n'
        'from hdd_servo_ros.ros import exit_deadline\n'
        f'{hook}\n'
        'exit_deadline.exit_deadline.__wrapped__.__defaults__ = (2.0,)\n'
        'module.SHUTDOWN_TIMEOUT = 2.0\n'
        "sys.argv = ['reference_generator', '--ros-args', '-p', 'start_timeout:=0.5']\n"
        "sys.exit(module.run_node('reference_generator', ReferenceGenerator))"
    )
    start = time.monotonic()
    exit_code, printed = run(code)
    assert exit_code == 1, printed
    assert 'run failed: timed out after 0.5 s' in printed
    assert 'most recent call first' in printed
    assert time.monotonic() - start < 60.0
