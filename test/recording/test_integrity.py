"""A changed byte is never read as data: it is found, or it changes nothing that is read."""

import contextlib
import re
import shutil
import sqlite3
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader

from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.mcap_checks import check_mcap
from hdd_servo_ros.recording.recovery import Recovery
from hdd_servo_ros.recording.run_folder import read_run_yaml, rewrite_run_yaml
from hdd_servo_ros.recording.sqlite_checksums import BLOCK_TICKS, SELECT, TABLE, unpack
from hdd_servo_ros.recording.sqlite_pages import MessagePages
from hdd_servo_ros.tools.recover import main as recover
from hdd_servo_ros.tools.report import main as report

LAST_TICK = 1200
KINDS = {'mcap': (), 'zstd': ('compression:=zstd',), 'sqlite3': ('storage:=sqlite3',)}
FLIPS = 40
"""Bytes that are changed in each kind of bag."""


@pytest.fixture(scope='module')
def runs(simulated, tmp_path_factory):
    base = tmp_path_factory.mktemp('runs')
    made = {}
    for kind, options in KINDS.items():
        arguments = (f'duration:={LAST_TICK * 1e-4}', 'schedule:=["0.05 reference_generator frequency 150"]', *options)
        made[kind] = simulated(base / kind, *[word for argument in arguments for word in ('-p', argument)])
    return made


def file_of(run):
    return next(path for path in (run / 'bag').iterdir() if path.suffix in ('.mcap', '.db3'))


def copy_of(run, path):
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(run, path)
    return path


def everything(run):
    """Return all that a bag holds: by topic its receive times and its payloads."""
    found = Run.open(run).messages_by_topic()
    return {topic: (times.tolist(), payloads) for topic, (times, payloads) in found.items()}


def flips(content, seed):
    """Iterate over a file's content with one byte changed, at offsets over the whole file."""
    rng = np.random.default_rng(seed)
    for offset in rng.integers(0, len(content), FLIPS).tolist():
        changed = bytearray(content)
        changed[offset] ^= int(rng.integers(1, 256))
        yield offset, bytes(changed)


@pytest.mark.parametrize('kind', ['mcap', 'zstd'])
def test_any_changed_byte_of_an_mcap_file_is_found_on_opening(runs, tmp_path, kind):
    run = copy_of(runs[kind], tmp_path / 'run')
    content = file_of(run).read_bytes()
    assert check_mcap(file_of(run))
    for offset, changed in flips(content, 1):
        file_of(run).write_bytes(changed)
        with pytest.raises(BagError, match=r'checksum is wrong|begin and end|invalid summary offset|does not end'):
            Run.open(run)
        assert Recovery(run).finding.faults, offset


@pytest.mark.parametrize('kind', ['mcap', 'zstd'])
def test_what_is_recovered_of_a_changed_mcap_file_is_right(runs, tmp_path, kind, capsys):
    whole = runs[kind]
    for offset, changed in list(flips(file_of(whole).read_bytes(), 2))[:12]:
        run = copy_of(whole, tmp_path / 'run')
        file_of(run).write_bytes(changed)
        assert report([str(run), '--output', str(tmp_path / 'out')]) == 3
        assert re.fullmatch(r'report: .+\n', capsys.readouterr().err), offset
        if recover([str(run)]) == 0:
            said = read_run_yaml(run)
            assert first_difference(whole, run, said['last_tick']) is None
            Run.open(run).verify()
            assert recover([str(run), '--dry-run']) == 0
            assert 'is intact' in capsys.readouterr().out
        else:
            assert read_run_yaml(run)['last_tick'] == -1


def test_a_changed_byte_of_an_sqlite3_file_changes_nothing_that_is_read(runs, tmp_path, capsys):
    """What it has no checksum for (free space, the text of its tables) may change; no message may."""
    run = copy_of(runs['sqlite3'], tmp_path / 'run')
    expected = everything(run)
    found = 0
    for offset, changed in flips(file_of(run).read_bytes(), 3):
        file_of(run).write_bytes(changed)
        try:
            assert everything(run) == expected, offset
        except BagError:
            found += 1
            status = recover([str(run), '--dry-run'])
            text = capsys.readouterr()
            assert status in (0, 1, 3)
            assert 'is intact' not in text.out, offset
        else:
            assert recover([str(run), '--dry-run']) == 0
            assert 'is intact' in capsys.readouterr().out
    assert found > FLIPS // 2


