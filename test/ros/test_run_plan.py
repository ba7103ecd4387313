"""The run plan that the process of the timer makes when all processes are ready."""

import pytest

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.run_parameters import TimerParameters
from hdd_servo_ros.ros.run_plan import make_run_plan

TIMER = '/deterministic_timer'


def nodes(**of_plant):
    return {
        TIMER: {'inputs': ['/control'], 'outputs': ['/clock'], 'offers': {}, 'parameters': {}},
        '/vcm_plant': {
            'inputs': ['/clock', '/control'],
            'outputs': ['/head'],
            'offers': {'frame_id': 'drive'},
            'parameters': {},
            **of_plant,
        },
    }


def test_plan():
    timer = TimerParameters(duration=0.01, rate=0.5, schedule=('0.005 vcm_plant gain 2.0',))
    run = make_run_plan(TIMER, timer, nodes(), ['a', 'b'])
    assert (run.sample_time, run.last_tick, run.rate, run.frame_id, run.timer) == (1e-4, 100, 0.5, 'drive', TIMER)
    assert run.processes == ['a', 'b']
    assert [change.tick for change in run.changes] == [50]
    assert run.publisher_of('/head') == '/vcm_plant'
    assert run.publisher_of('/ldv') is None


def test_a_node_with_a_plan_sets_the_duration_of_the_run():
    assert make_run_plan(TIMER, TimerParameters(duration=0.0), nodes(last_tick_needed=77), ['a']).last_tick == 77
    with pytest.raises(ParameterError, match='duration'):
        make_run_plan(TIMER, TimerParameters(duration=0.001), nodes(last_tick_needed=77), ['a'])


def test_a_node_that_rejects_the_schedule_ends_the_run_with_its_reason():
    with pytest.raises(RunError, match='gain is read-only'):
        make_run_plan(TIMER, TimerParameters(), nodes(rejects='gain is read-only'), ['a'])


def test_a_schedule_for_a_node_that_does_not_participate_is_rejected():
    timer = TimerParameters(schedule=('0.005 pid_controller k_p 2.0',))
    with pytest.raises(ParameterError, match='unknown node'):
        make_run_plan(TIMER, timer, nodes(), ['a'])
