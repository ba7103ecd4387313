"""Runs that a crash cut short, repaired: nothing complete is lost, nothing original is overwritten."""

import contextlib
import errno
import itertools
import os
import shutil
import sqlite3

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.recovery import Recovery, RecoveryError
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.recording.salvage import salvage
from hdd_servo_ros.recording.sqlite_checksums import BLOCK_TICKS
from hdd_servo_ros.simulation.simulate import main as simulate
from hdd_servo_ros.tools.recover import main as recover
from hdd_servo_ros.tools.replay import main as replay
from hdd_servo_ros.tools.report import main as report

LAST_TICK = 2500  # more than two chunks of an MCAP file
TOPICS = ('clock', 'reference', 'head', 'ldv', 'control', 'estimates')
DAMAGE = settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])


def record(directory, storage):
    arguments = {
        'duration': LAST_TICK * 1e-4,
        'run_dir': str(directory),
        'storage': storage,
        'plot': 'false',
        'progress': 'false',
        'schedule': "['0.1 reference_generator frequency 150']",
    }
    parameters = [word for name, value in arguments.items() for word in ('-p', f'{name}:={value}')]
    assert simulate(['--ros-args', *parameters]) == 0
    return directory


@pytest.fixture(scope='module')
def runs(tmp_path_factory):
    base = tmp_path_factory.mktemp('runs')
    return {storage: record(base / storage, storage) for storage in ('mcap', 'sqlite3')}


def damaged(runs, tmp_path, storage='mcap', status='running'):
    """Return a copy of a run as a crash leaves it: no metadata, `run.yaml` still says that it is running."""
    run = tmp_path / 'run'
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(runs[storage], run)
    (run / 'bag' / 'metadata.yaml').unlink()
    said = read_run_yaml(run)
    (run / 'run.yaml').write_text(yaml.safe_dump({**said, 'status': status, 'last_tick': None, 'ended': None}))
    return run, next(path for path in (run / 'bag').iterdir() if path.suffix in ('.mcap', '.db3'))


def assert_repaired(run, original, last_tick):
    said = read_run_yaml(run)
    assert (said['status'], said['last_tick']) == ('recovered', last_tick)
    assert f'recovered up to tick {last_tick}' in said['reason']
    messages = Run.open(run).messages_by_topic()
    assert all(len(messages[f'/{topic}'][0]) == last_tick + 1 for topic in TOPICS)
    assert first_difference(original, run, last_tick) is None
    assert len(messages['/parameter_events'][0]) == (last_tick >= 999)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_bag_without_metadata(runs, tmp_path, storage):
    run, file = damaged(runs, tmp_path, storage)
    before = file.read_bytes()
    assert recover([str(run), '--dry-run']) == 0
    assert not (run / 'damaged').exists()
    assert read_run_yaml(run)['status'] == 'running'
    assert recover([str(run)]) == 0
    assert_repaired(run, runs[storage], LAST_TICK)
    assert (run / 'damaged' / 'bag' / file.name).read_bytes() == before
    assert read_run_yaml(run / 'damaged')['status'] == 'running'
    assert recover([str(run)]) == 0
    assert sorted(path.name for path in run.iterdir()) == ['bag', 'damaged', 'run.yaml']


@DAMAGE
@given(part=st.floats(0.0, 1.0))
@example(part=0.0)
@example(part=1.0)
def test_an_mcap_file_cut_off_anywhere(runs, tmp_path, part):
    run, file = damaged(runs, tmp_path)
    content = file.read_bytes()
    cut = int(part * len(content))
    file.write_bytes(content[:cut])
    finding = Recovery(run).finding
    # What was written before the cut, by an independent count: messages lie in the file in the order of the ticks.
    starts = message_ends(content)
    complete = sum(end <= cut for end in starts)
    assert finding.kept + finding.left == complete
    assert finding.left < len(TOPICS)
    assert recover([str(run)]) == (0 if finding.last_tick >= 0 else 1)
    if finding.last_tick >= 0:
        assert_repaired(run, runs['mcap'], finding.last_tick)
    else:
        assert read_run_yaml(run)['status'] == 'failed'
        assert not (run / 'bag').exists()
    assert (run / 'damaged' / 'bag' / file.name).read_bytes() == content[:cut]


