"""A rig that is killed together with the process that writes its bag."""

import os
import signal
import time
from pathlib import Path


def children_of(pid):
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = path.read_text().rpartition(')')[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            yield int(path.parent.name)


def test_a_killed_run_is_repaired_and_replayed(bench):
    process = bench.start('rig', '-p', 'duration:=60.0', '-p', 'run_dir:=run')
    file = bench.directory / 'run' / 'bag' / 'bag.mcap'
    deadline = time.monotonic() + 200.0
    # Messages reach the file a chunk of 1 MiB at a time.
    while not file.exists() or file.stat().st_size < 3_000_000:
        assert time.monotonic() < deadline, process.output
        time.sleep(0.05)
    answer = bench.python('-m', 'hdd_servo_ros.tools.recover', 'run')
    assert answer.returncode == 3
    assert 'still has the bag open' in answer.stderr
    writers = list(children_of(process.popen.pid))
    assert writers
    # The writer first: it would close the bag when the rig is gone.
    for pid in (*writers, process.popen.pid):
        os.kill(pid, signal.SIGKILL)
    process.wait()
    answer = bench.python('-m', 'hdd_servo_ros.tools.recover', 'run')
    assert answer.returncode == 0, answer.stdout + answer.stderr
    said = bench.run_yaml('run')
    assert said['status'] == 'recovered'
    assert said['last_tick'] > 2000
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', 'run', '--without-ros')
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert f'ticks 0 to {said["last_tick"]}' in answer.stdout
