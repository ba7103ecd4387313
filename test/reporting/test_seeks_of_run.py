"""The seeks of recorded runs against what their references were asked to do, and a measurement written out by hand."""

from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.seek_bounds import fastest_seek, time_optimal_seek
from hdd_servo_ros.analysis.seek_metrics import SETTLE
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.reporting.close_up import close_up_of
from hdd_servo_ros.reporting.comparison_panels import comparison_panels
from hdd_servo_ros.reporting.loop_panels import loop_panels
from hdd_servo_ros.reporting.report import report_run
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import panels_over_time, run_panels
from hdd_servo_ros.reporting.seek_panels import seek_panels
from hdd_servo_ros.reporting.seek_report import (
    access_times_as_rows,
    for_yaml,
    lost_seeks,
    seek_line,
    seek_metrics,
    seek_tables,
    seeks_as_rows,
)
from hdd_servo_ros.reporting.seek_view import view_of_estimates, view_of_run
from hdd_servo_ros.reporting.seeks_of_run import bound_curve, modes_of, responses_of, seeks_of
from hdd_servo_ros.reporting.show import show_run

from .seeker import TARGETS, seeking_run

PARAMS = Path(__file__).parents[2] / 'params'
NSS = ('nss_100ktpi.yaml', 'nss_100ktpi_10_khz.yaml')
LENGTHS = np.diff([0.0, *TARGETS])
NANOMETRES = 0.1016
"""10 % of the default track pitch [um]."""


@pytest.fixture(scope='module')
def run(simulated, tmp_path_factory):
    return seeking_run(simulated, tmp_path_factory.mktemp('seeking') / 'run')


@pytest.fixture(scope='module')
def smooth(simulated, tmp_path_factory):
    """Seeks along trajectories, by a controller without modes."""
    return seeking_run(
        simulated, tmp_path_factory.mktemp('smooth') / 'run', 'controller:=pid', 'seek.trajectory:=minimum_jerk'
    )


@pytest.fixture(scope='module')
def sine(simulated, tmp_path_factory):
    return Run.open(simulated(tmp_path_factory.mktemp('sine') / 'run', '-p', 'controller:=pid', '-p', 'duration:=0.1'))


def by_name(metrics):
    assert len({metric.name for metric in metrics}) == len(metrics)
    return {metric.name: metric.value for metric in metrics}


@pytest.mark.parametrize('kind', ['run', 'smooth'])
def test_the_seeks_are_those_of_the_parameters(request, kind):
    found = seeks_of(request.getfixturevalue(kind))
    assert [seek.row for seek in found] == [0, 200, 400, 600, 800, 1000]
    assert [seek.target for seek in found] == list(TARGETS)
    assert [seek.length for seek in found] == pytest.approx(LENGTHS)


def test_what_has_no_seeks(sine, simulated, tmp_path):
    assert seeks_of(sine) == ()
    square = ('-p', 'waveform:=square', '-p', 'frequency:=25.0', '-p', 'duration:=0.1')
    assert seeks_of(Run.open(simulated(tmp_path / 'pid', '-p', 'controller:=pid', *square))) == ()


def test_steps_are_seeks_of_a_controller_that_gives_its_mode(simulated, tmp_path):
    run = seeking_run(simulated, tmp_path / 'run', 'waveform:=square', 'frequency:=25.0', 'amplitude:=3.0')
    # From the head's position at tick 0 to +3 um, and to and fro after that.
    assert [seek.target for seek in seeks_of(run)] == [3.0, -3.0] * 3 + [3.0]
    assert [seek.row for seek in seeks_of(run)] == [0, 200, 400, 600, 800, 1000, 1200]
    assert seeks_of(run)[0].origin == pytest.approx(0.0, abs=1e-6)


def test_arrivals_are_those_that_a_loop_finds(run):
    """Written out once, sample by sample."""
    for seek, response in zip(seeks_of(run), responses_of(run, NANOMETRES), strict=True):
        end = min(seek.row + 200, len(run.ticks))
        arrival = None
        for row in range(end - 1, seek.row - 1, -1):
            if abs(run.position[row] - seek.target) > NANOMETRES:
                arrival = row + 1
                break
        assert arrival is not None
        assert response.seek_time == pytest.approx(1e-4 * (arrival - seek.row))
        assert response.peak_control == np.abs(run.command[seek.row : arrival]).max()
        switch = seek.row + int(np.argmax(run.estimates['seek_mode'][seek.row : end] == SETTLE))
        assert response.settling_time == pytest.approx(1e-4 * (arrival - switch))


