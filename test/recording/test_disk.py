"""Room kept on the disk for the end of a run, and what a full disk and a killed writer leave."""

import contextlib
import errno
import os
import signal
import subprocess
import time

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.errors import DiskError, RunError
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.disk import Reserve, write_all, write_durably
from hdd_servo_ros.recording.recovery import Recovery
from hdd_servo_ros.recording.run_folder import RunFolder, read_run_yaml
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.recording.writer_process import launch_writer

TICKS = Ticks(1e-4)
LOST_TICKS = 2000
"""0.2 s at 10 kHz."""


@pytest.fixture
def small_disk(tmp_path):
    """Return a function that gives a folder on a disk of a size [bytes]; only root can mount one."""
    with contextlib.ExitStack() as mounted:

        def mount(size):
            folder = tmp_path / f'disk{size}'
            folder.mkdir()
            command = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(folder)]
            if subprocess.run(command, capture_output=True, check=False).returncode:
                pytest.skip('a small disk cannot be mounted here')
            mounted.callback(subprocess.run, ['umount', str(folder)], check=True)
            return folder

        yield mount


def recorder_of(path, storage='mcap', options=BagOptions(), process=None, recorded=()):  # noqa: B008 - a frozen value
    description = {'sample_time': 1e-4, 'nodes': {}}
    topics = [(topic, f'/{topic.name}') for topic in LOOP_TOPICS]
    return RunRecorder(
        str(path),
        storage,
        topics,
        description,
        separate_process=process is not None,
        process=process,
        options=options,
        recorded=recorded,
    )


def messages(tick):
    stamp, vector = TICKS.stamp(tick), VectorCodec('drive')
    values = [ClockCodec.pack(stamp), *[vector.pack(stamp, float(tick), 0.0, 0.0)] * 4]
    return [*values, ArrayCodec(['t', 'r']).pack([tick * 1e-4, 0.0])]


def record_until_it_fails(recorder, most=20_000):
    for tick in range(most):
        try:
            recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
        except RunError as error:
            return tick, error
    return most, None


@pytest.mark.parametrize('size', [600_000, 1_500_000, 2_000_000, 3_123_456])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('separate', [False, True])
def test_a_full_disk_leaves_a_whole_run_that_has_failed(small_disk, storage, size, separate):
    disk = small_disk(size + 1_000_000 * (storage == 'sqlite3'))
    recorder = recorder_of(disk / 'run', storage, process=launch_writer() if separate else None)
    tick, error = record_until_it_fails(recorder)
    assert 'No space left on device' in str(error)
    with contextlib.suppress(RunError):
        recorder.finish('failed', str(error))
    said = read_run_yaml(disk / 'run')
    assert said['status'] == 'failed'
    assert tick - LOST_TICKS - 1024 <= said['last_tick'] < tick
    assert Recovery(disk / 'run').finding.faults == ()
    if said['last_tick'] >= 0:
        assert Run.open(disk / 'run').position.tolist() == list(range(said['last_tick'] + 1))
    assert sorted(path.name for path in (disk / 'run').iterdir()) == ['bag', 'run.yaml']
    ending = {'mcap': 'mcap', 'sqlite3': 'db3'}[storage]
    assert sorted(path.name for path in (disk / 'run' / 'bag').iterdir()) == [f'bag.{ending}', 'metadata.yaml']


@pytest.mark.parametrize('options', [BagOptions('zstd'), BagOptions(max_bag_size=300_000), BagOptions('zstd', 50_000)])
def test_a_full_disk_with_compression_and_several_files(small_disk, options):
    disk = small_disk(2_000_000)
    recorder = recorder_of(disk / 'run', options=options)
    _, error = record_until_it_fails(recorder, 100_000)
    assert isinstance(error, DiskError)
    recorder.finish('failed', str(error))
    assert read_run_yaml(disk / 'run')['status'] == 'failed'
    assert Recovery(disk / 'run').finding.faults == ()


def test_a_disk_that_is_full_when_the_run_ends(small_disk):
    """What is in memory then does not fit; all that was written before is kept, and the run has failed."""
    disk = small_disk(1_500_000)
    recorder = recorder_of(disk / 'run')
    for tick in range(1000):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    recorder.flush()
    for tick in range(1000, 1300):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    fill(disk / 'other')
    with pytest.raises(DiskError, match='No space left'):
        recorder.finish('finished', '')
    said = read_run_yaml(disk / 'run')
    assert (said['status'], 'No space left' in said['reason']) == ('failed', True)
    assert 999 <= said['last_tick'] < 1300
    assert Run.open(disk / 'run').last_tick == said['last_tick']


