"""Workers end with the campaign, however it ends, and the next call goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SPEC = {
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 0.1},
    'controllers': ['pid'],
    'vary': [{'reference_generator:amplitude': [1.0, 2.0, 3.0, 4.0]}],
    'metrics': ['rms_error', 'killing_metric:wait'],
}
COMMAND = [sys.executable, '-m', 'hdd_servo_ros.campaign.main', 'spec.yaml', '--output', 'out', '--workers', '2']


def start(folder, **options):
    paths = os.pathsep.join([str(ROOT), str(ROOT / 'test' / 'campaign')])
    environment = {**os.environ, 'PYTHONPATH': paths, 'HDD_SERVO_ROS_TEST_MARKS': str(folder / 'marks')}
    return subprocess.Popen(
        COMMAND,
        cwd=folder,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        # Whoever runs the tests by nohup has it ignored, and so would the command.
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
        **options,
    )


def until(condition, seconds=240.0):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and not condition():
        time.sleep(0.05)
    assert condition()


def waiting(folder):
    return [int(path.name) for path in (folder / 'marks').iterdir() if path.name != 'wait']


def has_ended(pid):
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    # Whoever is to collect it may never do so.
    return state == 'Z'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'spec.yaml').write_text(json.dumps(SPEC))
    (tmp_path / 'marks').mkdir()
    (tmp_path / 'marks' / 'wait').touch()
    yield tmp_path
    for pid in waiting(tmp_path):
        if not has_ended(pid):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM], ids=lambda number: number.name)
def test_workers_end_with_a_campaign_that_is_killed_and_the_next_one_goes_on(folder, number):
    process = start(folder)
    until(lambda: len(waiting(folder)) == 2 or process.poll() is not None)
    pids = waiting(folder)
    process.send_signal(number)
    _, error = process.communicate(timeout=240.0)
    if number == signal.SIGKILL:
        assert process.returncode == -signal.SIGKILL
    else:
        assert process.returncode == 128 + number
        assert error.splitlines()[-1].startswith(f'campaign: ended by {number.name}; finished runs are kept')
        assert 'Exception' not in error
    (folder / 'marks' / 'wait').unlink()
    # At once: no worker that is left has the folder.
    again = start(folder)
    until(lambda: all(map(has_ended, pids)))
    _, error = again.communicate(timeout=240.0)
    assert again.returncode == 0, error


def test_an_error_while_recording_is_one_line_and_ends_the_other_workers(folder):
    spec = {**SPEC, 'controllers': ['pid', 'killing_controller:Waiting'], 'metrics': ['rms_error']}
    (folder / 'spec.yaml').write_text(json.dumps(spec))
    (folder / 'marks' / 'wait').unlink()
    process = start(folder)
    _, error = process.communicate(timeout=240.0)
    assert process.returncode == 0, error
    (folder / 'spec.yaml').write_text(json.dumps({**spec, 'keep': 'all'}))
    (folder / 'out' / 'runs').mkdir()
    (folder / 'out' / 'runs' / '000002').touch()
    (folder / 'marks' / 'wait').touch()
    process = start(folder)
    _, error = process.communicate(timeout=240.0)
    assert process.returncode == 1
    assert 'campaign: run 2 cannot be recorded: ' in error
    assert 'Exception' not in error
    assert len(waiting(folder)) == 1
    assert all(map(has_ended, waiting(folder)))
