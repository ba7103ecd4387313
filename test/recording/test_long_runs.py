"""Runs that are read in pieces: the same answers as from whole arrays."""

import contextlib
import sqlite3

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.bag_columns import Bag, BagError
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import read_run_yaml, rewrite_run_yaml
from hdd_servo_ros.recording.run_stretch import RunStretch
from hdd_servo_ros.reporting import show
from hdd_servo_ros.reporting.run_sensitivity import run_sensitivity
from hdd_servo_ros.reporting.run_sums import sums_of
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.simulation.simulate import simulate

TICKS = 6000


@pytest.fixture(scope='module', params=['none', 'zstd', 'split', 'sqlite3'])
def run(tmp_path_factory, request):
    directory = tmp_path_factory.mktemp('long') / 'run'
    more = {
        'none': [],
        'zstd': ['-p', 'compression:=zstd'],
        'split': ['-p', 'max_bag_duration:=0.1'],
        'sqlite3': ['-p', 'storage:=sqlite3'],
    }[request.param]
    return simulated(directory, *more)


def simulated(directory, *more):
    given = ['-p', f'run_dir:={directory}', '-p', f'duration:={TICKS * 1e-4}', *more]
    parsed = parse_ros_arguments(['--ros-args', '--params-file', 'params/seagate_7200_10.yaml', *given])
    assert simulate(Simulation(parsed), progress=False)[0] == 0
    return directory


@pytest.fixture
def long(monkeypatch):
    """Let every run be a long one."""
    monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)


def test_pieces_are_the_rows_of_the_run(run, monkeypatch):
    whole = Run.open(run)
    assert list(whole.pieces()) == [whole]
    monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)
    pieces = list(Run.open(run).pieces())
    tick = 0
    for piece in pieces:
        rows = slice(tick, tick + len(piece.ticks))
        assert piece.ticks.tolist() == whole.ticks[rows].tolist()
        assert piece.estimate_names == whole.estimate_names
        for name in ('reference', 'head', 'ldv', 'control', 'estimates'):
            assert piece[name].tobytes() == whole[name][rows].tobytes()
        tick = rows.stop
    assert tick == TICKS + 1
    assert len(pieces) >= 2


@pytest.mark.parametrize('first', [0, 1, 1234, 5999, TICKS])
def test_pieces_from_a_tick_on(run, long, first):
    opened = Run.open(run)
    pieces = list(opened.pieces(first_tick=first))
    assert np.concatenate([piece.ticks for piece in pieces]).tolist() == list(range(first, TICKS + 1))
    stretch = RunStretch(opened, first)
    for name in ('head', 'estimates'):
        assert stretch[name].tobytes() == Run.open(run)[name][first:].tobytes()
    assert stretch.time.tolist() == Run.open(run).time[first:].tolist()


@pytest.mark.parametrize('time', [0.0, 1e-4, 0.3, 0.30005, 0.6, 7.0])
def test_rows_from_a_time_on_are_known_without_an_array_of_times(run, monkeypatch, time):
    expected, at = Run.open(run).since(time), float(Run.open(run).time[4321])
    monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)
    opened = Run.open(run)
    assert opened.since(time) == expected
    assert opened.time_at(4321) == at
    assert 'time' not in vars(opened)


def test_a_long_run_gives_the_same_summary(run, monkeypatch):
    whole = Run.open(run)
    expected = summary(sums_of(whole), whole.description), run_sensitivity(whole), verdict_of(whole)
    monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)
    opened = Run.open(run)
    found = summary(sums_of(opened), opened.description), run_sensitivity(opened), verdict_of(opened)
    assert found == expected
    assert opened.duration == whole.duration
    assert opened.last_tick == whole.last_tick
    # None of it has made an array of the whole run.
    assert not opened._arrays
    assert 'ticks' not in vars(opened)


def test_the_sensitivity_of_a_long_run_with_estimates_in_the_loop(tmp_path, monkeypatch):
    run = simulated(tmp_path / 'run', '--params-file', 'params/thesis_law.yaml')
    expected = run_sensitivity(Run.open(run))
    monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)
    assert expected is not None
    assert run_sensitivity(Run.open(run)) == expected


def test_the_whole_of_a_long_run_is_checked(run, long):
    Run.open(run).verify()


def test_checking_a_long_run_reads_no_topic_of_the_loop_as_a_whole(run, long, monkeypatch):
    """As `recover` checks it: the bag alone, whose time of tick 0 is not known from run.yaml."""
    read = []
    column = Bag.column

    def noted(self, topic):
        read.append(topic)
        return column(self, topic)

    monkeypatch.setattr(Bag, 'column', noted)
    RecordedRun.open_bag(run / 'bag').verify()
    assert read == ['/parameter_events']


def test_a_long_run_is_drawn_without_arrays_of_the_whole(run, long, tmp_path):
    opened = RecordedRun.open(run)
    assert show.draw_run(opened, tmp_path / 'run.png')
    assert (tmp_path / 'run.png').stat().st_size > 10_000
    assert not opened._arrays
    assert 'ticks' not in vars(opened)


def test_a_changed_value_is_found_as_a_long_sqlite3_bag_is_read(tmp_path, long):
    run = simulated(tmp_path / 'run', '-p', 'storage:=sqlite3')
    with contextlib.closing(sqlite3.connect(next((run / 'bag').glob('*.db3')))) as connection:
        (number, data), *_ = connection.execute('SELECT id, data FROM messages ORDER BY id DESC LIMIT 1')
        connection.execute('UPDATE messages SET data = ? WHERE id = ?', (data[:-1] + bytes([data[-1] ^ 1]), number))
        connection.commit()
    with pytest.raises(BagError, match='do not match their checksum'):
        RecordedRun.open(run).verify()


def test_long_runs_are_compared(run, long, tmp_path):
    other = simulated(tmp_path / 'other')
    assert first_difference(run, other) is None
    assert first_difference(run, other, 4000) is None
    shorter = simulated(tmp_path / 'shorter', '-p', 'duration:=0.5')
    assert 'messages' in str(first_difference(run, shorter))
    assert first_difference(run, shorter, 5000) is None
    changed = simulated(tmp_path / 'changed', '-p', 'schedule:=[0.45 reference_generator amplitude 1.5]')
    assert 'at tick 4500' in str(first_difference(run, changed))
    assert first_difference(run, changed, 4499) is None


def test_a_long_run_whose_ticks_are_not_those_of_its_period_is_rejected(run, long):
    said = read_run_yaml(run)
    try:
        rewrite_run_yaml(run, {**said, 'sample_time': 2e-4})
        with pytest.raises(BagError, match='do not match the ticks of the clock'):
            sums_of(Run.open(run))
    finally:
        rewrite_run_yaml(run, said)
