"""The last tick in `run.yaml` is one that the bag holds, also after a fault of the bag's writer."""

import errno
import os
import signal
import subprocess

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.recovery import Recovery
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.recording.writer_process import launch_writer
from hdd_servo_ros.tools.recover import main as recover

TICKS = Ticks(1e-4)


def recorder_of(path, storage, process=None):
    description = {'sample_time': 1e-4, 'nodes': {}}
    topics = [(topic, f'/{topic.name}') for topic in LOOP_TOPICS]
    return RunRecorder(str(path), storage, topics, description, separate_process=process is not None, process=process)


def messages(tick):
    stamp, vector = TICKS.stamp(tick), VectorCodec('drive')
    values = [ClockCodec.pack(stamp), *[vector.pack(stamp, float(tick), 0.0, 0.0)] * 4]
    return [*values, ArrayCodec(['t', 'r']).pack([tick * 1e-4, 0.0])]


def record(recorder, ticks, at=None, act=None):
    """Record ticks until that fails; call ``act`` at one of them; return what it fails with."""
    for tick in ticks:
        if tick == at and act is not None:
            act()
        try:
            recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
        except Exception as error:
            return error
    return None


def assert_claim_is_held(run, storage):
    """Assert that `run.yaml` says what a recovery finds; return it."""
    said = read_run_yaml(run)
    found = Recovery(run).finding
    assert said['status'] == 'failed'
    assert said['last_tick'] == found.last_tick
    if found.last_tick >= 0:
        assert recover([str(run)]) == 0
        opened = Run.open(run)
        assert opened.last_tick == said['last_tick']
        assert opened.position.tolist() == list(range(said['last_tick'] + 1))
    return said['last_tick']


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('killed_at', [0, 1, 1000, 7000])
def test_a_writer_that_is_killed(tmp_path, storage, killed_at):
    process: subprocess.Popen[bytes] = launch_writer()
    recorder = recorder_of(tmp_path / 'run', storage, process)
    error = record(recorder, range(20_000), killed_at, lambda: os.kill(process.pid, signal.SIGKILL))
    assert isinstance(error, RuntimeError)
    assert not recorder.is_open
    with pytest.raises(RuntimeError):
        recorder.finish('failed', str(error))
    assert assert_claim_is_held(tmp_path / 'run', storage) <= killed_at


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('full_at', [0, 700, 5000])
@pytest.mark.parametrize('closes', [False, True])
def test_a_disk_that_is_full_for_a_while(tmp_path, monkeypatch, storage, full_at, closes):
    """Of one batch, or from then on; what follows a batch that is missing is not recorded."""
    recorder = recorder_of(tmp_path / 'run', storage)
    write_batch = BagWriter.write_batch
    failures: list[int] = []

    def write_or_fail(writer, topics, stamps, sizes, payloads):
        is_full = stamps[-1] >= full_at * 100_000 and not (failures and closes)
        if is_full:
            failures.append(1)
            raise OSError(errno.ENOSPC, 'No space left on device')
        write_batch(writer, topics, stamps, sizes, payloads)

    monkeypatch.setattr(BagWriter, 'write_batch', write_or_fail)
    error = record(recorder, range(20_000))
    assert isinstance(error, OSError)
    assert not recorder.is_open
    recorder.finish('failed', 'the disk was full')
    monkeypatch.undo()
    assert assert_claim_is_held(tmp_path / 'run', storage) < max(full_at, 1)
