"""Recovery to another folder, with too little room on the disk, and of more messages than are kept in memory."""

import contextlib
import os
import re
import shutil
import subprocess

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.recovery import Recovery
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.recording.salvaged_messages import SalvagedMessages
from hdd_servo_ros.tools.recover import main as recover

TICKS = Ticks(1e-4)
LAST_TICK = 4999


def damaged_run(path, compression='none'):
    """Record a run and cut off its bag in the last chunk."""
    topics = [(topic, f'/{topic.name}') for topic in LOOP_TOPICS]
    recorder = RunRecorder(
        str(path),
        'mcap',
        topics,
        {'sample_time': 1e-4, 'nodes': {}},
        separate_process=False,
        options=BagOptions(compression),
    )
    vector, array = VectorCodec('drive'), ArrayCodec(['t', 'r'])
    for tick in range(LAST_TICK + 1):
        stamp = TICKS.stamp(tick)
        values = [ClockCodec.pack(stamp), *[vector.pack(stamp, float(tick), 0.0, 0.0)] * 4]
        recorder.write_tick(tick, TICKS.nanoseconds(tick), [*values, array.pack([tick * 1e-4, 0.0])])
    recorder.finish('finished', '')
    bag = path / 'bag' / 'bag.mcap'
    os.truncate(bag, int(0.8 * bag.stat().st_size))
    return path


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob('*') if path.is_file()}


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_recovery_into_another_folder_leaves_the_run_as_it_is(tmp_path, compression):
    run = damaged_run(tmp_path / 'run', compression)
    before = contents(run)
    assert recover([str(run), '--output', str(tmp_path / 'repaired')]) == 0
    assert contents(run) == before
    said = read_run_yaml(tmp_path / 'repaired')
    assert said['status'] == 'recovered'
    repaired = Run.open(tmp_path / 'repaired')
    assert repaired.position.tolist() == list(range(said['last_tick'] + 1))
    assert sorted(path.name for path in (tmp_path / 'repaired').iterdir()) == ['bag', 'run.yaml']
    assert recover([str(run), '--output', str(tmp_path / 'repaired')]) != 0
    assert recover([str(run)]) == 0
    assert read_run_yaml(run)['last_tick'] == said['last_tick']


def test_too_little_room_is_reported_with_what_is_needed(tmp_path, capsys):
    with contextlib.ExitStack() as mounted:
        disk = tmp_path / 'disk'
        disk.mkdir()
        if subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=5m', 'tmpfs', disk], check=False).returncode:
            pytest.skip('a small disk cannot be mounted here')
        mounted.callback(subprocess.run, ['umount', str(disk)], check=True)
        shutil.copytree(damaged_run(tmp_path / 'run'), disk / 'run')
        before = contents(disk / 'run')
        assert recover([str(disk / 'run'), '--dry-run']) == 0
        needed = capsys.readouterr().out.splitlines()[-1]
        assert needed.startswith('recover: the repaired bag needs up to ')
        assert recover([str(disk / 'run')]) != 0
        error = capsys.readouterr().err
        assert re.findall(r'\d+ MB', needed)[0] in error
        assert 'free some space, or write to another disk with --output' in error
        assert error.count('\n') == 1
        assert contents(disk / 'run') == before
        assert recover([str(disk / 'run'), '--output', str(tmp_path / 'repaired')]) == 0
        assert Run.open(tmp_path / 'repaired').last_tick > 0


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_messages_that_are_read_again_are_those_that_are_held(tmp_path, monkeypatch, compression):
    run = damaged_run(tmp_path / 'run', compression)
    held = Recovery(run).finding
    monkeypatch.setattr('hdd_servo_ros.recording.salvaged_messages.MOST_HELD', 0)
    assert Recovery(run).finding == held
    assert recover([str(run)]) == 0
    assert Run.open(run).position.tolist() == list(range(held.last_tick + 1))


def test_the_last_of_the_messages_is_dropped():
    messages = SalvagedMessages()
    messages += [('/a', 0, b'0')]
    messages.begin()
    messages.append(('/a', 1, b'1'))
    messages.append(('/a', 2, b'2'))
    messages.store(lambda: [('/a', 1, b'1'), ('/a', 2, b'2')])
    messages.pop()
    assert list(messages) == [('/a', 0, b'0'), ('/a', 1, b'1')]
    messages.pop()
    messages.pop()
    assert len(messages) == 0