def fill(path):
    """Fill the disk to its last byte."""
    with path.open('wb', buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))


def test_a_run_that_cannot_begin_leaves_no_folder(small_disk):
    disk = small_disk(16_384)
    with pytest.raises(OSError, match='No space left on device'):
        RunFolder(disk / 'run', {'nodes': {'/n': {'parameters': {'text': 'x' * 8000}}}})
    assert not (disk / 'run').exists()


def test_run_yaml_has_its_room_from_the_start(small_disk):
    disk = small_disk(200_000)
    folder = RunFolder(disk / 'run', {'nodes': {}})
    fill(disk / 'other')
    folder.close('failed', 'the disk is full' * 500, 7)
    assert read_run_yaml(disk / 'run')['last_tick'] == 7


def test_run_yaml_that_cannot_be_written_is_reported(tmp_path, monkeypatch):
    folder = RunFolder(tmp_path / 'run', {'nodes': {}})
    monkeypatch.setattr(os, 'fsync', fail)
    with pytest.raises(
        OSError, match=r'run/run\.yaml cannot be written, so its status is still running: No space left'
    ):
        folder.close('finished', '', 7)
    assert read_run_yaml(tmp_path / 'run')['status'] == 'running'


def fail(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_reserve_takes_up_room_and_gives_it_back(small_disk):
    disk = small_disk(1_048_576)
    reserve = Reserve(disk / 'reserve')
    reserve.grow(500_000)
    assert reserve.size == 500_000
    with pytest.raises(OSError, match='No space left'):
        reserve.grow(2_000_000)
    assert os.statvfs(disk).f_bfree * os.statvfs(disk).f_bsize <= 1_048_576 - 500_000
    reserve.release()
    reserve.release()
    assert os.statvfs(disk).f_bfree == os.statvfs(disk).f_blocks


def test_a_reserve_where_the_system_cannot_allocate(tmp_path, monkeypatch):
    def reject(*_):
        raise OSError(errno.EOPNOTSUPP, 'not supported')

    monkeypatch.setattr(os, 'posix_fallocate', reject)
    reserve = Reserve(tmp_path / 'reserve')
    reserve.grow(100_000)
    assert (tmp_path / 'reserve').stat().st_blocks * 512 >= 100_000
    reserve.release()


def test_a_text_that_lands_at_once(tmp_path):
    path, temporary = tmp_path / 'text', tmp_path / 'text.tmp'
    temporary.write_bytes(bytes(1000))
    write_durably(path, 'one', temporary)
    assert path.read_text() == 'one'
    write_durably(path, 'another', temporary)
    assert path.read_text() == 'another'
    assert not temporary.exists()


def test_all_is_written_where_the_system_takes_parts(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, 'write', lambda file, data: write(file, data[:7]))
    with (tmp_path / 'file').open('wb') as file:
        write_all(file.fileno(), memoryview(bytes(range(100))))
    assert (tmp_path / 'file').read_bytes() == bytes(range(100))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_writer_that_is_killed_loses_a_fifth_of_a_second(tmp_path, storage):
    """Of a run in real time, and while the run goes on as fast as it can."""
    process = launch_writer()
    recorder = recorder_of(tmp_path / 'run', storage, process=process)
    for tick in range(7001):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    recorder.flush()
    # The writer has read it when the pipe is empty, and 0.2 s later has given it to the system when more comes.
    time.sleep(0.5)
    for tick in range(7001, 7200):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    recorder.flush()
    time.sleep(0.5)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    found = Recovery(tmp_path / 'run').finding
    assert found.last_tick >= 7199 - 199


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('topics', [(), ('head',)])
def test_ticks_in_memory_are_bounded_whatever_the_time(tmp_path, monkeypatch, storage, topics):
    monkeypatch.setattr('hdd_servo_ros.recording.bag_writer.FLUSH_INTERVAL', 1e9)
    recorder = recorder_of(tmp_path / 'run', storage, recorded=topics)
    for tick in range(5000):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
        if tick % 1000 == 999:
            copy = tmp_path / f'copy{tick}'
            copy.mkdir()
            subprocess.run(['cp', '-r', tmp_path / 'run' / 'bag', tmp_path / 'run' / 'run.yaml', copy], check=True)
            assert Recovery(copy).finding.last_tick >= tick - 1024
    recorder.finish('finished', '')
