"""How long a run of `simulate` may be, and in what pieces it is run."""

import itertools

import pytest

from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.simulation.run_setup import CHUNK, Simulation

SCALES = ('displacement_scale', 'velocity_scale')
CHANGE = '{:.4f} ldv_sensor noise false'


def simulation(*overrides):
    return Simulation(parse_ros_arguments(['--ros-args', *(word for value in overrides for word in ('-p', value))]))


def test_the_pieces_of_a_run_end_at_its_changes_and_at_its_end():
    changes = f"schedule:=['{CHANGE.format(0.01)}','{CHANGE.format(1e-4 * CHUNK)}']"
    pieces = list(simulation('duration:=1.0', changes).pieces(10_000))
    assert pieces == [(0, 100), (100, CHUNK - 100), (CHUNK, CHUNK), (2 * CHUNK, 10_001 - 2 * CHUNK)]


def test_a_run_of_many_years_begins_at_once():
    run = simulation('duration:=1e9')
    assert list(itertools.islice(run.pieces(run.last_tick), 2)) == [(0, CHUNK), (CHUNK, CHUNK)]


@pytest.mark.parametrize(
    'overrides',
    [
        ('duration:=1e10',),
        ('duration:=0.0', 'controller:=signal_analyzer', 'start_frequency:=0.001', 'settle_cycles:=1e6'),
    ],
)
def test_a_run_that_no_stamp_can_count_is_refused(overrides):
    with pytest.raises(ParameterError, match=r'duration = .* is refused: .*at most 2e\+09'):
        simulation(*overrides)


@pytest.mark.parametrize('scale', SCALES)
@pytest.mark.parametrize('node', ['ldv_sensor', 'adaptive_nn_controller'])
def test_a_scale_is_fixed_during_a_run(node, scale):
    """The controllers have taken it before tick 0."""
    with pytest.raises(ParameterError, match=f'{scale} is read-only'):
        simulation(f"schedule:=['0.01 {node} {scale} 4.0']")