def change_value(run, topic):
    """Change one byte of the payload at tick 700 with the means of SQLite, so that the database stays intact."""
    with contextlib.closing(sqlite3.connect(file_of(run))) as connection:
        where = 'topic_id = (SELECT id FROM topics WHERE name = ?) AND timestamp = 70000000'
        (payload,) = connection.execute(f'SELECT data FROM messages WHERE {where}', (f'/{topic}',)).fetchone()
        changed = payload[:-3] + bytes([payload[-3] ^ 1]) + payload[-2:]
        connection.execute(f'UPDATE messages SET data = ? WHERE {where}', (changed, f'/{topic}'))
        connection.commit()


def without_checksums(run, rows=''):
    """Delete the table of checksums, or the rows of it that fit a condition."""
    with contextlib.closing(sqlite3.connect(file_of(run))) as connection:
        connection.execute(f'DELETE FROM {TABLE} WHERE {rows}' if rows else f'DROP TABLE {TABLE}')
        connection.commit()
        if not rows:
            connection.execute('VACUUM')


@pytest.mark.parametrize('topic', ['clock', 'reference', 'head', 'ldv', 'control', 'estimates'])
def test_a_changed_value_in_an_sqlite3_file_is_rejected_by_all(runs, tmp_path, capsys, topic):
    run = copy_of(runs['sqlite3'], tmp_path / 'run')
    without_checksums(run)
    change_value(run, topic)
    with pytest.raises(BagError, match=f'/{topic} is damaged: the messages do not match their checksum'):
        Run.open(run)[topic]
    assert report([str(run), '--output', str(tmp_path / 'out')]) == 3
    before = sorted(path.name for path in run.iterdir())
    assert recover([str(run)]) == 3
    error = capsys.readouterr().err.splitlines()[-1]
    assert 'the bag contains a changed value that cannot be located; use a copy of the bag' in error
    assert sorted(path.name for path in run.iterdir()) == before


@pytest.mark.parametrize('topic', ['clock', 'control', 'estimates'])
@pytest.mark.parametrize('lost', ['', 'last_id < 100', 'last_id BETWEEN 2000 AND 3500', 'last_id > 5000'])
def test_the_messages_before_a_changed_value_are_recovered(runs, tmp_path, capsys, topic, lost):
    """Checkpoints that are lost elsewhere cost nothing."""
    whole = runs['sqlite3']
    run = copy_of(whole, tmp_path / 'run')
    change_value(run, topic)
    if lost:
        without_checksums(run, lost)
    assert report([str(run), '--output', str(tmp_path / 'out')]) == 3
    assert recover([str(run)]) == 0
    text = capsys.readouterr().out
    found = re.search(r'rows (\d+) to (\d+) do not match their checksum and are left out', text)
    # The value is that of tick 700; there are six messages per tick.
    assert found is not None
    first, last = map(int, found.groups())
    assert first <= 6 * 701 <= last + 6
    assert last - first < 6 * BLOCK_TICKS + 10
    last_tick = read_run_yaml(run)['last_tick']
    assert 700 - BLOCK_TICKS <= last_tick < 700
    assert first_difference(whole, run, last_tick) is None
    assert recover([str(run), '--dry-run']) == 0
    assert 'is intact' in capsys.readouterr().out


@pytest.mark.parametrize('seed', range(3))
def test_recover_takes_no_changed_value_from_a_damaged_sqlite3_file(runs, tmp_path, capsys, seed):
    """Two holes each, in rows, in the table of checksums or in pages that lead to them."""
    whole = runs['sqlite3']
    rng = np.random.default_rng(seed)
    ticks = []
    for _ in range(6):
        run = copy_of(whole, tmp_path / 'run')
        content = bytearray(file_of(run).read_bytes())
        for offset in rng.integers(0, len(content), 2).tolist():
            content[offset : offset + 512] = bytes(512)
        file_of(run).write_bytes(content)
        assert recover([str(run)]) in (0, 1, 3)
        if (run / 'bag').exists():
            ticks.append(read_run_yaml(run)['last_tick'])
            assert first_difference(whole, run, ticks[-1]) is None
    capsys.readouterr()
    assert max(ticks) > 100


