"""A campaign's table is the same to the bit however its runs are made, and each row is that run's recording."""

import concurrent.futures
import csv
import json
import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros.campaign import main as campaign_main
from hdd_servo_ros.campaign.campaign import Campaign, base_file
from hdd_servo_ros.campaign.folder import StudyError, alone_in
from hdd_servo_ros.campaign.table import Table
from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.signals_digest import signals_digest
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.simulation import simulate

ROOT = Path(__file__).parents[2]
SPEC = {
    'name': 'small',
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 0.1},
    'controllers': ['adaptive_nn', 'pid'],
    'vary': [
        {
            'runs': 4,
            'plan': 'latin_hypercube',
            'draw': {
                'vcm_plant:gain': {'uniform': [0.8, 1.2], 'times_base': True},
                'reference_generator:amplitude': {'log_uniform': [0.5, 3.0]},
            },
        }
    ],
    'seeds': 2,
}
AMPLITUDES = {**SPEC, 'controllers': ['pid'], 'vary': [{'reference_generator:amplitude': [1.0, 2.0, 3.0]}], 'seeds': 1}
LAB_METRICS = """
def worst(run):
    \"\"\"Return the largest error of the second half of the run [nm].\"\"\"
    return 1e3 * abs(run.error[run.time >= 0.5 * run.duration]).max()
"""


@pytest.fixture(scope='module')
def table():
    return Campaign(SPEC).run(workers=1)


