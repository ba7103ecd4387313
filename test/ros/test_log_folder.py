"""The log directory of ROS in environments without a writable home."""

import tempfile
from pathlib import Path

import pytest

from hdd_servo_ros.ros.log_folder import find_log_folder

ELSEWHERE = Path(tempfile.gettempdir())


@pytest.mark.parametrize('environment', [{}, {'HOME': ''}, {'HOME': '/dev/null'}, {'HOME': '/proc/nowhere/at/all'}])
def test_without_a_writable_home_it_is_a_temporary_directory(environment, monkeypatch):
    monkeypatch.setattr('os.access', lambda path, mode: not str(path).startswith('/proc'))
    find_log_folder(environment)
    assert Path(environment['ROS_LOG_DIR']).parent == ELSEWHERE


@pytest.mark.parametrize(
    'given', [{'ROS_LOG_DIR': '/x'}, {'ROS_HOME': '/x', 'HOME': '/dev/null'}, {'HOME': str(ELSEWHERE)}]
)
def test_a_given_or_writable_directory_is_kept(given):
    environment = dict(given)
    find_log_folder(environment)
    assert environment == given


@pytest.mark.new_interpreters
@pytest.mark.parametrize('home', [None, '/dev/null'])
def test_rig_runs_without_a_home(bench, home):
    bench.environment = {name: value for name, value in bench.environment.items() if name != 'HOME'}
    if home is not None:
        bench.environment['HOME'] = home
    process = bench.start('rig', '-p', 'duration:=0.002', '-p', 'record:=false')
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output