def test_a_seek_that_starts_as_the_run_ends_does_not_count(simulated, tmp_path):
    for duration, counted in (('0.1', 5), ('0.1098', 5), ('0.11', 6)):
        run = seeking_run(simulated, tmp_path / duration, f'duration:={duration}')
        assert len(seeks_of(run)) == 6
        assert len(responses_of(run, NANOMETRES)) == counted == by_name(seek_metrics(run))['seeks']


def test_metrics_tables_and_lines_agree(run):
    metrics, rows = by_name(seek_metrics(run)), seeks_as_rows(run)
    assert metrics['seeks'] == metrics['seeks_arrived'] == len(rows) == 6
    assert metrics['worst_seek_time_10'] == max(row['seek_time_ms'] for row in rows)
    assert metrics['median_seek_time_10'] == pytest.approx(np.median([row['seek_time_ms'] for row in rows]))
    assert metrics['worst_seek_time_15'] == max(row['seek_time_15_ms'] for row in rows)
    assert metrics['worst_seek_time_15'] <= metrics['worst_seek_time_10']
    assert metrics['seek_overshoot'] == max(row['overshoot_nm'] for row in rows)
    assert metrics['mode_returns'] == 0
    for row, length in zip(rows, LENGTHS, strict=True):
        optimal = 1e3 * time_optimal_seek(PlantParameters(), length).time
        assert row['over_time_optimal'] == pytest.approx(row['seek_time_ms'] / optimal)
        fastest = 1e3 * fastest_seek(PlantParameters(), 1e-4, length, NANOMETRES).time
        assert row['over_fastest'] == pytest.approx(row['seek_time_ms'] / fastest)
        assert row['over_fastest'] > 1.0
    assert metrics['seek_time_over_optimal'] == max(row['over_time_optimal'] for row in rows)
    worst, median = metrics['worst_seek_time_10'], metrics['median_seek_time_10']
    assert seek_line(run) == f'6 of 6 arrive within 101.6 nm, median {median:.4g} ms, worst {worst:.4g} ms'
    assert lost_seeks(run) == ''
    access = access_times_as_rows(run)
    # 1; 10 and 10; 20; 50 and 69 um.
    assert [row['seeks'] for row in access] == [1, 2, 1, 2]
    assert max(row['worst_ms'] for row in access) == worst
    assert access[-1]['time_optimal_of_longest_ms'] == pytest.approx(
        1e3 * time_optimal_seek(PlantParameters(), 69.0).time
    )
    tables = seek_tables(run)
    assert list(tables) == ['access times over length', 'seeks']
    assert len(tables['seeks']) == 7
    assert tables['seeks'][0][:3] == ['start [s]', 'from [µm]', 'to [µm]']
    assert tables['seeks'][3][2] == '50'


def test_a_seek_that_does_not_arrive_is_reported_as_such(simulated, tmp_path, capsys):
    """With a quarter of the feedback the head rests where friction holds it."""
    run = seeking_run(simulated, tmp_path / 'run', 'controller:=pid', 'integral_gain:=0.0', 'proportional_gain:=0.15')
    metrics, rows = by_name(seek_metrics(run)), seeks_as_rows(run)
    lost = [row for row in rows if row['seek_time_ms'] == np.inf]
    assert 0 < len(lost) == metrics['seeks'] - metrics['seeks_arrived']
    for name in ('worst_seek_time_10', 'seek_settling', 'residual_rms', 'residual_peak', 'seek_time_over_optimal'):
        assert metrics[name] == np.inf
    assert f'{len(lost)} of 6 seeks do not arrive' in lost_seeks(run)
    assert 'arrive' in seek_line(run)
    assert 'worst' not in seek_line(run)
    first = int(np.flatnonzero([row['seek_time_ms'] == np.inf for row in rows])[0])
    assert '! never' in seek_tables(run)['seeks'][1 + first]
    access = next(panel for panel in seek_panels(run) if panel.name == 'access_times')
    marked = [trace for trace in access.traces if 'not arrive' in trace.name]
    assert [len(trace.x) for trace in marked] == [len(lost)]
    written, remarks = report_run(run, tmp_path / 'report')
    assert any('do not arrive' in line for line in remarks)
    assert '! never' in written[2].read_text('utf8').replace('&#x27;', "'")
    show_run(run.path, plot=False)
    assert f'seeks  {seek_line(run)}' in capsys.readouterr().out


