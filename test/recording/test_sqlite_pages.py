"""Rows read page by page, against SQLite itself."""

import contextlib
import sqlite3

import numpy as np
import pytest

from hdd_servo_ros.recording.salvage import salvage
from hdd_servo_ros.recording.sqlite_pages import MessagePages

COUNT = 1500
PAGE = 512


def rows_of(path):
    pages = MessagePages(path)
    return [row[1:] for group in pages.groups() for row in pages.rows(group)]


@pytest.fixture
def database(tmp_path):
    """A bag's tables on pages so small that long payloads go on on others, and that the tree has three levels."""
    path = tmp_path / 'bag.db3'
    draw = np.random.default_rng(3)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute(f'PRAGMA page_size = {PAGE}')
        connection.execute('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT)')
        connection.execute(
            'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)'
        )
        connection.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
        connection.executemany(
            'INSERT INTO topics VALUES (?, ?, ?)', [(1, '/a', 'A'), (2, '/b', 'B'), (300, '/c', 'C')]
        )
        times = [0, 1, 127, 200, 70_000, 20_000_000, 2**33, 2**45, *(2**50 + np.arange(COUNT - 8)).tolist()]
        for number, time in enumerate(times):
            payload = draw.bytes(int(draw.choice([0, 1, 60, 90, 470, 480, 600, 5000], p=[0.1, 0.1, *[0.13] * 5, 0.15])))
            connection.execute('INSERT INTO messages VALUES (NULL, ?, ?, ?)', ((1, 2, 300)[number % 3], time, payload))
        connection.commit()
        rows = connection.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id').fetchall()
    return path, rows


def test_the_rows_are_those_that_sqlite_reads(database):
    path, rows = database
    assert rows_of(path) == rows


def test_few_pages_are_read_at_once(database, monkeypatch):
    path, rows = database
    monkeypatch.setattr('hdd_servo_ros.recording.sqlite_pages._GROUP', 4)
    pages = MessagePages(path)
    parts = [pages.rows(group) for group in pages.groups()]
    assert len(parts) > 20
    assert [row[1:] for part in parts for row in part] == rows


@pytest.mark.parametrize('part', [0.1, 0.5, 0.9])
def test_what_is_left_of_a_file_begins_like_the_whole(database, part):
    path, rows = database
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    found = salvage(path)
    names = {1: '/a', 2: '/b', 300: '/c'}
    assert found.messages == [(names[topic], time, data) for topic, time, data in rows[: len(found.messages)]]
    assert len(found.messages) > 0.8 * part * COUNT
    assert 'the database can be read up to message' in found.fault


@pytest.mark.parametrize('begin', [b'', b'SQLite format 3\0', b'SQLite format 3\0\x02\x00'])
def test_other_files_have_no_rows(tmp_path, begin):
    path = tmp_path / 'other.db3'
    for rest in (b'', bytes(5000), np.random.default_rng(1).bytes(50_000)):
        path.write_bytes(begin + rest)
        assert rows_of(path) == []


def test_a_whole_file_is_read_as_it_lies_there(database, monkeypatch):
    path, rows = database
    names = {1: '/a', 2: '/b', 300: '/c'}
    monkeypatch.setattr('shutil.copyfile', None)
    monkeypatch.setattr('hdd_servo_ros.recording.salvage._ROWS_AT_ONCE', 100)
    monkeypatch.setattr('hdd_servo_ros.recording.salvaged_messages.MOST_HELD', 250)
    before = path.read_bytes(), sorted(path.parent.iterdir())
    found = salvage(path)
    assert not found.fault
    # Beyond the first 250 messages they are read again, as often as they are asked for.
    for _ in range(2):
        assert list(found.messages) == [(names[topic], time, data) for topic, time, data in rows]
    assert (path.read_bytes(), sorted(path.parent.iterdir())) == before


def test_a_cut_file_is_read_again_in_pieces(database, monkeypatch):
    path, rows = database
    path.write_bytes(path.read_bytes()[: -3 * PAGE])
    monkeypatch.setattr('hdd_servo_ros.recording.sqlite_pages._GROUP', 4)
    monkeypatch.setattr('hdd_servo_ros.recording.salvaged_messages.MOST_HELD', 50)
    found = salvage(path)
    names = {1: '/a', 2: '/b', 300: '/c'}
    assert list(found.messages) == [(names[topic], time, data) for topic, time, data in rows[: len(found.messages)]]
    assert len(found.messages) > 0.9 * COUNT


def test_what_is_left_of_a_malformed_file_is_said_to_be_unchecked(database):
    path, _ = database
    content = bytearray(path.read_bytes())
    middle = len(content) // PAGE // 2 * PAGE
    content[middle : middle + PAGE] = b'\xff' * PAGE
    path.write_bytes(content)
    fault = salvage(path).fault
    assert 'malformed; the file has no checksums per block' in fault
