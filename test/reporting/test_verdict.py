"""Verdicts on synthetic signals and on simulated runs, and the summary that prints them."""

import dataclasses

import numpy as np
import pytest

from hdd_servo_ros.graph.catalog import NODES as NODES_OF_PACKAGE
from hdd_servo_ros.messages.errors import NotFiniteError
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import transient_of
from hdd_servo_ros.reporting.run_sums import RunSums
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.reporting.verdict import verdict, verdict_of

T = 1e-3
TIME = np.arange(2001) * T
SINE = 2.0 * np.sin(2.0 * np.pi * 5.0 * TIME)
NODES = {'/pid_controller': {'parameters': {'dsp.dac_bits': 0, 'dsp.dac_range': 0.0}}}
DESCRIPTION = {'controller': 'pid', 'frame_id': 'drive', 'sample_time': T, 'status': 'finished', 'nodes': NODES}


def signals(reference, position, command=0.0, wanted=None, estimates=None, units=Units()):  # noqa: B008
    """Return rows of a run from its positions and its command, before saturation ``wanted``."""
    count = len(reference)
    zero = np.zeros(count)
    command = np.broadcast_to(command, count)
    arrays = {
        'reference': np.column_stack((reference, zero, zero)),
        'head': np.column_stack((position, zero, zero)),
        'ldv': np.zeros((count, 3)),
        'control': np.column_stack((command, command if wanted is None else wanted, command)),
        'estimates': np.column_stack([np.arange(count) * T, *(estimates or {}).values()]),
    }
    return SignalRows(0, T, arrays, ('t', *(estimates or {})), units)


def judged(reference, position, **changes):
    rows = signals(reference, position, **{key: changes.pop(key) for key in ('command', 'wanted') if key in changes})
    description = {**DESCRIPTION, **changes}
    sums = RunSums(description, transient_of(rows.duration))
    sums.add(rows)
    return verdict(sums, description.get('reason', ''))


@pytest.mark.parametrize(('share', 'text'), [(0.0, 'tracks'), (0.49, 'tracks'), (0.51, 'does not track')])
def test_the_error_is_compared_with_that_of_a_head_at_rest(share, text):
    found = judged(SINE, (1.0 - share) * SINE)
    assert found.text == text
    assert found.tracks == (text == 'tracks')
    assert ('rms error 720.9 nm' in found.detail) == (text != 'tracks')


def test_an_offset_of_the_reference_is_no_motion():
    """A head that stays at the mean of a small motion far away does not track it."""
    assert judged(50.0 + SINE, np.full(len(SINE), 50.0)).text == 'does not track'
    assert judged(50.0 + SINE, 50.0 + 0.9 * SINE).text == 'tracks'


def test_the_transient_does_not_count():
    position = np.where(TIME < 0.9, 100.0, SINE)
    assert judged(SINE, position).text == 'tracks'


@pytest.mark.parametrize(('end', 'text'), [(0.0, 'does not track'), (2.9, 'tracks'), (21.0, 'diverged')])
def test_a_reference_that_stands_still_is_compared_with_the_way_to_it(end, text):
    reference = np.full(len(TIME), 3.0)
    position = np.where(TIME > 0.01, end, 0.0)
    found = judged(reference, position)
    assert found.text == text
    assert ("distance from the head's first position" in found.detail) == (text == 'does not track')


def test_nothing_to_track_has_no_verdict():
    assert judged(np.zeros(len(TIME)), 0.1 * SINE) is None
    assert judged(SINE, np.zeros(len(TIME)), controller='open_loop') is None


@pytest.mark.parametrize('follows', [True, False])
def test_the_row_of_a_controller_says_whether_it_follows(monkeypatch, follows):
    row = dataclasses.replace(NODES_OF_PACKAGE['pid_controller'], follows_reference=follows)
    monkeypatch.setitem(NODES_OF_PACKAGE, 'pid_controller', row)
    assert (judged(SINE, np.zeros(len(TIME))) is None) == (not follows)
    # A custom controller follows.
    assert judged(SINE, np.zeros(len(TIME)), controller='my_package.laws:Mine') is not None


@pytest.mark.parametrize(
    ('position', 'reason', 'detail'),
    [
        (10.0 * SINE, '', "more than 3 times the reference's span of 4000 nm"),
        (np.where(TIME < 1.5, SINE, np.nan), '', 'the error is not finite'),
        (np.where(TIME < 1.5, SINE, 1e200), '', 'the error is not finite'),
        (SINE, str(NotFiniteError('/control', 7, (np.nan, 0.0, 0.0), 'pid')), '/control: not finite at tick 7'),
    ],
)
def test_diverged(position, reason, detail):
    found = judged(SINE, position, reason=reason)
    assert found.text == 'diverged'
    assert found.in_table == '! diverged'
    assert detail in found.detail


def test_another_reason_is_no_divergence():
    assert judged(SINE, SINE, reason='mine: ValueError: a gain is not finite').text == 'tracks'