def test_a_run_without_seeks_has_nothing_of_them(sine, tmp_path, capsys):
    assert seek_metrics(sine) == []
    assert seek_panels(sine) == []
    assert seek_tables(sine) == {}
    assert for_yaml(sine) == {}
    assert seek_line(sine) == lost_seeks(sine) == ''
    assert view_of_run(sine) is None
    assert bound_curve(sine, NANOMETRES) is None
    assert not any('seek' in metric.name for metric in run_metrics(sine))
    assert not any('seek' in panel.name or panel.shades for panel in run_panels(sine))
    assert [panel.name for panel in panels_over_time(sine)] == ['tracking', 'error', 'control', 'estimates']
    show_run(sine.path, plot=False)
    assert 'seeks' not in capsys.readouterr().out


def test_a_drive_in_other_units_is_told(run, tmp_path):
    copy = Run.open(run.path)
    copy.description['length_unit'] = 'm'
    assert seek_metrics(copy) == []
    assert any(
        'no metrics of seeks: the track pitch is in um, and this drive is in m' in line for line in left_out(copy)
    )
    assert view_of_run(copy) is None


def test_the_diagrams_over_time_show_target_modes_and_two_scales(run):
    panels = {panel.name: panel for panel in panels_over_time(run)}
    assert list(panels) == ['tracking', 'error', 'error_fine', 'control']
    assert [trace.name for trace in panels['tracking'].traces] == ['target', 'head']
    assert panels['error'].y_range == (-1000.0, 1000.0)
    assert panels['error_fine'].y_range == (-100.0, 100.0)
    (error,) = panels['error_fine'].traces
    assert error.y == pytest.approx(1e3 * np.interp(error.x, run.time, run.position - run.desired_position))
    mode = modes_of(run)
    for panel in (panels['tracking'], panels['error'], panels['error_fine']):
        assert [shade.name for shade in panel.shades] == ['mode: seek', 'mode: settle']
        for shade, number in zip(panel.shades, (1, 2), strict=True):
            inside = np.zeros(len(run.ticks), dtype=bool)
            for start, end in shade.intervals:
                inside |= (run.time >= start - 1e-9) & (run.time < end - 1e-9)
            np.testing.assert_array_equal(inside, mode == number)
    assert panels['control'].shades == ()


def test_a_trajectory_is_drawn_and_both_errors(smooth):
    panels = {panel.name: panel for panel in panels_over_time(smooth)}
    assert [trace.name for trace in panels['tracking'].traces] == ['target', 'trajectory', 'head']
    along, final = panels['error'].traces
    assert (along.name, final.name) == ('head - trajectory', 'head - target')
    target = np.repeat(TARGETS, 200)[: len(smooth.ticks)]
    target = np.append(target, [TARGETS[-1]] * (len(smooth.ticks) - len(target)))
    assert final.y == pytest.approx(1e3 * np.interp(final.x, smooth.time, smooth.position - target))
    assert along.y == pytest.approx(1e3 * np.interp(along.x, smooth.time, smooth.error))
    assert panels['error'].shades == ()


def test_the_close_up_is_the_last_seek_that_arrives(run):
    found = close_up_of(run)
    assert found is not None
    assert found.title == 'last seek that arrives'
    last = responses_of(run, NANOMETRES)[-1]
    assert found.start == pytest.approx(0.1 - 0.5e-3)
    assert found.end == pytest.approx(0.1 + last.seek_time + 1.5e-3)


def test_the_panels_of_seeks(run):
    panels = {panel.name: panel for panel in seek_panels(run)}
    assert list(panels) == ['access_times', 'seek_errors_coarse', 'seek_errors_fine', 'residual_spectrum']
    optimal, fastest, seeks = panels['access_times'].traces
    assert seeks.marked
    assert sorted(seeks.x) == pytest.approx(sorted(np.abs(LENGTHS)))
    assert sorted(seeks.y) == pytest.approx(sorted(row['seek_time_ms'] for row in seeks_as_rows(run)))
    assert np.all(np.diff(optimal.x) > 0.0)
    assert np.all(fastest.y >= 0.9 * np.interp(fastest.x, optimal.x, optimal.y))
    fine = panels['seek_errors_fine']
    assert fine.y_range == (-100.0, 100.0)
    # The limits and six seeks.
    assert len(fine.traces) == 7
    assert {trace.x[0] for trace in fine.traces} == {0.0}