def test_checkpoints_on_pages_are_those_that_sqlite_reads(runs):
    with contextlib.closing(sqlite3.connect(file_of(runs['sqlite3']))) as connection:
        checkpoints = [checkpoint for row in connection.execute(SELECT) if (checkpoint := unpack(*row))]
        assert connection.execute(f'SELECT count(*) FROM {TABLE}').fetchone() == (len(checkpoints),)
        assert connection.execute('SELECT max(id) FROM messages').fetchone() == (checkpoints[-1].last_id,)
    assert len(checkpoints) >= LAST_TICK // BLOCK_TICKS
    assert sorted(MessagePages(file_of(runs['sqlite3'])).checkpoints(), key=lambda each: each.last_id) == checkpoints


def test_other_readers_ignore_the_table_of_checksums(runs):
    with Reader(runs['sqlite3'] / 'bag') as reader:
        assert len(list(reader.messages())) == reader.message_count
        names = {connection.topic for connection in reader.connections}
    assert names == set(Run.open(runs['sqlite3']).topics)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('claim', [LAST_TICK + 1, LAST_TICK + 1900, LAST_TICK - 1, 0, -1])
@pytest.mark.parametrize('status', ['finished', 'failed', 'interrupted'])
def test_a_claim_that_the_bag_does_not_hold_is_rejected(runs, tmp_path, kind, claim, status):
    run = copy_of(runs[kind], tmp_path / 'run')
    rewrite_run_yaml(run, {**read_run_yaml(run), 'status': status, 'last_tick': claim})
    with pytest.raises(
        BagError, match=f'last_tick in run.yaml is {claim}, but the last tick in the bag is {LAST_TICK}'
    ):
        Run.open(run)
    assert report([str(run), '--output', str(tmp_path / 'out')]) == 3
    assert recover([str(run)]) == 0
    assert read_run_yaml(run)['last_tick'] == LAST_TICK
    assert file_of(run).read_bytes() == file_of(runs[kind]).read_bytes()
    assert len(Run.open(run).time) == LAST_TICK + 1


def without_topic(run, name):
    path = run / 'bag' / 'metadata.yaml'
    content: Any = yaml.safe_load(path.read_text())
    listed = content['rosbag2_bagfile_information']['topics_with_message_count']
    listed[:] = [topic for topic in listed if topic['topic_metadata']['name'] != name]
    path.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize('kind', KINDS)
def test_a_topic_missing_in_the_metadata_is_brought_back(runs, tmp_path, kind):
    run = copy_of(runs[kind], tmp_path / 'run')
    without_topic(run, '/control')
    with pytest.raises(BagError, match=r'run\.yaml lists /control, but metadata\.yaml of the bag does not'):
        Run.open(run)
    assert recover([str(run)]) == 0
    assert first_difference(runs[kind], run) is None
    assert read_run_yaml(run)['status'] == 'finished'


@pytest.mark.parametrize('kind', ['mcap', 'zstd'])
def test_a_zeroed_message_index_is_made_anew(runs, tmp_path, kind):
    run = copy_of(runs[kind], tmp_path / 'run')
    content = bytearray(file_of(run).read_bytes())
    (start, indexes) = index_of(content)
    for at in indexes.values():
        size = int.from_bytes(content[at + 1 : at + 9], 'little')
        content[at + 9 : at + 9 + size] = bytes(size)
    assert start > 0
    file_of(run).write_bytes(content)
    with pytest.raises(BagError):
        Run.open(run)
    assert recover([str(run)]) == 0
    assert first_difference(runs[kind], run) is None
    assert read_run_yaml(run)['last_tick'] == LAST_TICK


def index_of(content):
    """Return where the first chunk begins and the index records of its channels, by an independent reader."""
    io, reader = pytest.importorskip('io'), pytest.importorskip('mcap.reader')
    chunk = reader.make_reader(io.BytesIO(bytes(content))).get_summary().chunk_indexes[0]
    return chunk.chunk_start_offset, chunk.message_index_offsets
