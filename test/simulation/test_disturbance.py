"""External disturbance in the loop, its playback from a recorded run, and the comparison of both."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.topics import BASE_ACCELERATION, DISTURBANCE, LoopTopic
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.playback import Playback
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.simulation.packing import Packer
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.simulation.simulate import main

T = 1e-4
TICKS = 300


class Shaker:
    """A force that is another one at every tick."""

    topics: tuple[LoopTopic, ...] = (DISTURBANCE,)

    def rows(self, first_tick, count):
        rows = np.zeros((count, 3))
        rows[:, 0] = 1e-3 * (1 + 37 * np.arange(first_tick, first_tick + count) % 11)
        return (rows,)


class Table(Shaker):
    """The same force on a base whose acceleration is another one at every tick and along every axis."""

    topics = (DISTURBANCE, BASE_ACCELERATION)

    def rows(self, first_tick, count):
        ticks = np.arange(first_tick, first_tick + count)
        return (*super().rows(first_tick, count), ticks[:, None] + np.arange(6.0))


class Knock(Shaker):
    """The same, but for one tick."""

    def rows(self, first_tick, count):
        (rows,) = super().rows(first_tick, count)
        rows[7 - first_tick] = 0.5
        return (rows,)


def record(directory, shaker):
    """Record a run of the default drive with a shaker."""
    simulation = Simulation(parse_ros_arguments(['--ros-args', '-p', 'duration:=0.03']))
    experiment = Experiment(T, disturbance=shaker)
    topics = [*simulation.topics, *((topic, f'/{topic.name}') for topic in shaker.topics)]
    description = simulation.description()
    description['nodes']['/shaker'] = {
        'outputs': [name for _, name in topics[-len(shaker.topics) :]],
        'offers': {},
        'parameters': {},
    }
    recorder = RunRecorder(str(directory), 'mcap', topics, description, separate_process=False)
    names = experiment.controller.estimate_names
    packer = Packer([topic for topic, _ in topics], T, simulation.frame_id, names)
    recorder.write_ticks(TICKS, packer.pack(experiment.run(0, TICKS + 1), {}))
    recorder.finish('finished', '')
    return directory


@pytest.fixture(scope='module')
def shaken(tmp_path_factory):
    return record(tmp_path_factory.mktemp('shaken') / 'run', Shaker())


def simulate(directory, *arguments):
    return main(['--ros-args', '-p', 'duration:=0.03', '-p', f'run_dir:={directory}', '-p', 'plot:=false', *arguments])


@pytest.mark.parametrize('pieces', [(500,), (1, 2, 7, 490)])
def test_a_force_against_u_is_a_smaller_u(pieces):
    """Without friction a force acts as the same voltage less, from the tick after on."""
    sections: dict[str, dict[str, Any]] = {
        'vcm_plant': {'friction.model': 'none'},
        'ldv_sensor': {'noise': False},
        'reference_generator': {'waveform': 'sine', 'amplitude': 1e-3, 'frequency': 200.0},
    }
    run = Experiment(T, 'open_loop', sections, disturbance=Shaker())
    rows = [run.run(sum(pieces[:i]), count) for i, count in enumerate(pieces)]
    position = np.concatenate([part.position for part in rows])
    forces = Shaker().rows(0, 500)[0][:, 0]
    plain = Experiment(T, 'open_loop', sections)
    voltages = plain.run(0, 500).command - forces
    drive = Experiment(T, 'open_loop', sections).plant
    expected = [drive.output()[0]] + [drive.step(k, u)[0] for k, u in enumerate(voltages[:-1].tolist(), start=1)]
    assert np.allclose(position, expected, rtol=1e-9, atol=1e-15)
    assert not np.allclose(position[2:], plain.plant.output()[0])
    assert np.concatenate([part.disturbance.force for part in rows]).tolist() == forces.tolist()


def test_compiled_and_block_by_block_are_the_same_bits():
    compiled = Experiment(T, 'pid', disturbance=Shaker()).run(0, 400)
    python = Experiment(T, Pid(PidParameters(), T), disturbance=Shaker()).run(0, 400)
    for topic in ('reference', 'head', 'ldv', 'control', 'disturbance', 'estimates'):
        assert compiled[topic].tobytes() == python[topic].tobytes(), topic


def test_without_one_there_are_no_rows():
    rows = Experiment(T, 'pid').run(0, 3)
    assert 'disturbance' not in rows
    with pytest.raises(KeyError, match='disturbance'):
        rows.disturbance  # noqa: B018


def test_played_back_it_is_the_same_run(shaken, tmp_path):
    assert simulate(tmp_path / 'again', '-p', f'playback:recorded_run:={shaken}') == 0
    assert first_difference(shaken, tmp_path / 'again') is None
    again = Run.open(tmp_path / 'again')
    assert again.description['nodes']['/playback']['outputs'] == ['/disturbance']
    assert again.disturbance.force.tolist() == Shaker().rows(0, TICKS + 1)[0][:, 0].tolist()
    # And so is one that is made from that one.
    assert simulate(tmp_path / 'third', '-p', f'playback:recorded_run:={tmp_path / "again"}') == 0
    assert first_difference(shaken, tmp_path / 'third') is None


def test_the_acceleration_of_the_base_is_played_back_as_well(tmp_path):
    recorded = record(tmp_path / 'table', Table())
    assert simulate(tmp_path / 'again', '-p', f'playback:recorded_run:={recorded}') == 0
    assert first_difference(recorded, tmp_path / 'again') is None
    again = Run.open(tmp_path / 'again')
    assert again.description['nodes']['/playback']['outputs'] == ['/disturbance', '/base_acceleration']
    assert again.base_acceleration.tolist() == Table().rows(0, TICKS + 1)[1].tolist()
    assert again.base_acceleration.angular_z.tolist() == [tick + 5.0 for tick in range(TICKS + 1)]
    # The head does not depend on it: only the force acts on the head.
    assert simulate(tmp_path / 'force', '-p', f'playback:recorded_run:={record(tmp_path / "shaker", Shaker())}') == 0
    assert Run.open(tmp_path / 'force').head.tobytes() == again.head.tobytes()


def test_missing_and_different_messages_are_found(shaken, tmp_path):
    assert simulate(tmp_path / 'plain') == 0
    assert first_difference(shaken, tmp_path / 'plain') == f'disturbance is missing in {tmp_path / "plain"}'
    assert first_difference(tmp_path / 'plain', shaken) == f'disturbance is missing in {tmp_path / "plain"}'
    other = record(tmp_path / 'other', Knock())
    difference = first_difference(shaken, other)
    assert difference is not None
    assert difference.startswith('disturbance differs first at tick 7: force')


@pytest.mark.parametrize(
    ('recorded', 'arguments', 'reason'),
    [
        ('nowhere', (), "recorded_run: 'nowhere'; expected a recorded run: nowhere is neither"),
        ('plain', (), "recorded_run: 'plain'; expected a run that contains one of /disturbance"),
        ('shaken', ('-p', 'duration:=0.04'), 'a run with ticks 0 to 400, but this run has 0 to 300'),
        ('shaken', ('-p', 'deterministic_timer:sample_time:=5.0e-5'), 'but this run has 0.0001 s'),
    ],
)
def test_a_run_that_cannot_be_played_back(shaken, tmp_path, monkeypatch, capsys, recorded, arguments, reason):
    monkeypatch.chdir(tmp_path)
    if recorded == 'plain':
        assert simulate('plain') == 0
        capsys.readouterr()
    (tmp_path / 'shaken').symlink_to(shaken)
    code = simulate('never', *arguments, '-p', f'playback:recorded_run:={recorded}')
    assert code == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count('\n') == 1
    assert not (tmp_path / 'never').exists()


def test_of_a_playback_all_ticks_are_there(shaken):
    playback = Playback(str(shaken))
    assert playback.topics == (DISTURBANCE,)
    assert playback.rows(DISTURBANCE, 5, 2)[:, 0].tolist() == Shaker().rows(5, 2)[0][:, 0].tolist()
    message = playback.messages(DISTURBANCE, 5, 1)[0].tobytes()
    assert np.frombuffer(message[-24:])[0] == Shaker().rows(5, 1)[0][0, 0]
    with pytest.raises(ParameterError, match='ticks 0 to 301'):
        playback.check(T, TICKS + 1)


@pytest.mark.parametrize('shape', [(9, 3), (10, 1), (10,)])
def test_rows_of_another_shape_are_rejected(shape):
    class Wrong:
        topics: tuple[LoopTopic, ...] = (DISTURBANCE,)

        def rows(self, first_tick, count):
            return (np.zeros(shape),)

    with pytest.raises(
        ValueError, match=r'/disturbance: invalid shape of the rows of ticks 0 to 9: .*; expected \(10, 3\)'
    ):
        Experiment(T, disturbance=Wrong()).run(0, 10)