def test_several_runs_are_compared_over_the_same_bounds(run, smooth, sine):
    found = {panel.name: panel for panel in comparison_panels([run, smooth, sine])}
    optimal, fastest, *seeks = found['access_times'].traces
    assert (optimal.name, fastest.name) == ('T*, time-optimal rigid body', 'fastest with modes')
    assert len(seeks) == 2
    for trace, kind in zip(seeks, (run, smooth), strict=True):
        times = [response.seek_time for response in responses_of(kind, NANOMETRES) if response.has_arrived]
        assert trace.y == pytest.approx(1e3 * np.array(times))
    assert len({trace.color for trace in found['access_times'].traces}) == 4
    assert 'access_times' not in {panel.name for panel in comparison_panels([sine, sine])}


def test_the_target_is_drawn_as_stairs(run):
    (tracking, *_) = panels_over_time(run)
    target = tracking.traces[0]
    assert np.all(np.diff(target.x) >= 0.0)
    jumps = np.flatnonzero(np.diff(target.y))
    assert np.all(target.x[jumps] == target.x[jumps + 1])
    # The first seek begins at tick 0.
    assert target.x[jumps] == pytest.approx(0.02 * np.arange(1, 6))


def test_the_live_view_takes_the_target_from_the_estimates(run, sine):
    seeks = view_of_estimates(run)
    assert seeks is not None
    assert seeks.target == pytest.approx(run.desired_position)
    names = [panel.name for panel in loop_panels(run, follows=True, seeks=seeks)]
    assert names == ['tracking', 'error', 'error_fine', 'control']
    assert view_of_estimates(sine) is None


def test_many_lengths_have_a_curve_of_bounds_between_them(simulated, tmp_path, monkeypatch):
    arguments = ('controller:=pid', 'seek.source:=random', 'seek.count:=20', 'seek.shortest:=0.5', 'duration:=0.4')
    run = seeking_run(simulated, tmp_path / 'run', *arguments)
    monkeypatch.setattr('hdd_servo_ros.reporting.seek_report._MOST_LINES', 3)
    rows = seek_tables(run)['the 3 slowest of 20 seeks'][1:]
    slowest = sorted(response.seek_time for response in responses_of(run, NANOMETRES))[-3:]
    assert sorted(float(row[4]) for row in rows) == pytest.approx([1e3 * time for time in slowest])
    curve = bound_curve(run, NANOMETRES)
    assert curve is not None
    assert len(seeks_of(run)) == 20
    assert len(curve.lengths) == 12
    for length in (1.0, 7.0, 40.0):
        fastest = fastest_seek(PlantParameters(), 1e-4, length, NANOMETRES).time
        # Of steps of a fifth of a sample.
        assert curve.fastest_at(length) == pytest.approx(fastest, abs=4e-5)


def test_with_the_servo_sensor_the_head_arrives_on_the_displaced_track(simulated, tmp_path):
    """Track pitch 254 nm, and runout of tens of nanometers."""
    files = [part for name in NSS for part in ('--params-file', str(PARAMS / name))]
    seeks = ('waveform:=seek', 'seek.trajectory:=minimum_jerk', 'seek.targets:=[2.0,0.0]', 'seek.dwell_times:=[0.05]')
    given = (part for text in (*seeks, 'controller:=pid', f'duration:={2100 * 9.9206e-5!r}') for part in ('-p', text))
    run = Run.open(simulated(tmp_path / 'run', *files, *given))
    assert run.is_track_following
    center = run.disturbance.track_center
    assert 1e3 * np.ptp(center) > 30.0
    rows = [seek.row for seek in seeks_of(run)]
    ends = [*rows, len(run.ticks)][1:]
    # Tolerances of the tenth of a track are left now and then: of a track and a half.
    for response, end in zip(responses_of(run, 0.381), ends, strict=False):
        row = response.seek.row
        outside = np.abs((run.position - center)[row:end] - response.seek.target) > 0.381
        assert response.seek_time == pytest.approx(run.sample_time * (1 + np.flatnonzero(outside)[-1]))
    panels = {panel.name: panel for panel in panels_over_time(run)}
    along, final = panels['error_fine'].traces
    assert final.name == 'head - target - track center'
    seen = view_of_run(run)
    assert seen is not None
    expected = 1e3 * (run.position - center - seen.target)
    assert final.y == pytest.approx(np.interp(final.x, run.time, expected))
    assert along.y == pytest.approx(np.interp(along.x, run.time, 1e3 * run.position_error))
