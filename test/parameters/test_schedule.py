"""The parameter schedule: parsing and checking of entries."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.control.pid import PidParameters
from hdd_servo_ros.parameters import ParameterError, to_mapping
from hdd_servo_ros.parameters.run_parameters import PeerParameters, TimerParameters
from hdd_servo_ros.parameters.schedule import format_entry, parse_schedule, plan, reject_unknown_nodes

T = 1e-4
PID = '/bench1/pid_controller'
KINDS = (PeerParameters, PidParameters)
TEXTS = st.text(st.characters(exclude_categories=('C', 'Z')))
DEFAULTS = {**to_mapping(PeerParameters()), **to_mapping(PidParameters())}


def planned(*entries):
    return plan(parse_schedule(entries, T, 10_000), PID, KINDS, DEFAULTS)


def test_entries_are_read_and_ordered():
    changes = parse_schedule(
        ['0.5 a gain 1', '0.0001 /ns/b model lugre', '1 a list [1.0, 2.5]', '1e-1 a flag true'], T, 10_000
    )
    assert [(change.tick, change.node, change.name, change.value) for change in changes] == [
        (1, '/ns/b', 'model', 'lugre'),
        (1000, 'a', 'flag', True),
        (5000, 'a', 'gain', 1),
        (10_000, 'a', 'list', (1.0, 2.5)),
    ]


@pytest.mark.parametrize('entry', ['', 'then', '0.5', '0.5 a', '0.5 a b', 'soon a b 1', 'nan a b 1', 'inf a b 1'])
def test_what_is_no_entry(entry):
    with pytest.raises(ParameterError, match='TIME NODE PARAMETER VALUE'):
        parse_schedule([entry], T, 10)


@pytest.mark.parametrize('time', ['0.00005', '-0.0001', '1.0001', '0.30000000000000004'])
def test_what_is_no_tick(time):
    with pytest.raises(ParameterError, match=r'k x 0\.0001 s with k from 0 to 10000'):
        parse_schedule([f'{time} a b 1'], T, 10_000)


def test_the_timer_rejects_a_wrong_schedule():
    with pytest.raises(ParameterError, match=r'schedule: .0.5 a.*;'):
        TimerParameters(schedule=('0.5 a',))
    assert TimerParameters(schedule=('0.5 a b 1',)).changes[0].tick == 5000


def test_entries_of_one_tick_are_one_change():
    # A positive derivative bandwidth alone would do; both changes show that the set is checked together.
    (step,) = planned('0.5 pid_controller proportional_gain 1', f'0.5 {PID} integral_gain 2')
    assert step.tick == 5000
    assert step.values == {'integral_gain': 2.0, 'proportional_gain': 1.0}
    assert step.sets[PidParameters] == PidParameters(proportional_gain=1.0, integral_gain=2.0)


def test_then_makes_a_change_of_its_own():
    first, second = planned('0.5 pid_controller proportional_gain 1', 'then 0.5 pid_controller proportional_gain 2')
    assert first.values == {'proportional_gain': 1.0}
    assert second.values == {'proportional_gain': 2.0}


def test_later_changes_keep_earlier_ones():
    _, later = planned('0.1 pid_controller proportional_gain 3', '0.2 pid_controller integral_gain 1')
    assert later.sets[PidParameters].proportional_gain == 3.0


@pytest.mark.parametrize(
    ('entry', 'reason'),
    [
        ('0.5 pid_controller proportional 1', 'no parameter proportional'),
        ('0.5 pid_controller proportional_gain -1', 'at least 0'),
        ('0.5 pid_controller proportional_gain much', 'a finite number'),
        ('0.5 pid_controller peer_timeout 5.0', 'read-only'),
    ],
)
def test_what_a_node_rejects(entry, reason):
    with pytest.raises(ParameterError, match=reason) as caught:
        planned(entry)
    assert entry in str(caught.value)


def test_one_parameter_twice_at_once():
    with pytest.raises(ParameterError, match='twice'):
        planned('0.5 pid_controller proportional_gain 1', '0.5 pid_controller proportional_gain 2')


def test_other_nodes_are_passed_over_and_strangers_rejected():
    assert planned('0.5 vcm_plant gain 1', '0.5 /bench2/pid_controller proportional_gain 1') == ()
    changes = parse_schedule(['0.5 vcm_plant gain 1'], T, 10_000)
    reject_unknown_nodes(changes, ['/vcm_plant'])
    with pytest.raises(ParameterError, match='unknown node; known: /bench1/pid_controller'):
        reject_unknown_nodes(changes, [PID])


@given(
    st.integers(0, 10_000),
    st.one_of(
        st.booleans(),
        st.integers(-(2**53), 2**53),
        st.floats(allow_nan=False, allow_infinity=False),
        TEXTS,
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1).map(tuple),
        st.lists(TEXTS, min_size=1).map(tuple),
    ),
    st.booleans(),
)
def test_a_written_entry_is_read_to_the_bit(tick, value, then):
    entry = format_entry(tick * 100_000, '/node', 'name', value, then=then)
    (change,) = parse_schedule([entry], T, 10_000)
    assert (change.tick, change.node, change.name, change.then) == (tick, '/node', 'name', then)
    assert change.value == value
    assert type(change.value) is type(value)
