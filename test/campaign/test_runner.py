"""Recorded runs by worker processes: what a kill costs, and what is left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.runner import StudyError, run_cases
from hdd_servo_ros.messages.outcome import FINISHED, INTERRUPTED
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import read_run_yaml

ROOT = Path(__file__).parents[2]
LONG = 240.0
STUDY = """
from pathlib import Path
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.runner import run_cases

def case(name, duration):
    return Case(name, 'pid', ('seagate_7200_10.yaml',), {'deterministic_timer:duration': duration})

if __name__ == '__main__':
    run_cases([case('long', 60.0), case('other', 60.0), case('short', 0.1)], Path('out'), without_ros=True)
"""
KILLER = """
import dataclasses
import os
import signal

from hdd_servo_ros.parameters import ParameterSet

@dataclasses.dataclass(frozen=True)
class Parameters(ParameterSet):
    pass

class Killer:
    def __init__(self, parameters: Parameters, sample_time: float) -> None:
        self.count = 0

    def update(self, parameters):
        pass

    def step(self, inputs):
        self.count += 1
        # The first steps are made to find out whether the controller works.
        if self.count > 100:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0
"""


@pytest.fixture
def study(tmp_path):
    """Start a study of three runs in a session of its own; none of its processes is left."""
    (tmp_path / 'study.py').write_text(STUDY)
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    with subprocess.Popen(
        [sys.executable, 'study.py'],
        cwd=tmp_path,
        env=environment,
        start_new_session=True,
        # Tests that run in the background of a shell script inherit an ignored SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        yield process
        for pid in of_session(process.pid):
            os.kill(pid, signal.SIGKILL)


def of_session(session):
    """Return the processes of a session, but for those that have ended."""
    found = []
    for directory in Path('/proc').glob('[0-9]*'):
        try:
            fields = (directory / 'stat').read_text().rpartition(')')[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != 'Z':
            found.append(int(directory.name))
    return found


def wait_until(condition):
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def has_bag(directory):
    return any(file.stat().st_size > 1e6 for file in directory.glob('bag/*'))


def test_runs_whose_worker_is_killed_are_made_again(study, tmp_path):
    out = tmp_path / 'out'
    wait_until(lambda: has_bag(out / 'long') and has_bag(out / 'other'))
    workers = [pid for pid in of_session(study.pid) if pid != study.pid]
    os.kill(workers[0], signal.SIGKILL)
    assert study.wait(LONG) == 0
    assert not of_session(study.pid)
    names = ('long', 'other', 'short')
    assert [read_run_yaml(out / name)['status'] for name in names] == [FINISHED] * 3
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    assert compare_bags([str(out / 'long'), str(out / 'other')]) == 0


def test_workers_leave_signals_of_the_terminal_to_their_parent(study, tmp_path):
    """Such as when it is started by nohup."""
    out = tmp_path / 'out'
    wait_until(lambda: has_bag(out / 'long') and has_bag(out / 'other'))
    for pid in of_session(study.pid):
        if pid != study.pid:
            os.kill(pid, signal.SIGINT)
            os.kill(pid, signal.SIGHUP)
    assert study.wait(LONG) == 0
    assert [read_run_yaml(out / name)['status'] for name in ('long', 'short', 'other')] == [FINISHED] * 3


def test_an_interrupted_study_closes_its_bags(study, tmp_path):
    out = tmp_path / 'out'
    wait_until(lambda: has_bag(out / 'long') and has_bag(out / 'other'))
    study.send_signal(signal.SIGINT)
    assert study.wait(LONG) != 0
    assert not of_session(study.pid)
    for name in ('long', 'other'):
        description = read_run_yaml(out / name)
        assert description['status'] == INTERRUPTED
        assert RecordedRun.open(out / name).last_tick == description['last_tick'] > 0
    assert not (out / 'short').exists()


def test_a_killed_study_leaves_no_process_behind(study, tmp_path):
    wait_until(lambda: has_bag(tmp_path / 'out' / 'long'))
    assert len(of_session(study.pid)) > 1
    study.kill()
    study.wait(LONG)
    wait_until(lambda: not of_session(study.pid))


def test_a_run_that_kills_each_worker_ends_the_study(tmp_path, monkeypatch):
    (tmp_path / 'killer_controller.py').write_text(KILLER)
    monkeypatch.syspath_prepend(str(tmp_path))
    case = Case('a', 'killer_controller:Killer', ('seagate_7200_10.yaml',), {'deterministic_timer:duration': 0.02})
    with pytest.raises(StudyError, match='the run a failed: its process was killed 4 times'):
        run_cases([case], tmp_path / 'out', without_ros=True, report=lambda line: None)
