"""A check passes at its limit, fails below it, and then tells value, limit and tick, and leaves a picture."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.testing import checks

T = 1e-4
TICKS = Ticks(T)
COUNT = 1001


def record(
    path,
    position,
    reference=None,
    *,
    planned=COUNT - 1,
    ended=('finished', ''),
    estimate=0.0,
    without=None,
    stamped=None,
    units=None,
):
    """
    Record a run with a given head position [um]; the command is a tenth of it [V].

    The message of topic and tick ``without`` is left out; ``stamped`` gives the estimates of a tick another's time.
    """
    nodes = {'/pid_controller': {'outputs': ['/control'], 'parameters': {'kp': 1.5, 'weights': [1.0, 2.0]}}}
    description = {'sample_time': T, 'last_tick_planned': planned, 'frame_id': 'drive', 'nodes': nodes}
    description.update(units or {})
    topics = [(topic, f'/{topic.name}') for topic in LOOP_TOPICS]
    recorder = RunRecorder(str(path), 'mcap', topics, description, separate_process=False)
    vector, array = VectorCodec('drive'), ArrayCodec(['t', 'm_hat'])
    for tick, x in enumerate(position):
        stamp = TICKS.stamp(tick)
        x_d = 0.0 if reference is None else reference[tick]
        messages = [
            ClockCodec.pack(stamp),
            vector.pack(stamp, x_d, 0.0, 0.0),
            vector.pack(stamp, x, 2.0 * x, 0.0),
            vector.pack(stamp, 0.0, 0.0, 0.0),
            vector.pack(stamp, 0.1 * x, 0.1 * x, 0.05 * x),
            array.pack([(stamped or {}).get(tick, tick) * T, estimate]),
        ]
        kept = [index for index, topic in enumerate(LOOP_TOPICS) if (topic.name, tick) != without]
        if len(kept) == len(messages):
            recorder.write_tick(tick, TICKS.nanoseconds(tick), messages)
        else:
            assert recorder._writer is not None
            stamps = [TICKS.nanoseconds(tick)] * len(kept)
            recorder._writer.write(kept, stamps, [messages[index] for index in kept])
    recorder.finish(*ended)
    return Run.open(path)


@pytest.fixture
def run(tmp_path):
    """An error of 3 nm, but for -50 nm at tick 100 and 8 nm at tick 700."""
    position = np.full(COUNT, 0.003)
    position[100], position[700] = -0.050, 0.008
    return record(tmp_path / 'run', position)


def failure(check, *arguments, **options):
    """Return the message of a check that fails, and the picture that it leaves."""
    with pytest.raises(AssertionError) as caught:
        check(*arguments, **options)
    text = str(caught.value)
    plot = re.search(r'^plot: (.+)$', text, re.MULTILINE)
    return text, None if plot is None else Path(plot.group(1))


def test_checks_that_hold_can_be_chained(run):
    rms_after = np.sqrt((500 * 9.0 + 64.0) / 501)
    checked = (
        run.check.finished()
        .samples(COUNT)
        .rms_error(at_most=rms_after * (1 + 1e-12), after=0.05)
        .max_error(at_most=8.0 + 1e-9, after=0.0101)
        .max_error(at_most=3.0 + 1e-9, before=0.01)
        .mean_error(at_most=3.1)
        .peak_control(at_most=0.005 + 1e-12)
        .bounded('head.y', at_most=0.1)
        .bounded('head.velocity', at_most=0.1)
        .bounded('control.before_saturation', at_most=0.005 + 1e-12)
        .bounded('ldv.z', at_most=0.0)
        .bounded('m_hat', at_most=0.0)
        .bounded('feedback', at_most=0.0025 + 1e-12)
        .parameter('pid_controller', 'kp', 1.5)
        .parameter('/pid_controller', 'weights', (1.0, 2.0), tick=0)
    )
    assert isinstance(checked, checks.Checks)
    assert list(run.path.glob('*.png')) == []


def test_a_failed_check_tells_value_limit_and_tick_and_leaves_a_picture(run):
    text, plot = failure(run.check.max_error, at_most=7.0, after=0.05)
    assert 'max error is 8 nm, above 7 nm, from 0.05 to 0.1 s; error is largest at tick 700 (0.07 s): 8 nm' in text
    assert f'run: {run.path} (pid on drive, finished)' in text
    assert plot.parent == run.path
    assert plot.read_bytes().startswith(b'\x89PNG')
    again = failure(run.check.max_error, at_most=7.0, after=0.05)[1]
    assert again != plot


@pytest.mark.parametrize(
    ('name', 'options', 'words'),
    [
        ('rms_error', {'at_most': 2.9}, ['rms error is 3.', 'above 2.9 nm', 'tick 100 (0.01 s): -50 nm']),
        ('mean_error', {'at_most': 2.9}, ['magnitude of the mean error is 2.952 nm, above 2.9 nm']),
        ('peak_control', {'at_most': 0.004}, ['largest |command| is 0.005 V, above 0.004 V', 'tick 100', '-0.005 V']),
    ],
)
def test_what_other_checks_say(run, name, options, words):
    text, plot = failure(getattr(run.check, name), **options)
    for word in words:
        assert word in text
    assert plot.is_file()


@pytest.mark.parametrize(
    ('units', 'signal', 'unit'),
    [
        (None, 'control.before_saturation', 'V'),
        (None, 'control.y', 'V'),
        (None, 'head.velocity', 'um/s'),
        ({'length_unit': 'm', 'control_unit': 'N'}, 'head.velocity', 'm/s'),
        ({'length_unit': 'm', 'control_unit': 'N'}, 'control.before_saturation', 'N'),
        ({'length_unit': 'm', 'control_unit': 'N'}, 'command', 'N'),
    ],
)
def test_a_field_has_its_declared_unit_in_those_of_the_drive(tmp_path, units, signal, unit):
    run = record(tmp_path / 'run', np.full(10, 0.5), units=units)
    text, _ = failure(run.check.bounded, signal, at_most=0.001)
    assert f'above 0.001 {unit}, from ' in text


def test_what_is_not_finite_is_not_bounded(tmp_path):
    run = record(tmp_path / 'run', np.zeros(10), estimate=np.nan)
    text, _ = failure(run.check.bounded, 'm_hat', at_most=1.0)
    assert 'largest |m_hat| is inf, above 1, ' in text
    assert 'at tick 0 (0 s): nan' in text


def test_a_run_that_did_not_finish(tmp_path):
    run = record(tmp_path / 'a', np.zeros(11), planned=20, ended=('failed', 'ldv: expected tick 11'))
    text, plot = failure(run.check.finished)
    assert text.startswith('run failed: ldv: expected tick 11; the bag ends at tick 10, tick 20 was planned\n')
    assert plot.is_file()
    empty = record(tmp_path / 'empty', [], ended=('failed', 'a peer is gone'))
    text, plot = failure(empty.check.finished)
    assert 'run failed: a peer is gone; the bag holds no complete tick' in text
    assert plot is None
    bag = Run.open(run.path / 'bag')
    (run.path / 'run.yaml').unlink()
    text, _ = failure(Run.open(bag.path).check.finished)
    bag.check.samples(11)
    assert text.startswith('run.yaml is missing, which records how a run ended: finished() needs the directory')


def test_the_first_tick_whose_samples_are_wrong(tmp_path):
    short = record(tmp_path / 'short', np.zeros(10), planned=10)
    text, plot = failure(short.check.finished)
    assert 'clock has 10 messages, expected 11: tick 10 has 0 (0.001 s)' in text
    assert plot.is_file()
    short.check.samples()
    text, plot = failure(short.check.samples, 9)
    assert 'clock has 10 messages, expected 9: tick 9 is beyond the last (0.0009 s)' in text
    assert plot.is_file()
    said = yaml.safe_load((short.path / 'run.yaml').read_text())
    said['topics']['disturbance'] = '/disturbance'
    (short.path / 'run.yaml').write_text(yaml.safe_dump(said))
    with pytest.raises(BagError, match=r'run\.yaml lists /disturbance, but metadata\.yaml of the bag does not'):
        Run.open(short.path)
    run = record(tmp_path / 'gap', np.zeros(COUNT), without=('control', 500))
    text, plot = failure(run.check.finished)
    assert 'control has 1000 messages, expected 1001: tick 500 has 0 (0.05 s)' in text
    assert plot.name == 'gap-samples_of_control.png'
    twice = record(tmp_path / 'twice', np.zeros(20), stamped={7: 6})
    text, _ = failure(twice.check.samples, 20)
    assert 'estimates has 20 messages, expected 20: tick 6 has 2 (0.0006 s)' in text


def test_a_parameter_that_is_another(run):
    text, plot = failure(run.check.parameter, 'pid_controller', 'kp', 2.0)
    assert 'pid_controller kp is 1.5 at tick 1000 (from the start), not 2.0' in text
    assert plot.name == 'run-pid_controller_kp.png'
    text, plot = failure(run.check.parameter, 'pid_controller', 'weights', (1.0, 3.0), tick=3)
    assert 'pid_controller weights is [1.0, 2.0] at tick 3' in text
    assert plot is None


@pytest.mark.parametrize('limit', [np.nan, np.inf, -1.0])
def test_what_is_no_limit_is_rejected(run, limit):
    for check in (run.check.rms_error, run.check.peak_control, run.check.steady_error):
        with pytest.raises(ValueError, match=r'invalid limit: at_most = .*; expected a finite number at least 0'):
            check(at_most=limit)


def test_steps(tmp_path):
    reference = np.where(np.arange(COUNT) // 250 % 2 == 0, 1.0, -1.0)
    position = reference.copy()
    position[0] = 0.0
    position[250:290] = 0.0  # 4 ms late
    position[500] = 1.2  # 10 % of the height beyond
    position[900:1000] = -0.99  # 10 nm beside
    run = record(tmp_path / 'run', position, reference)
    run.check.overshoot(at_most=10.1).settling_time(at_most=0.0041).steady_error(at_most=8.1)
    text, plot = failure(run.check.settling_time, at_most=0.003)
    assert 'settling time is 0.004 s, above 0.003 s, after the edge of -2 um at tick 250 (0.025 s), 2 of 4' in text
    assert 'the median of all is' in text
    assert plot.is_file()
    assert 'overshoot is 10 %, above 5 %, after the edge of 2 um at tick 500' in failure(run.check.overshoot, 5.0)[0]
    assert 'steady error is 8 nm, above 7 nm' in failure(run.check.steady_error, 7.0)[0]


def test_pictures_go_where_they_are_wanted(run, tmp_path, monkeypatch):
    monkeypatch.setattr(checks, 'plot_directory', tmp_path / 'plots' / 'new')
    plot = failure(run.check.rms_error, at_most=1.0)[1]
    assert plot == tmp_path / 'plots' / 'new' / 'run-rms_error.png'
    (tmp_path / 'a file').write_text('')
    monkeypatch.setattr(checks, 'plot_directory', tmp_path / 'a file')
    assert failure(run.check.rms_error, at_most=1.0)[1].is_file()


def test_questions_that_make_no_sense(run):
    with pytest.raises(LookupError, match=r"unknown signal 'm_cap'; known signals include error, .*m_hat"):
        run.check.bounded('m_cap', at_most=1.0)
    with pytest.raises(ValueError, match='no tick between 1 s and '):
        run.check.rms_error(at_most=1.0, after=1.0)
    with pytest.raises(ValueError, match='has no edge'):
        record(run.path.parent / 'still', np.zeros(10)).check.overshoot(at_most=1.0)


def test_an_instrument_gives_volts_whatever_the_drive_is_in(simulated, tmp_path, monkeypatch):
    units = ('-p', 'vcm_plant:length_unit:=m', '-p', 'vcm_plant:control_unit:=kN')
    run = Run.open(simulated(tmp_path / 'run', '-p', 'duration:=0.05', '-p', 'adc_range:=0.125', *units))
    drawn = []
    monkeypatch.setattr(checks.Checks, '_plot', lambda self, what, name, unit, *rest: drawn.append((name, unit)))
    failure(run.check.unsaturated)
    assert drawn == [('displacement output', 'V')]
    failure(run.check.bounded, 'ldv.displacement', at_most=0.001)
    assert drawn[1] == ('ldv.displacement', 'V')


def test_what_is_clipped(simulated, tmp_path):
    """A vibrometer of 1 um range sees a sine of 2 um for a third of its time; 16 um are enough."""
    wide = Run.open(simulated(tmp_path / 'wide', '-p', 'duration:=0.05'))
    wide.check.unsaturated()
    narrow = Run.open(simulated(tmp_path / 'narrow', '-p', 'duration:=0.05', '-p', 'adc_range:=0.125'))
    clipped = np.flatnonzero(np.abs(narrow.ldv[:, 0]) >= 0.125 * (1 - 2.0**-14))
    text, plot = failure(narrow.check.unsaturated)
    assert plot.is_file()
    assert f'displacement output is clipped at {len(clipped)} of 501 samples after 0 s' in text
    assert f'first at tick {clipped[0]} ' in text
