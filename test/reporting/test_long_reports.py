"""Reports of long runs: read in pieces, they say what they say of the same run read into arrays."""

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.comparison_panels import comparison_panels
from hdd_servo_ros.reporting.long_runs import blocks, stretch_of
from hdd_servo_ros.reporting.report import comparison_table, report_run
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks, responses_of, seeks_of, tolerance_of
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.tools.error_by_source import error_by_source_of_run

from .seeker import seeking_run
from .shaken import SECTORS, shaken_run

PARAMS = Path(__file__).parents[2] / 'params'
RUNS = ('sine', 'square', 'still', 'sweep', 'open loop', 'servo', 'shaken', 'seeking')
SWEEP = ('controller:=signal_analyzer', 'duration:=0.0', 'start_frequency:=2000.0', 'stop_frequency:=3000.0')


@pytest.fixture(scope='module')
def runs(simulated, tmp_path_factory):
    base = tmp_path_factory.mktemp('runs')

    def recorded(name, *arguments, files=()):
        given = (part for file in files for part in ('--params-file', str(PARAMS / file)))
        return simulated(base / name, *given, *(part for text in arguments for part in ('-p', text)))

    shaken_run(base / 'shaken', SECTORS * 120 + 7)
    seeking_run(simulated, base / 'seeking', 'seek.repeat:=true', 'duration:=0.8')
    return {
        'sine': recorded('sine', 'duration:=0.8'),
        'square': recorded('square', 'duration:=0.6', 'waveform:=square', 'frequency:=20.0'),
        'still': recorded('still', 'duration:=0.6', 'waveform:=constant', 'storage:=sqlite3'),
        'sweep': recorded('sweep', *SWEEP),
        'open loop': recorded('open', 'duration:=0.6', 'controller:=open_loop', 'reference_generator:amplitude:=0.05'),
        'servo': recorded(
            'servo', f'duration:={9000 * 9.9206e-5!r}', files=('nss_100ktpi.yaml', 'nss_100ktpi_10_khz.yaml')
        ),
        'shaken': base / 'shaken',
        'seeking': base / 'seeking',
    }


@pytest.fixture
def long(monkeypatch):
    """Let every run that is opened be a long one, and its last stretch all of it."""

    def set_long(stretch=sys.maxsize):
        monkeypatch.setattr('hdd_servo_ros.recording.recorded_run.LONG_RUN', 1)
        monkeypatch.setattr('hdd_servo_ros.reporting.long_runs.STRETCH', stretch)

    return set_long


@pytest.mark.parametrize('name', RUNS)
def test_the_figures_are_those_of_whole_arrays(runs, long, name):
    whole = RecordedRun.open(runs[name])
    expected, missing, judged = run_metrics(whole), left_out(whole), verdict_of(whole)
    long()
    opened = RecordedRun.open(runs[name])
    assert opened.is_long
    found = run_metrics(opened)
    assert [metric.name for metric in found] == [metric.name for metric in expected]
    for metric, other in zip(found, expected, strict=True):
        assert metric.value == pytest.approx(other.value, rel=1e-9, abs=1e-9 * abs(expected[0].value)), metric.name
    assert left_out(opened) == missing
    assert verdict_of(opened) == judged
    # None of it has made an array of the whole run.
    assert not opened._arrays
    assert not {'ticks', 'time'} & vars(opened).keys()