@pytest.mark.parametrize(('clipped', 'text'), [(0.4, 'tracks'), (0.6, 'saturated 60 %')])
@pytest.mark.parametrize('controller', ['pid', 'open_loop'])
def test_saturation_counts_after_the_transient(clipped, text, controller):
    late = TIME >= 1.0 - 1e-9
    wanted = np.where((TIME < 1.0 - 1e-9) | (np.cumsum(late) <= clipped * late.sum()), 1.5, 0.1)
    found = judged(SINE, SINE, command=np.minimum(wanted, 1.0), wanted=wanted, controller=controller)
    if controller == 'open_loop' and text == 'tracks':
        assert found is None
    else:
        assert found.text == text
        assert found.detail == ('control' if 'saturated' in text else '')


def test_pieces_make_the_same_summary_as_the_whole():
    rng = np.random.default_rng(3)
    gain = np.where(TIME < 0.3, 1.0, 2.0)
    wanted = 1.2 * rng.normal(size=len(TIME))
    whole = signals(
        SINE,
        SINE + 0.1 * rng.normal(size=len(TIME)),
        command=np.clip(wanted, -1.0, 1.0),
        wanted=wanted,
        estimates={'gain': gain, 'fixed': np.ones(len(TIME))},
    )
    sums = RunSums(DESCRIPTION, transient_of(whole.duration))
    # As `simulate` does: one memory for all pieces.
    memory = {
        name: np.empty((100, whole[name].shape[1])) for name in ('reference', 'head', 'ldv', 'control', 'estimates')
    }
    for start in range(0, len(TIME), 100):
        count = min(100, len(TIME) - start)
        for name, rows in memory.items():
            rows[:count] = whole[name][start : start + count]
        sums.add(SignalRows(start, T, {name: rows[:count] for name, rows in memory.items()}, whole.estimate_names))
    text = summary(whole, DESCRIPTION)
    assert summary(sums, DESCRIPTION) == text
    first = int(np.flatnonzero(np.abs(wanted) > 1.0)[0])
    clipped = int((np.abs(wanted) > 1.0).sum())
    error = 1e3 * (whole.position - whole.desired_position)[1000:]
    assert text.splitlines() == [
        '           run  finished, tracks',
        '    controller  pid, drive drive',
        f'tracking error  {np.sqrt(np.mean(error**2)):.4g} nm rms, {np.abs(error).max():.4g} nm max (after 1 s)',
        '  peak control  1 V (whole run)',
        '     estimates  gain 2 (at the end)',
        '         ticks  2001 of 0.001 s, 0 to 2000',
        f'    saturation  control {clipped} of 2001 samples, first at tick {first}',
    ]


def test_what_is_known_of_a_recorded_run_is_printed(tmp_path):
    known = {**DESCRIPTION, 'topics': dict.fromkeys('abcdef'), 'real_time_factor': 2.5, 'reason': 'a reason'}
    lines = summary(signals(SINE, 0.0 * SINE), known, tmp_path).splitlines()
    assert lines[0].startswith('             run  finished: a reason, but does not track (rms error 1414 nm, not below')
    assert '        messages  12006 on 6 topics, 2001 each' in lines
    assert lines[-2:] == ['real-time factor  2.5', f'      run folder  {tmp_path}']


def test_a_summary_in_other_units():
    text = summary(signals(SINE, 0.99 * SINE, units=Units('m', 'N')), DESCRIPTION)
    assert 'm rms' in text
    assert 'peak control  0 N (whole run)' in text
    assert 'nm' not in text


def test_no_sample_no_summary():
    with pytest.raises(ValueError, match='a run without samples'):
        summary(RunSums(DESCRIPTION, 0.0), DESCRIPTION)


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ((), 'tracks'),
        # An unstable PID.
        (('pid_controller:proportional_gain:=20.0', 'pid_controller:derivative_gain:=1.0e-3'), 'diverged'),
        (('pid_controller:control_limit:=0.004',), 'saturated 100 %'),
        (('proportional_gain:=0.0', 'integral_gain:=0.0', 'derivative_gain:=0.0'), 'does not track'),
        (('controller:=open_loop', 'reference_generator:amplitude:=0.05'), None),
    ],
)
def test_simulated_runs(simulated, tmp_path, arguments, text):
    given = ('controller:=pid', 'duration:=0.2', *arguments)
    run = RecordedRun.open(simulated(tmp_path / 'run', *(word for each in given for word in ('-p', each))))
    found = verdict_of(run)
    assert (None if found is None else found.text) == text
    # In memory, without the folder, the same.
    rows = SignalRows(0, run.sample_time, {name: run[name] for name in ('reference', 'head', 'ldv', 'control')}, ())
    sums = RunSums(run.description, transient_of(rows.duration))
    sums.add(rows)
    in_memory = verdict(sums)
    if in_memory != found:
        assert in_memory is not None
        assert found is not None
        assert dataclasses.asdict(in_memory) == pytest.approx(dataclasses.asdict(found))
