"""Bags whose files leave out what their formats make optional are read all the same."""

import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.run_folder import read_run_yaml, rewrite_run_yaml
from hdd_servo_ros.recording.salvage import salvage
from hdd_servo_ros.tools.recover import main as recover

mcap_writer = pytest.importorskip('mcap.writer')
NO_INDEX = {'index_types': mcap_writer.IndexType.NONE}
CHUNK_INDEX_ONLY = {'index_types': mcap_writer.IndexType.CHUNK}
PARTS = {
    'all parts': {},
    'no message index': CHUNK_INDEX_ONLY,
    'no index': NO_INDEX,
    'no repeated channels': {'repeat_channels': False},
    'no repeated schemas': {'repeat_schemas': False},
    'no statistics': {'use_statistics': False},
    'no summary offsets': {'use_summary_offsets': False},
    'no chunks': {'use_chunking': False},
    'nothing': {
        'index_types': mcap_writer.IndexType.NONE,
        'repeat_channels': False,
        'repeat_schemas': False,
        'use_statistics': False,
        'use_summary_offsets': False,
        'enable_crcs': False,
    },
    'no checksums': {'enable_crcs': False},
    'checksum of the data section': {'enable_data_crcs': True},
}


@pytest.fixture(scope='module')
def runs(simulated, tmp_path_factory):
    base = tmp_path_factory.mktemp('runs')
    options = {'mcap': (), 'sqlite3': ('-p', 'storage:=sqlite3'), 'split': ('-p', 'max_bag_duration:=0.03')}
    options['split zstd'] = (*options['split'], '-p', 'compression:=zstd')
    options['zstd'] = ('-p', 'compression:=zstd')
    return {kind: simulated(base / kind, '-p', 'duration:=0.1', *words) for kind, words in options.items()}


def rewritten(source, path, options, compression='NONE'):
    """Write a run's MCAP file again by another writer, with other optional parts."""
    shutil.copytree(source, path)
    file = path / 'bag' / 'bag.mcap'
    found = salvage(file)
    kind = mcap_writer.CompressionType[compression]
    with file.open('wb') as stream:
        writer = mcap_writer.Writer(stream, chunk_size=50_000, compression=kind, **options)
        writer.start('ros2', 'test')
        schemas = {name: writer.register_schema(name, 'ros2msg', b'') for name in set(found.types.values())}
        channels = {topic: writer.register_channel(topic, 'cdr', schemas[name]) for topic, name in found.types.items()}
        for topic, time, payload in found.messages:
            writer.add_message(channels[topic], time, payload, time)
        writer.finish()
    return path


@pytest.mark.parametrize('compression', ['NONE', 'ZSTD', 'LZ4'])
@pytest.mark.parametrize('parts', PARTS)
def test_mcap(runs, tmp_path, parts, compression, capsys):
    run = rewritten(runs['mcap'], tmp_path / 'run', PARTS[parts], compression)
    assert first_difference(runs['mcap'], run) is None
    before = {path.name: path.read_bytes() for path in (run / 'bag').iterdir()}
    assert recover([str(run)]) == 0
    assert 'is intact: finished, last tick 1000' in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in (run / 'bag').iterdir()} == before


def files_of(path):
    return {file.relative_to(path): file.read_bytes() for file in sorted(path.rglob('*')) if file.is_file()}


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3', 'split', 'split zstd', 'zstd'])
def test_a_whole_run_of_any_kind_is_not_touched(runs, tmp_path, kind, capsys):
    run = tmp_path / 'run'
    shutil.copytree(runs[kind], run)
    before = files_of(run)
    assert recover([str(run)]) == 0
    assert 'is intact: finished, last tick 1000' in capsys.readouterr().out
    assert files_of(run) == before


@pytest.mark.parametrize('kind', ['split', 'split zstd', 'zstd'])
def test_what_run_yaml_says_is_repaired_without_touching_a_whole_bag(runs, tmp_path, kind):
    run = tmp_path / 'run'
    shutil.copytree(runs[kind], run)
    before = files_of(run / 'bag')
    rewrite_run_yaml(run, {**read_run_yaml(run), 'status': 'running', 'last_tick': None})
    assert recover([str(run)]) == 0
    assert (read_run_yaml(run)['status'], read_run_yaml(run)['last_tick']) == ('recovered', 1000)
    assert files_of(run / 'bag') == before
    assert first_difference(runs[kind], run) is None


@pytest.mark.parametrize('kind', ['split', 'split zstd'])
@pytest.mark.parametrize('cut', [0.3, 0.7])
def test_all_files_of_a_split_bag_are_salvaged(runs, tmp_path, kind, cut):
    run = tmp_path / 'run'
    shutil.copytree(runs[kind], run)
    files = sorted((run / 'bag').glob('*.mcap'))
    assert len(files) == 4
    (run / 'bag' / 'metadata.yaml').unlink()
    content = files[2].read_bytes()
    files[2].write_bytes(content[: int(cut * len(content))])
    files[3].unlink()
    rewrite_run_yaml(run, {**read_run_yaml(run), 'status': 'running', 'last_tick': None})
    assert recover([str(run)]) == 0
    last_tick = read_run_yaml(run)['last_tick']
    assert last_tick >= 601
    assert first_difference(runs[kind], run, last_tick) is None