@pytest.mark.parametrize('where', ['head', 'record', 'chunk'])
def test_where_an_mcap_file_is_cut_off_is_said_in_bytes_of_the_file(runs, tmp_path, where):
    run, file = damaged(runs, tmp_path)
    content = file.read_bytes()
    # The record of the second chunk begins behind those of the first and of its indexes.
    chunk = [offset for offset in range(8, len(content)) if content[offset] == 6 and is_chunk(content, offset)][1]
    message = next(end for end in message_ends(content) if end > chunk + 1000)
    cut, beginning = {
        'head': (chunk + 20, chunk),
        'record': (message + 20, message),
        'chunk': (message, chunk),
    }[where]
    file.write_bytes(content[:cut])
    fault = Recovery(run).finding.faults[1]
    assert f'truncated at byte {cut}, within the ' in fault
    assert fault.endswith(f'that begins at byte {beginning}')


def is_chunk(content, offset):
    """Return whether a record at ``offset`` says the lengths of a chunk that is not compressed."""
    size = int.from_bytes(content[offset + 1 : offset + 9], 'little')
    records = content[offset + 37 : offset + 49]
    return size > 40 and records == bytes(4) + (size - 40).to_bytes(8, 'little')


def test_of_a_bag_that_holds_no_tick_the_original_is_kept(runs, tmp_path, capsys):
    run, file = damaged(runs, tmp_path)
    file.write_bytes(content := file.read_bytes()[:5000])
    assert recover([str(run)]) == 1
    kept = run / 'damaged'
    assert f'originals kept: {kept / "bag"} and {kept / "run.yaml"}' in capsys.readouterr().out
    assert (kept / 'bag' / file.name).read_bytes() == content
    assert recover([str(run)]) == 1
    assert 'nothing can be repaired: failed, no complete tick is left' in capsys.readouterr().out
    assert sorted(path.name for path in run.iterdir()) == ['damaged', 'run.yaml']


def message_ends(content, known={}):  # noqa: B006 - computed once
    """Return where each message of the file ends, found by searching for its payload."""
    if not known:
        offset, ends = 0, []
        while (found := content.find(b'\x00\x01\x00\x00', offset)) >= 0:
            length = int.from_bytes(content[found - 30 : found - 22], 'little') - 22
            is_message = found >= 31 and content[found - 31] == 5 and 0 < length < 1000
            if is_message:
                ends.append(found + length)
            offset = ends[-1] if is_message else found + 1
        known['ends'] = ends
    return known['ends']


@DAMAGE
@given(part=st.floats(0.01, 0.99), size=st.integers(1, 100_000))
def test_a_hole_of_zeros_never_gives_a_wrong_message(runs, tmp_path, part, size):
    run, file = damaged(runs, tmp_path)
    content = bytearray(file.read_bytes())
    start = int(part * len(content))
    size = min(size, len(content) - start)
    content[start : start + size] = bytes(size)
    file.write_bytes(content[: start + size])
    finding = Recovery(run).finding
    if finding.last_tick >= 0:
        assert recover([str(run)]) == 0
        assert_repaired(run, runs['mcap'], finding.last_tick)


@settings(DAMAGE, max_examples=6)
@given(part=st.floats(0.0, 1.0))
@example(part=0.0)
@example(part=1.0)
def test_an_sqlite3_file_cut_off_anywhere(runs, tmp_path, part):
    run, file = damaged(runs, tmp_path, 'sqlite3')
    content = file.read_bytes()
    cut = int(part * len(content))
    file.write_bytes(content[:cut])
    finding = Recovery(run).finding
    # The rows lie in the file about as they were written; a few pages at its start hold the tables.
    assert finding.kept + finding.left > 0.95 * len(TOPICS) * LAST_TICK * (cut - 100_000) / len(content)
    assert recover([str(run)]) == (0 if finding.last_tick >= 0 else 1)
    assert (run / 'damaged' / 'bag' / file.name).read_bytes() == content[:cut]
    if finding.last_tick >= 0:
        assert_repaired(run, runs['sqlite3'], finding.last_tick)


def test_an_sqlite3_journal_is_played_back(runs, tmp_path):
    run, file = damaged(runs, tmp_path, 'sqlite3')
    connection = sqlite3.connect(file)
    connection.execute('PRAGMA cache_size = 1')  # so that the database holds what was not committed
    connection.execute('DELETE FROM messages WHERE id > 3000')
    journal = file.with_name(file.name + '-journal')
    kept = journal.read_bytes(), file.read_bytes()
    connection.rollback()
    connection.close()
    journal.write_bytes(kept[0])
    file.write_bytes(kept[1])
    assert recover([str(run)]) == 0
    assert_repaired(run, runs['sqlite3'], LAST_TICK)


