"""No check passes where a signal that it judges is not a number: comparisons with nan are false."""

import inspect
import math
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.testing.checks import Checks

ROWS = 1001
STEP = 300
"""Row of the edge of the reference."""

ON_ERROR: dict[str, dict[str, Any]] = {
    'rms_error': {'at_most': 1e9},
    'max_error': {'at_most': 1e9},
    'mean_error': {'at_most': 1e9},
    'overshoot': {'at_most': 1e9},
    'settling_time': {'at_most': 1e9},
    'steady_error': {'at_most': 1e9},
    'track_error': {'at_most': 1e9},
    'peak_track_error': {'at_most': 1e9},
    'rpe': {'at_most': 1e9, 'sectors': 100},
    'nrpe': {'at_most': 1e9, 'sectors': 100},
    'time_off_track': {'at_most': 1.0},
    'longest_off_track': {'at_most': 1e9},
    'shock_peak': {'at_most': 1e9, 'shocks': [0.02]},
    'shock_outside': {'at_most': 1e9, 'shocks': [0.02], 'band': 1e9},
    'shock_recovery': {'at_most': 1e9, 'shocks': [0.02], 'band': 1e9},
    'bounded': {'signal': 'error', 'at_most': 1e9},
    'finished': {},
}
"""The checks that a head position decides, with arguments that any finite signal meets."""
ON_CONTROL: dict[str, dict[str, Any]] = {'peak_control': {'at_most': 1e9}, 'unsaturated': {}, 'finished': {}}
"""The same for the command."""
OTHERS = {
    'samples': 'counts messages',
    'parameter': 'compares a parameter, which is always finite',
    'error_over_least': 'compares by the same function as the others',
    **dict.fromkeys(
        ('seek_time', 'seek_overshoot', 'residual_vibration', 'seek_time_over_optimal'),
        'takes what is not a number for infinite, see test_seek_checks.py',
    ),
    'no_return_to_an_earlier_mode': 'compares modes',
}


@pytest.fixture(scope='module')
def stepped(simulated, tmp_path_factory):
    arguments = ('duration:=0.1', 'controller:=pid')
    words = [word for argument in arguments for word in ('-p', argument)]
    return simulated(tmp_path_factory.mktemp('runs') / 'run', *words)


def opened(source, topic=None, column=0, value=math.nan, rows=slice(STEP + 50, STEP + 150)):
    """Open the run, with some values of a topic replaced."""
    run = Run.open(source)
    run._arrays['reference'] = np.zeros((ROWS, 3))
    run._arrays['reference'][STEP:, 0] = 1.0
    run._arrays['head'] = 0.99 * run._arrays['reference']
    if topic is not None:
        changed = np.array(run[topic])
        changed[rows, column] = value
        run._arrays[topic] = changed
    return run


def test_every_check_is_in_the_tables():
    public = {name for name, _ in inspect.getmembers(Checks, inspect.isfunction) if not name.startswith('_')}
    assert public == {*ON_ERROR, *ON_CONTROL, *OTHERS}


@pytest.mark.parametrize(('name', 'given'), [*ON_ERROR.items(), *ON_CONTROL.items()])
def test_finite_signals_pass(stepped, name, given):
    getattr(opened(stepped).check, name)(**given)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('where', [slice(STEP + 50, STEP + 150), slice(500, 501)])
@pytest.mark.parametrize('name', ON_ERROR)
def test_a_position_that_is_not_finite_fails(stepped, name, where, value):
    with pytest.raises(AssertionError, match=r'nan|inf'):
        getattr(opened(stepped, 'head', 0, value, where).check, name)(**ON_ERROR[name])


@pytest.mark.parametrize('value', [math.nan, math.inf])
@pytest.mark.parametrize('name', ON_CONTROL)
def test_a_command_that_is_not_finite_fails(stepped, name, value):
    with pytest.raises(AssertionError, match=r'nan|inf'):
        getattr(opened(stepped, 'control', 0, value).check, name)(**ON_CONTROL[name])


@pytest.mark.parametrize('topic', ['ldv', 'control', 'estimates', 'reference'])
def test_a_finished_run_holds_no_such_number(stepped, topic):
    with pytest.raises(AssertionError, match=f'a number of {topic} is nan at tick 350'):
        opened(stepped, topic, 1).check.finished()


def test_a_shock_that_is_not_a_number_is_not_overlooked(stepped):
    run = opened(stepped)
    base = np.zeros((ROWS, len(BASE_ACCELERATION.fields)))
    base[100:150, 1] = 1000.0
    base[400, 1] = math.nan
    run._arrays[BASE_ACCELERATION.name] = base
    run._topics[BASE_ACCELERATION.name] = '/head'
    with pytest.raises(AssertionError, match=r'base_acceleration\.linear_y is nan at tick 400'):
        run.check.shock_peak(at_most=1e9)
