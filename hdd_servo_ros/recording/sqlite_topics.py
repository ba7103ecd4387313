"""Topics of an sqlite3 bag whose table of topics may be damaged."""

import sqlite3
from pathlib import Path

from hdd_servo_ros.recording.bag_metadata import MetadataError, read_metadata

Topics = dict[int, tuple[str, str]]
"""Full name and type of each topic, by topic id."""


def topics_of(connection: sqlite3.Connection, bag: Path) -> Topics:
    """
    Return the topics of a database.

    A row missing in the table is restored from ``metadata.yaml``, which lists topics in the order of their ids, if the
    numbers of messages of the missing topics match those in the metadata.

    Parameters
    ----------
    connection
        Connection to the database.
    bag
        Directory of the bag.

    Raises
    ------
    sqlite3.Error
        If the tables cannot be read.
    """
    rows = connection.execute('SELECT id, name, type FROM topics').fetchall()
    known = {row[0]: row[1:] for row in rows if all(map(isinstance, row, (int, str, str)))}
    try:
        metadata = read_metadata(bag)
    except (OSError, MetadataError):
        return known
    named = {name for name, _ in known.values()}
    lacking = [(name, metadata.counts[name]) for name in metadata.types if name not in named and metadata.counts[name]]
    if lacking:
        counts = connection.execute('SELECT topic_id, count(*) FROM messages NOT INDEXED GROUP BY topic_id').fetchall()
        unnamed = sorted((number, count) for number, count in counts if isinstance(number, int) and number not in known)
        if [count for _, count in unnamed] == [count for _, count in lacking]:
            for (number, _), (name, _) in zip(unnamed, lacking, strict=True):
                known[number] = name, metadata.types[name]
    return known


def is_message(time: object, payload: object) -> bool:
    """Return whether a row has a valid receive time and payload; SQLite accepts values of any type in any column."""
    return isinstance(time, int) and isinstance(payload, bytes)