def test_what_run_yaml_says_afterwards(runs, tmp_path):
    run, _ = damaged(runs, tmp_path, status='interrupted')
    assert recover([str(run)]) == 0
    said = read_run_yaml(run)
    assert (said['status'], said['last_tick']) == ('interrupted', LAST_TICK)
    assert 'bag repaired' in said['reason']
    run, _ = damaged(runs, tmp_path)
    (run / 'run.yaml').write_text('')
    assert recover([str(run)]) == 0
    assert_repaired(run, runs['mcap'], LAST_TICK)


def test_a_disturbance_is_found_without_run_yaml(runs, tmp_path):
    topics = {**Run.open(runs['mcap']).topics, '/disturbance': 'geometry_msgs/msg/Vector3Stamped'}
    messages = Run.open(runs['mcap']).messages_by_topic()
    messages['/disturbance'] = messages['/head']
    run = tmp_path / 'run'
    writer = BagWriter(run / 'bag', 'mcap', [(topic, kind, 1024) for topic, kind in topics.items()], {})
    for index, topic in enumerate(topics):
        times, payloads = messages[topic]
        # The last tick has no disturbance any more.
        count = len(times) - (topic == '/disturbance')
        writer.write([index] * count, times[:count].tolist(), payloads[:count])
    writer.close()
    (run / 'bag' / 'metadata.yaml').unlink()
    assert recover([str(run)]) == 0
    assert read_run_yaml(run)['last_tick'] == LAST_TICK - 1
    repaired = Run.open(run)
    assert repaired.disturbance.force.tolist() == Run.open(runs['mcap']).head.position[:LAST_TICK].tolist()


def test_a_whole_run_is_left_alone(runs, tmp_path, capsys):
    run = tmp_path / 'run'
    shutil.copytree(runs['mcap'], run)
    assert recover([str(run)]) == 0
    assert 'is intact: finished, last tick 2500' in capsys.readouterr().out
    assert not (run / 'damaged').exists()


def test_processes_that_end_meanwhile_do_no_harm(runs, tmp_path, monkeypatch):
    """Then /proc answers that there is no such process."""
    own, scan = f'/proc/{os.getpid()}/fd', os.scandir

    def scandir(path):
        if os.fspath(path) == own:
            raise ProcessLookupError(errno.ESRCH, os.strerror(errno.ESRCH))
        return scan(path)

    def listdir(path, names=os.listdir):
        if os.fspath(path) == own:
            raise ProcessLookupError(errno.ESRCH, os.strerror(errno.ESRCH))
        return names(path)

    monkeypatch.setattr(os, 'scandir', scandir)
    monkeypatch.setattr(os, 'listdir', listdir)
    run = tmp_path / 'run'
    shutil.copytree(runs['mcap'], run)
    assert not Recovery(run).finding.faults


def test_what_cannot_be_repaired(runs, tmp_path, capsys):
    assert recover([str(tmp_path)]) == 3
    assert 'is not a run folder' in capsys.readouterr().err
    run, file = damaged(runs, tmp_path)
    with file.open('rb'), pytest.raises(RecoveryError, match='still has the bag open'):
        Recovery(run)
    file.unlink()
    assert recover([str(run)]) == 1
    assert read_run_yaml(run)['status'] == 'failed'


def test_random_bytes_are_no_bag(tmp_path):
    path = tmp_path / 'bag.mcap'
    path.write_bytes(np.random.default_rng(1).bytes(10_000))
    assert salvage(path).messages == []
    assert 'does not begin as an MCAP file' in salvage(path).fault


@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        ({'status': 'frob'}, "run.yaml: status is 'frob'; expected one of running, finished"),
        ({}, 'run.yaml has no status'),
        ({'status': 'running'}, 'status in run.yaml is still running'),
    ],
)
def test_what_run_yaml_says_of_the_end_is_told_as_it_is(runs, tmp_path, capsys, change, fault):
    run = tmp_path / 'run'
    shutil.copytree(runs['mcap'], run)
    said = {key: value for key, value in read_run_yaml(run).items() if key != 'status'}
    (run / 'run.yaml').write_text(yaml.safe_dump({**said, **change}))
    assert recover([str(run)]) == 0
    assert fault in capsys.readouterr().out
    assert read_run_yaml(run)['nodes'] == said['nodes']
    assert_repaired(run, runs['mcap'], LAST_TICK)