@pytest.fixture
def own_metrics(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


@pytest.mark.parametrize(
    ('workers', 'executor'), [(3, concurrent.futures.ProcessPoolExecutor), (3, concurrent.futures.ThreadPoolExecutor)]
)
def test_the_table_is_the_same_for_any_workers(table, workers, executor):
    assert Campaign(SPEC).run(workers=workers, executor=executor).csv() == table.csv()


def test_a_row_is_the_run_that_its_command_records(table, tmp_path):
    campaign = Campaign(SPEC)
    campaign.run(tmp_path / 'campaign')
    run = campaign.plan[5]
    command = shlex.split(run.command(base_file(tmp_path / 'campaign', run.controller), str(tmp_path / 'run')))
    assert command[:4] == ['ros2', 'run', 'hdd_servo_ros', 'simulate']
    assert simulate.main(command[4:]) == 0
    recorded = RecordedRun.open(tmp_path / 'run')
    row = list(table.rows())[5]
    assert row['digest'] == signals_digest(recorded)
    judged = verdict_of(recorded)
    assert judged is not None
    assert row['verdict'] == judged.text
    assert row['controller'] == recorded.controller == 'adaptive_nn'
    assert row['vcm_plant:gain'] == recorded.parameter('vcm_plant', 'gain')
    assert row['seed'] == recorded.parameter('ldv_sensor', 'seed') == 2
    expected = {metric.name: metric.value for metric in run_metrics(recorded)}
    assert {name: row[name] for name in expected} == expected
    assert {metric.name: metric.unit for metric in run_metrics(recorded) if metric.unit}.items() <= table.units.items()


def test_the_results_are_on_disk(tmp_path):
    table = Campaign({**SPEC, 'seeds': 1}).run(tmp_path)
    assert (tmp_path / 'table.csv').read_text() == table.csv()
    with (tmp_path / 'table.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row['rms_error']) for row in rows] == table['rms_error'].tolist()
    described = yaml.safe_load((tmp_path / 'campaign.yaml').read_text())
    assert described['status'] == 'finished'
    assert described['runs'] == len(table) == 8
    assert described['table_digest'] == table.digest()
    assert described['versions']['numpy'] == np.__version__
    assert described['units']['rms_error'] == 'nm'


def test_a_parquet_table_holds_every_bit(table, tmp_path):
    parquet = pytest.importorskip('pyarrow.parquet')
    table.write_parquet(tmp_path / 'table.parquet')
    found = parquet.read_table(tmp_path / 'table.parquet')
    assert tuple(found.column_names) == table.columns
    for name in table.columns:
        np.testing.assert_array_equal(found[name].to_numpy(), table[name])
    assert found.schema.field('rms_error').metadata[b'unit'] == b'nm'


def test_a_table_goes_to_pandas(table):
    pytest.importorskip('pandas')
    frame = table.to_dataframe()
    assert tuple(frame.columns) == table.columns
    assert frame.groupby('controller')['rms_error'].mean()['pid'] == np.mean(
        table.where(controller='pid')['rms_error'].tolist()
    )


def test_a_table_reads_well(table):
    text = repr(table)
    assert text.startswith('16 runs, ')
    assert 'tracks: ' in text
    assert '... 6 more' in text


def test_a_campaign_goes_on_where_it_was_killed(table, tmp_path):
    Campaign(SPEC).run(tmp_path)
    results = (tmp_path / 'results.jsonl').read_bytes()
    lines = results.splitlines(keepends=True)
    kept = b''.join(lines[:5])
    # In the middle of a line.
    (tmp_path / 'results.jsonl').write_bytes(kept + lines[5][:-9])
    assert Campaign(SPEC).run(tmp_path).csv() == table.csv()
    found = (tmp_path / 'results.jsonl').read_bytes()
    assert found.startswith(kept)
    assert len(found.splitlines()) == 16


def test_a_metric_is_the_same_whatever_else_is_asked_for(table):
    names = ['tmr_of_spectrum', 'peak_sensitivity', 'control_loop_area', 'rms_error']
    found = Campaign({**SPEC, 'metrics': names}).run(workers=2)
    assert set(found.columns[found.columns.index('last_tick') + 1 : -1]) == set(names)
    for name in (*names, 'verdict', 'digest'):
        assert found[name].tolist() == table[name].tolist()
    alone = Campaign({**SPEC, 'metrics': ['rms_error']}).run(workers=2)
    assert alone['rms_error'].tolist() == table['rms_error'].tolist()
    assert 'peak_sensitivity' not in alone


def test_a_killed_campaign_goes_on(tmp_path):
    spec = {**SPEC, 'set': {'deterministic_timer:duration': 0.2}, 'seeds': 20}
    (tmp_path / 'spec.yaml').write_text(yaml.safe_dump(spec))
    command = [sys.executable, '-m', 'hdd_servo_ros.campaign.main', 'spec.yaml', '--output', 'out', '--workers', '2']
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, start_new_session=True)
    results = tmp_path / 'out' / 'results.jsonl'
    deadline = time.monotonic() + 240.0
    while time.monotonic() < deadline and not (results.exists() and results.read_bytes().count(b'\n') >= 10):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    there = results.read_bytes().count(b'\n')
    assert 10 <= there < 160
    table = Campaign(tmp_path / 'spec.yaml').run(tmp_path / 'out')
    assert table.csv() == Campaign(tmp_path / 'spec.yaml').run().csv()


def test_a_killed_worker_loses_nothing(table, tmp_path, own_metrics, monkeypatch):
    for mark in range(2):
        (tmp_path / f'mark{mark}').touch()
    monkeypatch.setenv('HDD_SERVO_ROS_TEST_MARKS', str(tmp_path))
    found = Campaign({**SPEC, 'metrics': ['all', 'killing_metric:kill_once']}).run(workers=2)
    assert not list(tmp_path.iterdir())
    assert found['digest'].tolist() == table['digest'].tolist()
    assert found['rms_error'].tolist() == table['rms_error'].tolist()
    assert (found['killing_metric:kill_once'] == 1.0).all()


def test_a_run_that_kills_each_worker_is_a_row(own_metrics):
    found = Campaign({**AMPLITUDES, 'metrics': ['rms_error', 'killing_metric:kill_always']}).run(workers=2)
    assert found['status'].tolist() == ['finished', 'finished', 'failed']
    assert found['reason'].tolist()[2] == 'its process was killed 4 times, perhaps for lack of memory'
    assert np.isnan(found['rms_error'][2])


def test_a_run_that_fails_or_is_rejected_is_a_row_with_its_reason():
    spec = {**AMPLITUDES, 'vary': [{'pid_controller:proportional_gain': [0.05, 1.7e308, -1.0]}]}
    found = Campaign(spec).run(workers=2)
    assert found['status'].tolist() == ['finished', 'failed', 'rejected']
    assert found['verdict'].tolist()[1] == 'diverged'
    assert 'not finite' in found['reason'].tolist()[1]
    assert 'pid_controller:proportional_gain: -1.0;' in found['reason'].tolist()[2]
    assert found['last_tick'].tolist()[2] == -1


def test_own_metrics_are_columns(own_metrics):
    spec = {**AMPLITUDES, 'metrics': ['max_error', 'killing_metric:late_peak', 'killing_metric:fail']}
    found = Campaign(spec).run(workers=1)
    metrics = found.columns[found.columns.index('last_tick') + 1 : -1]
    assert metrics == ('max_error', 'killing_metric:late_peak', 'killing_metric:fail')
    assert (1e3 * found['killing_metric:late_peak'] > 0.0).all()
    assert (1e3 * found['killing_metric:late_peak'] <= found['max_error']).all()
    assert set(found['reason'].tolist()) == {'killing_metric:fail: RuntimeError: no such thing'}
    assert set(found['status'].tolist()) == {'finished'}


@pytest.mark.parametrize(
    ('keep', 'kept'),
    [
        ('all', {'000000', '000001', '000002'}),
        ('failed', {'000001'}),
        ({'worst': 2, 'of': 'rms_error'}, {'000001', '000002'}),
        ('none', set()),
    ],
)
def test_chosen_runs_are_recorded(tmp_path, keep, kept):
    spec = {**AMPLITUDES, 'vary': [{'pid_controller:proportional_gain': [0.1, 1.7e308, 0.01]}], 'keep': keep}
    table = Campaign(spec).run(tmp_path, workers=2)
    assert {path.name for path in tmp_path.glob('runs/*')} == kept
    for name in kept:
        recorded = RecordedRun.open(tmp_path / 'runs' / name)
        assert signals_digest(recorded) == table['digest'][int(name)]


def damaged(run):
    """Flip a bit in the middle of a recorded run's bag."""
    (bag,) = (run / 'bag').glob('*.mcap')
    content = bytearray(bag.read_bytes())
    content[len(content) // 2] ^= 1
    bag.write_bytes(content)


def cut(run):
    (bag,) = (run / 'bag').glob('*.mcap')
    bag.write_bytes(bag.read_bytes()[:-100])


def interrupted(run):
    text = (run / 'run.yaml').read_text()
    (run / 'run.yaml').write_text(text.replace('status: finished', 'status: interrupted'))


def another(run):
    for file in (run / 'bag').iterdir():
        shutil.copy(file, run.with_name('000001') / 'bag' / file.name)


def killed(run):
    (run / 'run.yaml').unlink()


@pytest.mark.parametrize('harm', [damaged, cut, interrupted, another, killed])
def test_a_recorded_run_that_is_not_whole_or_another_is_made_again(tmp_path, harm):
    spec = {**AMPLITUDES, 'keep': 'all'}
    table = Campaign(spec).run(tmp_path, workers=2)
    runs = [tmp_path / 'runs' / name for name in ('000000', '000001', '000002')]
    written = [(run / 'run.yaml').stat().st_mtime_ns for run in runs]
    harm(runs[0])
    harmed = 1 if harm is another else 0
    assert Campaign(spec).run(tmp_path, workers=2).csv() == table.csv()
    for number, run in enumerate(runs):
        recorded = RecordedRun.open(run)
        assert (recorded.status, signals_digest(recorded)) == ('finished', table['digest'][number])
        assert ((run / 'run.yaml').stat().st_mtime_ns > written[number]) == (number == harmed)


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'after': 0.01}, 'after changed from None to 0.01'),
        ({'metrics': ['all', 'rms_error']}, "metrics changed from ['all'] to ['all', 'rms_error']"),
        ({'seeds': 2}, 'seeds changed from [1] to [1, 2]'),
        ({'controllers': ['pid', 'adaptive_nn']}, "controllers changed from ['pid'] to ['pid', 'adaptive_nn']"),
        (
            {'vary': [{'reference_generator:amplitude': [1.0, 2.0, 3.5]}]},
            'the values of reference_generator:amplitude changed',
        ),
        (
            {'vary': [{'vcm_plant:gain': [4e7, 4.1e7, 4.2e7]}]},
            'reference_generator:amplitude no longer varies; vcm_plant:gain varies now',
        ),
        (
            {'set': {'deterministic_timer:duration': 0.2, 'vcm_plant:track_pitch': 1.0}},
            'deterministic_timer:duration changed from 0.1 to 0.2; vcm_plant:track_pitch is set to 1.0 now',
        ),
        (
            {'set': {'ldv_sensor:noise': False, 'ldv_sensor:seed': 3, 'vcm_plant:track_pitch': 1.0}},
            'deterministic_timer:duration is no longer set to 0.1; ldv_sensor:noise is set to False now; '
            'ldv_sensor:seed is set to 3 now; and 1 more',
        ),
    ],
)
def test_a_changed_specification_is_rejected_with_what_changed(tmp_path, change, said):
    Campaign(AMPLITUDES).run(tmp_path)
    with pytest.raises(ArgumentError, match=re.escape(f'holds another campaign: {said}; remove it, or choose another')):
        Campaign({**AMPLITUDES, **change}).run(tmp_path)