@pytest.mark.parametrize('name', RUNS)
def test_the_lines_are_those_of_whole_arrays(runs, long, name):
    whole = run_panels(RecordedRun.open(runs[name]))
    long()
    opened = RecordedRun.open(runs[name])
    found = run_panels(opened)
    assert not opened._arrays
    if name == 'seeking':
        # Over its time a long run with seeks is drawn as one with any other reference.
        whole, found = ([panel for panel in panels if not panel.over_time] for panels in (whole, found))
    assert [panel.name for panel in found] == [panel.name for panel in whole]
    for panel, other in zip(found, whole, strict=True):
        assert (panel.title, panel.close_up) == (other.title, other.close_up)
        for line, expected in zip(panel.traces, other.traces, strict=True):
            assert line.name == expected.name
            if panel.over_time:
                np.testing.assert_array_equal(line.x, expected.x)
                np.testing.assert_array_equal(line.y, expected.y)
            else:
                np.testing.assert_allclose(line.x, expected.x, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(line.y, expected.y, rtol=1e-7, atol=1e-12)


def test_a_comparison_of_long_runs_is_that_of_whole_arrays(runs, long):
    def compared():
        opened = [RecordedRun.open(runs[name]) for name in ('sine', 'square')]
        return comparison_panels(opened), comparison_table(opened)

    panels, table = compared()
    long()
    found, found_table = compared()
    assert found_table == table
    for panel, other in zip(found, panels, strict=True):
        for line, expected in zip(panel.traces, other.traces, strict=True):
            np.testing.assert_allclose(line.x, expected.x, rtol=1e-12)
            np.testing.assert_allclose(line.y, expected.y, rtol=1e-7, atol=1e-12)


def test_what_is_from_a_stretch_is_said(runs, long, tmp_path):
    long(4000)
    opened = RecordedRun.open(runs['seeking'])
    _, remarks = report_run(opened, tmp_path)
    first = opened.row_count - 4000
    assert any(f'from ticks {first} to {opened.last_tick}' in line and 'seeks' in line for line in remarks)
    written = yaml.safe_load((tmp_path / 'metrics.yaml').read_text('utf8'))
    assert any('seeks' in line for line in written['left_out'])
    assert all(seek['start_s'] >= first * opened.sample_time for seek in written['seeks'])
    _, remarks = report_run(RecordedRun.open(runs['sine']), tmp_path / 'sine')
    assert not any('alone' in line for line in remarks)


def test_the_seeks_of_a_stretch_are_seeks_of_the_run(runs, long):
    whole = RecordedRun.open(runs['seeking'])
    tolerance = tolerance_of(whole)
    assert tolerance is not None
    expected = {round(response.time / whole.sample_time): response for response in responses_of(whole, tolerance)}
    long(4001)
    part = part_with_seeks(RecordedRun.open(runs['seeking']))
    assert len(part.ticks) == 4001
    found = responses_of(part, tolerance)
    assert len(found) > 10
    for response in found:
        same = expected[round(response.time / whole.sample_time)]
        assert (response.seek.origin, response.seek.target) == (same.seek.origin, same.seek.target)
        assert response.seek_time == pytest.approx(same.seek_time)
        assert response.overshoot == same.overshoot


def test_a_long_run_without_seeks_is_not_read_for_them(runs, long):
    long(100)
    opened = RecordedRun.open(runs['sine'])
    assert part_with_seeks(opened) is opened
    assert seeks_of(opened) == ()


def test_blocks_are_of_equal_length(runs, long):
    whole = Run.open(runs['sine'])
    long()
    found = list(blocks(RecordedRun.open(runs['sine']), 1000))
    assert [len(block) for block in found] == [1000] * 8 + [1]
    assert np.concatenate([block.position for block in found]).tobytes() == whole.position.tobytes()


def test_the_stretch_of_a_long_run_is_its_end(runs, long):
    whole = Run.open(runs['sine'])
    long(500)
    part = stretch_of(RecordedRun.open(runs['sine']))
    assert part.ticks.tolist() == whole.ticks[-500:].tolist()
    assert part.estimates['sigma_hat'].tolist() == whole.estimates['sigma_hat'][-500:].tolist()
    assert part.parameter('reference_generator', 'waveform') == 'sine'
    with pytest.raises(KeyError, match='topic pes'):
        part['pes']


def test_errors_by_source_of_a_long_run(runs, long):
    expected = error_by_source_of_run(RecordedRun.open(runs['servo']))
    long()
    opened = RecordedRun.open(runs['servo'])
    found = error_by_source_of_run(opened)
    assert found.total == pytest.approx(expected.total)
    assert list(found.contributions) == list(expected.contributions)
    for source, value in found.contributions.items():
        assert value == pytest.approx(expected.contributions[source], rel=1e-5, abs=1e-7)
    assert not opened._arrays