def test_a_missing_file_of_a_split_bag_is_told(runs, tmp_path, capsys):
    run = tmp_path / 'run'
    shutil.copytree(runs['split'], run)
    (run / 'bag' / 'bag_3.mcap').unlink()
    with pytest.raises(BagError, match=r'bag_3\.mcap'):
        Run.open(run)
    assert recover([str(run)]) == 0
    assert 'bag_3.mcap' in capsys.readouterr().out
    assert read_run_yaml(run)['last_tick'] == 902


def compressed_by_rosbag2(source, path):
    """Compress the file of a bag as rosbag2 does in its mode `file`."""
    zstd = pytest.importorskip('backports.zstd')
    shutil.copytree(source, path)
    file = path / 'bag' / 'bag.mcap'
    (path / 'bag' / 'bag.mcap.zstd').write_bytes(zstd.compress(file.read_bytes()))
    file.unlink()
    metadata = yaml.safe_load((path / 'bag' / 'metadata.yaml').read_text())
    content = metadata['rosbag2_bagfile_information']
    content |= {'compression_format': 'zstd', 'compression_mode': 'FILE', 'relative_file_paths': ['bag.mcap.zstd']}
    content['files'][0]['path'] = 'bag.mcap.zstd'
    (path / 'bag' / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    return path


def test_a_bag_that_rosbag2_has_compressed_is_whole_or_rejected(runs, tmp_path, capsys):
    run = compressed_by_rosbag2(runs['mcap'], tmp_path / 'run')
    before = files_of(run)
    assert first_difference(runs['mcap'], run) is None
    assert recover([str(run)]) == 0
    assert 'is intact: finished, last tick 1000' in capsys.readouterr().out
    file = run / 'bag' / 'bag.mcap.zstd'
    file.write_bytes(file.read_bytes()[:1000])
    assert recover([str(run)]) == 3
    error = capsys.readouterr().err
    assert 'bag.mcap.zstd is neither an .mcap nor a .db3 file' in error
    assert len(error.splitlines()) == 1
    file.write_bytes(before[Path('bag/bag.mcap.zstd')])
    assert files_of(run) == before


@pytest.mark.parametrize('compression', ['ZSTD', 'LZ4'])
def test_what_is_left_of_a_compressed_file_is_recovered(runs, tmp_path, compression):
    run = rewritten(runs['mcap'], tmp_path / 'run', {}, compression)
    file = run / 'bag' / 'bag.mcap'
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert recover([str(run)]) == 0
    last_tick = read_run_yaml(run)['last_tick']
    assert last_tick > 300
    assert first_difference(runs['mcap'], run, last_tick) is None


def test_a_file_of_an_unknown_compression_is_rejected(runs, tmp_path, capsys):
    run = rewritten(runs['mcap'], tmp_path / 'run', {}, 'LZ4')
    file = run / 'bag' / 'bag.mcap'
    file.write_bytes(file.read_bytes().replace(b'\3\0\0\0lz4', b'\3\0\0\0xyz'))
    before = files_of(run)
    assert recover([str(run)]) == 3
    error = capsys.readouterr().err
    assert "uses the unsupported compression 'xyz', so recover cannot repair it" in error
    assert len(error.splitlines()) == 1
    assert files_of(run) == before


@pytest.mark.parametrize('has_log', [False, True])
def test_an_sqlite3_file_in_the_mode_wal_is_read_without_writing_beside_it(runs, tmp_path, has_log):
    run = tmp_path / 'run'
    shutil.copytree(runs['sqlite3'], run)
    file = next((run / 'bag').glob('*.db3'))
    connection = sqlite3.connect(file)
    assert connection.execute('PRAGMA journal_mode = wal').fetchone() == ('wal',)
    if has_log:
        # The database holds another payload, and the log alone the right one.
        (kept,) = connection.execute('SELECT data FROM messages WHERE id = 3000').fetchone()
        connection.execute('UPDATE messages SET data = ? WHERE id = 3000', (bytes(len(kept)),))
        connection.commit()
        connection.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        connection.execute('UPDATE messages SET data = ? WHERE id = 3000', (kept,))
        connection.commit()
        files = {path.name: path.read_bytes() for path in (run / 'bag').iterdir() if not path.name.endswith('-shm')}
        connection.close()
        for path in (run / 'bag').iterdir():
            path.unlink()
        for name, content in files.items():
            (run / 'bag' / name).write_bytes(content)
        assert any(name.endswith('-wal') and content for name, content in files.items())
    else:
        connection.close()
    before = files_of(run)
    mode = (run / 'bag').stat().st_mode
    os.chmod(run / 'bag', 0o555)  # noqa: PTH101 - of no effect for root, for whom the files beside are compared
    try:
        opened = Run.open(run)
        assert first_difference(runs['sqlite3'], run) is None
        np.testing.assert_array_equal(opened.ticks, np.arange(1001))
    finally:
        os.chmod(run / 'bag', mode)  # noqa: PTH101
    assert files_of(run) == before