@pytest.mark.parametrize('entry', ['versions', 'controller', 'frame_id', 'topics_left_out', 'reason', 'git_revision'])
def test_a_wrong_entry_of_run_yaml_costs_that_alone(runs, tmp_path, capsys, entry):
    run = tmp_path / 'run'
    shutil.copytree(runs['mcap'], run)
    said = read_run_yaml(run)
    (run / 'run.yaml').write_text(yaml.safe_dump({**said, entry: [[1], {'a': 2}]}))
    for command in (report, replay):
        assert command([str(run)]) == 3
        assert f'run.yaml does not describe a run: {entry} is [[1], ' in capsys.readouterr().err
    assert recover([str(run)]) == 0
    assert f'recover: run.yaml: {entry} is ' in capsys.readouterr().out
    repaired = read_run_yaml(run)
    assert (repaired['status'], repaired['last_tick']) == ('finished', LAST_TICK)
    assert repaired['nodes'] == said['nodes']


def test_an_alias_bomb_in_run_yaml_is_rejected_before_it_grows(runs, tmp_path, capsys):
    run = tmp_path / 'run'
    shutil.copytree(runs['mcap'], run)
    names = 'abcdefghij'
    lines = ['a: &a [x,x,x,x,x,x,x,x,x,x]']
    lines += [f'{b}: &{b} [{",".join(10 * ["*" + a])}]' for a, b in itertools.pairwise(names)]
    said = (run / 'run.yaml').read_text()
    (run / 'run.yaml').write_text('\n'.join([*lines, said]))
    for command in (report, replay):
        assert command([str(run)]) == 3
        assert 'run.yaml cannot be read: line 7: aliases repeat more than' in capsys.readouterr().err
    assert recover([str(run)]) == 0
    assert (run / 'run.yaml').stat().st_size < 2 * len(said)
    assert_repaired(run, runs['mcap'], LAST_TICK)


def changed_database(runs, tmp_path, *statements):
    """Return a copy of a finished run of sqlite3 in whose database some statements were executed."""
    run = tmp_path / 'run'
    shutil.copytree(runs['sqlite3'], run)
    with contextlib.closing(sqlite3.connect(run / 'bag' / 'bag.db3')) as connection, connection:
        for statement in statements:
            connection.execute(statement)
    return run


@pytest.mark.parametrize('topics', [('/head',), ('/clock', '/control'), ('/parameter_events',)])
def test_topics_that_the_table_lacks_are_named_by_the_metadata(runs, tmp_path, topics):
    run = changed_database(runs, tmp_path, *(f"DELETE FROM topics WHERE name = '{topic}'" for topic in topics))
    assert recover([str(run)]) == 0
    assert first_difference(run, runs['sqlite3']) is None
    assert read_run_yaml(run)['last_tick'] == LAST_TICK
    assert len(Run.open(run).parameter_changes) == 1


@pytest.mark.parametrize(
    'change',
    ["data = 'text'", 'data = 7', "timestamp = 'noon'", 'timestamp = 1.5e300', 'topic_id = 99'],
)
def test_ticks_before_a_row_that_is_no_message_are_kept(runs, tmp_path, capsys, change):
    where = "topic_id = (SELECT id FROM topics WHERE name = '/head') AND timestamp = 100000000"
    run = changed_database(runs, tmp_path, f'UPDATE messages SET {change} WHERE {where}')
    assert recover([str(run)]) == 0
    assert 'rows that are not messages: 1, the first is row' in capsys.readouterr().out
    last_tick = read_run_yaml(run)['last_tick']
    # The rest of the block cannot be checked.
    assert 999 - BLOCK_TICKS <= last_tick <= 999
    assert_repaired(run, runs['sqlite3'], last_tick)
    assert first_difference(run, runs['sqlite3'], last_tick=last_tick) is None


def test_a_topic_whose_name_is_no_text(runs, tmp_path):
    run = changed_database(runs, tmp_path, "UPDATE topics SET name = x'00' WHERE name = '/head'")
    assert recover([str(run)]) == 0
    assert first_difference(run, runs['sqlite3']) is None