def test_only_what_is_kept_may_change(tmp_path):
    table = Campaign(AMPLITUDES).run(tmp_path)
    assert Campaign({**AMPLITUDES, 'keep': 'all'}).run(tmp_path).csv() == table.csv()
    assert len(list(tmp_path.glob('runs/*'))) == 3


def test_a_folder_of_another_campaign_is_rejected(tmp_path):
    Campaign(AMPLITUDES).run(tmp_path)
    with pytest.raises(ArgumentError, match='holds another campaign'):
        Campaign({**AMPLITUDES, 'after': 0.01}).run(tmp_path)
    (tmp_path / 'other').mkdir()
    (tmp_path / 'other' / 'file').touch()
    with pytest.raises(ArgumentError, match='is not empty and is not the directory of a campaign'):
        Campaign(AMPLITUDES).run(tmp_path / 'other')


def test_metrics_of_a_users_file_are_found_by_the_python_path(tmp_path):
    """In the command, started elsewhere, and in its worker processes."""
    (tmp_path / 'lab').mkdir()
    (tmp_path / 'lab' / 'lab_metrics.py').write_text(LAB_METRICS)
    (tmp_path / 'spec.yaml').write_text(json.dumps({**AMPLITUDES, 'metrics': ['max_error', 'lab_metrics:worst']}))
    command = [sys.executable, '-m', 'hdd_servo_ros.campaign.main', 'spec.yaml', '--output', 'out', '--workers', '2']
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join([str(ROOT), str(tmp_path / 'lab')])}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with (tmp_path / 'out' / 'table.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    for row in rows:
        assert float(row['lab_metrics:worst']) == pytest.approx(float(row['max_error']), rel=1e-12)
    without = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert without.returncode == 2
    assert 'metrics: lab_metrics:worst cannot be imported: ModuleNotFoundError' in without.stderr


def test_two_campaigns_do_not_work_in_one_folder(tmp_path):
    with alone_in(tmp_path), pytest.raises(StudyError, match='another study is running'):
        Campaign(AMPLITUDES).run(tmp_path)


def test_a_metric_that_no_run_has_is_rejected_and_leaves_the_folder_empty(tmp_path):
    with pytest.raises(ArgumentError, match="unknown metric 'rms_eror'; did you mean rms_error"):
        Campaign({**AMPLITUDES, 'metrics': ['rms_eror']}).run(tmp_path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ArgumentError, match='metrics: nowhere:f cannot be imported: ModuleNotFoundError'):
        Campaign({**AMPLITUDES, 'metrics': ['nowhere:f']})


@pytest.mark.parametrize(
    ('entries', 'message'),
    [
        ({'metrics': ['all', 'rms_eror']}, "metrics: unknown metric 'rms_eror'; did you mean rms_error?"),
        ({'keep': {'worst': 1, 'of': 'rms_eror'}}, "keep: of: unknown metric 'rms_eror'; did you mean rms_error?"),
    ],
)
def test_a_misspelt_metric_is_rejected_before_the_first_run_even_if_none_would_finish(entries, message):
    spec = {**AMPLITUDES, 'vary': [{'pid_controller:proportional_gain': [-1.0]}], **entries}
    with pytest.raises(ArgumentError, match=re.escape(message)):
        Campaign(spec)


def test_a_metric_that_only_other_runs_have_is_rejected_when_it_is_known(tmp_path):
    with pytest.raises(ArgumentError, match="keep: of: unknown metric 'seeks'; the runs have rms_error, max_error"):
        Campaign({**AMPLITUDES, 'keep': {'worst': 1, 'of': 'seeks'}}).run(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_campaign_in_which_every_run_is_rejected_has_a_table_a_picture_and_a_page(tmp_path, capsys):
    vary = {'vary': [{'pid_controller:proportional_gain': [-1.0, -2.0]}]}
    (tmp_path / 'spec.yaml').write_text(json.dumps({**AMPLITUDES, **vary, 'keep': {'worst': 1, 'of': 'rms_error'}}))
    assert campaign_main.main([str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out')]) == 0
    assert '2 of 2 runs did not finish' in capsys.readouterr().out
    with (tmp_path / 'out' / 'table.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert [(row['status'], row['rms_error']) for row in rows] == 2 * [('rejected', 'nan')]
    assert 'pid_controller:proportional_gain: -2.0;' in rows[1]['reason']
    assert 'proportional_gain: -1.0;' in (tmp_path / 'out' / 'campaign.html').read_text()


def test_the_worst_runs_are_those_of_the_largest_absolute_value_by_their_numbers():
    campaign = Campaign(AMPLITUDES)
    table = Table(
        {
            'run': [0, 1, 2, 3, 4],
            'status': ['finished', 'finished', 'failed', 'finished', 'finished'],
            'mean_error': [1.0, -3.0, 0.0, math.nan, 2.0],
        }
    )
    assert campaign.worst(table, 'mean_error', 9) == [2, 3, 1, 4, 0]
    assert campaign.worst(table, 'mean_error', 2) == [2, 3]
    assert campaign.worst(table.where(status='finished')[2:], 'mean_error', 9) == [3, 4]
    assert campaign.worst(table, '', 9) == [2]


@pytest.mark.parametrize('metric', ['end', 'interrupt'])
def test_a_metric_that_would_end_the_process_is_a_reason(own_metrics, metric):
    found = Campaign({**AMPLITUDES, 'metrics': ['max_error', f'killing_metric:{metric}']}).run(workers=2)
    error = {'end': 'SystemExit: 3', 'interrupt': 'KeyboardInterrupt: '}[metric]
    assert set(found['reason'].tolist()) == {f'killing_metric:{metric}: {error}'}
    assert set(found['status'].tolist()) == {'finished'}
    assert (found['max_error'] > 0.0).all()


@pytest.mark.parametrize('controller', ['Ending', 'Interrupting'])
def test_a_controller_that_would_end_the_process_is_a_failed_row(own_metrics, controller):
    spec = {
        **AMPLITUDES,
        'controllers': ['pid', f'killing_controller:{controller}'],
        'vary': [{'reference_generator:amplitude': [1.0]}],
    }
    found = Campaign(spec).run(workers=2)
    assert found['status'].tolist() == ['finished', 'failed']
    error = {'Ending': 'SystemExit: 3', 'Interrupting': 'KeyboardInterrupt'}[controller]
    assert error in found['reason'].tolist()[1]


@pytest.mark.parametrize('workers', ['2', 2.5, 0, True])
def test_a_wrong_number_of_workers_is_rejected(workers):
    with pytest.raises(ArgumentError, match=re.escape(f'workers = {workers!r} is invalid; expected an integer')):
        Campaign(AMPLITUDES).run(workers=workers)


def test_a_changed_metric_is_rejected_on_the_way_on(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    module = tmp_path / 'changing_metric.py'
    module.write_text('def one(run):\n    return 1.0\n')
    spec = {**AMPLITUDES, 'metrics': ['rms_error', 'changing_metric:one']}
    Campaign(spec).run(tmp_path / 'out', workers=1)
    Campaign(spec).run(tmp_path / 'out', workers=1)
    module.write_text('def one(run):\n    return 2.0\n')
    changed = 'results from before metric changing_metric:one, changing_metric.py changed; remove it'
    with pytest.raises(ArgumentError, match=changed):
        Campaign(spec).run(tmp_path / 'out', workers=1)


def test_kept_runs_of_threads_leave_the_output_alone(tmp_path, capsys):
    spec = {**AMPLITUDES, 'keep': 'all'}
    streams = sys.stdout, sys.stderr
    Campaign(spec).run(tmp_path, workers=3, executor=concurrent.futures.ThreadPoolExecutor)
    assert (sys.stdout, sys.stderr) == streams
    print('still here')
    assert capsys.readouterr() == ('still here\n', '')
    assert len(list((tmp_path / 'runs').iterdir())) == 3


def test_the_command_writes_the_table(tmp_path, capsys):
    spec = {**AMPLITUDES, 'controllers': ['pid', {'name': 'off', 'controller': 'pid'}]}
    (tmp_path / 'spec.yaml').write_text(json.dumps(spec))
    assert campaign_main.main([str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out')]) == 0
    out = capsys.readouterr().out
    assert "Campaign('small': 6 runs, 3 points x 2 controllers x 1 seeds)" in out
    assert f'table: {tmp_path / "out" / "table.csv"}' in out
    assert (tmp_path / 'out' / 'table.csv').exists()


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('controllers: [pidd]', "spec.yaml: controllers: pidd: invalid value for parameter controller: 'pidd';"),
        ('set: {vcm_plant:gain: -1.0}', 'spec.yaml: set: invalid value for parameter vcm_plant:gain: -1.0;'),
        ('set: {vcm_plan:gain: 1.0}', "spec.yaml: set: parameters for '/vcm_plan', but there are"),
        (
            'controllers: [{name: a, controller: pid, set: {vcm_plant:gain: -1.0}}]',
            'spec.yaml: controllers: a: set: invalid value for parameter vcm_plant:gain: -1.0;',
        ),
        ('metrics: [nowhere:f]', 'spec.yaml: metrics: nowhere:f cannot be imported'),
        ('vary: 3', 'spec.yaml: vary: 3 is not a list of blocks'),
        ('vary: {}', 'spec.yaml: vary: empty block'),
        ('vary: [{}]', 'spec.yaml: vary: empty block'),
        ('seeds: 2\nseeds: 3', "spec.yaml is invalid: line 2: 'seeds' is given twice"),
        ('vary: ' + 5000 * '[', 'spec.yaml is invalid: line 1: vary: entries are nested more than 32 deep'),
        ('seeds: [99999999999999999999]', 'spec.yaml: seeds: 1e+20 is not an integer'),
        ('files: [spec.yaml]', 'spec.yaml'),
    ],
)
def test_a_wrong_specification_is_one_line_and_exit_code_2(tmp_path, capsys, text, line):
    (tmp_path / 'spec.yaml').write_text(text)
    assert campaign_main.main([str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out')]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert line in error
    assert not (tmp_path / 'out').exists()


def test_without_dask_the_error_is_one_line_that_names_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    (tmp_path / 'spec.yaml').write_text(json.dumps(AMPLITUDES))
    assert campaign_main.main([str(tmp_path / 'spec.yaml'), '--dask']) == 1
    expected = "a Dask cluster needs distributed, which is not installed: pip install 'hdd_servo_ros[campaign]'"
    assert expected in capsys.readouterr().err
