"""Runs whose bags are compressed, split or hold some topics only are read like any other."""

import shutil

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.simulation.simulate import main as simulate
from hdd_servo_ros.studies.stability_certificate import main as certificate
from hdd_servo_ros.tools.recover import main as recover
from hdd_servo_ros.tools.replay import main as replay
from hdd_servo_ros.tools.report import main as report

LAST_TICK = 4000
SCHEDULE = ('-p', "schedule:=['0.1 reference_generator frequency 150']")
OPTIONS = {
    'compressed': ('-p', 'compression:=zstd'),
    'by_duration': ('-p', 'max_bag_duration:=0.15'),
    'by_size': ('-p', 'max_bag_size:=1000000'),
    'all': ('-p', 'compression:=zstd', '-p', 'max_bag_duration:=0.15', '-p', 'max_bag_size:=500000'),
}


@pytest.fixture(scope='module')
def runs(tmp_path_factory, simulated):
    base = tmp_path_factory.mktemp('runs')
    duration = ('-p', f'duration:={LAST_TICK * 1e-4}')
    more = {'plain': (), **OPTIONS, 'some': ('-p', 'topics:=[control, head]')}
    return {name: simulated(base / name, *duration, *SCHEDULE, *arguments) for name, arguments in more.items()}


@pytest.mark.parametrize('name', OPTIONS)
def test_the_same_run_by_every_reader(runs, tmp_path, capsys, name):
    run = runs[name]
    assert first_difference(runs['plain'], run) is None
    plain, other = Run.open(runs['plain']), Run.open(run)
    assert np.array_equal(plain.control, other.control)
    assert plain.parameter_changes == other.parameter_changes
    assert run_metrics(plain) == run_metrics(other)
    if name == 'all':  # by the command as well, once with every option
        for path in (run, runs['plain']):
            assert report([str(path), '--output', str(tmp_path / path.name)]) == 0
        metrics = [(tmp_path / path.name / 'metrics.yaml').read_text() for path in (run, runs['plain'])]
        assert metrics[0] == metrics[1]
    assert replay([str(run), '--without-ros']) == 0
    assert 'bit-identical on every topic' in capsys.readouterr().out


def test_the_files(runs):
    def files(name):
        return sorted((runs[name] / 'bag').glob('*.mcap'))

    size = files('plain')[0].stat().st_size
    assert files('compressed')[0].stat().st_size < size / 2.5
    assert [file.name for file in files('by_duration')] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    assert len(files('by_size')) > 1


@pytest.mark.parametrize('name', OPTIONS)
@pytest.mark.parametrize('left', [0.1, 0.6])
def test_a_crash_in_the_last_file(runs, tmp_path, name, left):
    run = tmp_path / 'run'
    shutil.copytree(runs[name], run)
    (run / 'bag' / 'metadata.yaml').unlink()
    said = read_run_yaml(run)
    (run / 'run.yaml').write_text(yaml.safe_dump({**said, 'status': 'running', 'last_tick': None}))
    files = sorted((run / 'bag').glob('*.mcap'))
    content = files[-1].read_bytes()
    files[-1].write_bytes(content[: int(left * len(content))])
    assert recover([str(run)]) == 0
    last_tick = read_run_yaml(run)['last_tick']
    # Whole files before it are kept whole.
    assert last_tick >= 1400 * (len(files) - 1)
    assert first_difference(runs['plain'], run, last_tick) is None
    assert len(Run.open(run).parameter_changes) == (last_tick >= 999)
    written = sum(file.stat().st_size for file in (run / 'bag').glob('*.mcap'))
    if 'zstd' in ' '.join(OPTIONS[name]) and last_tick > 1000:
        assert written < 300 * last_tick


def test_a_run_of_some_topics(runs, tmp_path, capsys):
    run = Run.open(runs['some'])
    assert sorted(run.counts.items()) == [('control', LAST_TICK + 1), ('head', LAST_TICK + 1)]
    assert np.array_equal(run.head, Run.open(runs['plain']).head)
    assert run.ticks.tolist() == list(range(LAST_TICK + 1))
    with pytest.raises(
        BagError, match='the bag does not contain topic reference; it contains /head, /control, /parameter_events'
    ):
        _ = run.error
    assert len(run.parameter_changes) == 1
    assert read_run_yaml(runs['some'])['topics_left_out'] == {
        'clock': '/clock',
        'reference': '/reference',
        'ldv': '/ldv',
        'estimates': '/estimates',
    }
    capsys.readouterr()
    assert report([str(runs['some']), '--output', str(tmp_path / 'report')]) == 0
    assert compare_bags([str(runs['plain']), str(runs['some'])]) == 1
    assert f'clock is missing in {runs["some"]}' in capsys.readouterr().out
    assert replay([str(runs['some']), '--without-ros']) == 0
    assert 'bit-identical' in capsys.readouterr().out
    assert certificate([str(runs['some'])]) == 3
    assert capsys.readouterr().err.count('\n') == 1


def test_a_crash_of_a_run_of_some_topics(runs, tmp_path):
    run = tmp_path / 'run'
    shutil.copytree(runs['some'], run)
    (run / 'bag' / 'metadata.yaml').unlink()
    file = run / 'bag' / 'bag.mcap'
    file.write_bytes(file.read_bytes()[:400_000])
    assert recover([str(run)]) == 0
    last_tick = Run.open(run).last_tick
    assert last_tick > 1500
    assert np.array_equal(Run.open(run).control, Run.open(runs['plain']).control[: last_tick + 1])


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (
            ('compression:=lz4',),
            "invalid value for parameter bag_recorder:compression: 'lz4'; expected one of none, zstd",
        ),
        (
            ('compression:=zstd', 'storage:=sqlite3'),
            "bag_recorder:compression: 'zstd'; expected 'none' with storage = 'sqlite3'",
        ),
        (('max_bag_size:=1', 'storage:=sqlite3'), 'bag_recorder:max_bag_size: 1; expected 0 with storage'),
        (
            ('max_bag_duration:=-1.0',),
            'bag_recorder:max_bag_duration: -1.0; expected a finite number at least 0 [s]',
        ),
        (('topics:=[heads]',), "bag_recorder:topics: ('heads',); expected a list, each element one of clock, ref"),
        (
            ('topics:=[disturbance]',),
            "bag_recorder:topics: ('disturbance',); expected names of topics of this run: clock, ref",
        ),
    ],
)
def test_what_is_rejected(tmp_path, capsys, arguments, reason):
    words = [word for argument in arguments for word in ('-p', argument)]
    assert simulate(['--ros-args', '-p', 'duration:=0.01', '-p', f'run_dir:={tmp_path / "run"}', *words]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / 'run').exists()


def test_a_run_that_cannot_be_drawn(tmp_path, capsys):
    words = ('-p', 'duration:=0.01', '-p', f'run_dir:={tmp_path / "run"}', '-p', 'topics:=[clock]')
    assert simulate(['--ros-args', *words]) == 0
    assert 'plot  none: its topics were not recorded' in capsys.readouterr().out
    assert report([str(tmp_path / 'run'), '--output', str(tmp_path / 'report')]) == 3
    assert 'nothing to report' in capsys.readouterr().err
