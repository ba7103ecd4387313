"""The page shows the runs of the table, and its commands make the worst ones again to the bit."""

import html
import json
import math
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from hdd_servo_ros.campaign import main as campaign_main
from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.page import write_page
from hdd_servo_ros.campaign.plot import write_plot
from hdd_servo_ros.campaign.table import Table
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.signals_digest import signals_digest
from hdd_servo_ros.simulation import simulate

SPEC = {
    'name': 'page <script>',
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 0.1},
    'controllers': ['adaptive_nn', {'name': '<b>pid', 'controller': 'pid'}],
    'vary': [{'reference_generator:amplitude': [1.0, 2.0, 3.0]}, {'reference_generator:waveform': ['sine', 'square']}],
    'seeds': [4],
}


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp('page')
    campaign = Campaign(SPEC)
    table = campaign.run(folder)
    return campaign, table, write_page(campaign, table, folder).read_text('utf8')


def figures_of(page):
    (text,) = re.findall(r'^const figures = (.*);$', page, re.MULTILINE)
    return json.loads(text)


def test_the_diagrams_hold_the_table(made):
    _, table, page = made
    figures = figures_of(page)
    histograms = figures['distributions']['data']
    rms = [trace['x'] for trace in histograms if trace['xaxis'] == 'x']
    assert rms == [table.where(controller=name)['rms_error'].tolist() for name in ('adaptive_nn', '<b>pid')]
    (parallel,) = figures['parallel']['data']
    by_label = {dimension['label']: dimension['values'] for dimension in parallel['dimensions']}
    assert by_label['amplitude'] == table['reference_generator:amplitude'].tolist()
    assert by_label['controller'] == [0, 1] * 6
    # Steps have no repeatable error.
    overshoot = by_label['worst_overshoot']
    assert [value is None for value in overshoot] == np.isnan(table['worst_overshoot']).tolist()
    assert any(value is None for value in overshoot)
    assert (
        figures['scatter']['data'][0]['x']
        == table.where(controller='adaptive_nn')['reference_generator:amplitude'].tolist()
    )


def test_the_picture_shows_the_metric_of_the_worst_runs(made, tmp_path):
    campaign, table, _ = made
    path = write_plot(campaign, table, tmp_path)
    assert path == tmp_path / 'campaign.png'
    # One diagram of the distribution, and one of the only parameter that is a number.
    assert imread(tmp_path / 'campaign.png').shape[:2] == (352, 748)
    nothing = Table({name: [math.nan] if name == 'rms_error' else ['x'] for name in table.columns})
    assert write_plot(campaign, nothing, tmp_path) is None


def test_names_are_text(made):
    _, _, page = made
    assert '<b>pid' not in page
    assert '<h1>Campaign page &lt;script&gt;</h1>' in page
    assert '&lt;b&gt;pid' in page


def test_the_worst_runs_come_first_and_their_commands_repeat_them(made, tmp_path):
    campaign, table, page = made
    rows = re.findall(r'<tr><td>(\d+)</td>.*?<td class="text">(cd [^<]*)</td></tr>', page)
    values = table['rms_error']
    assert [int(number) for number, _ in rows] == sorted(range(12), key=lambda number: -values[number])[:10]
    assert campaign.worst(table, 'rms_error', 10) == [int(number) for number, _ in rows]
    number, command = rows[0]
    words = shlex.split(html.unescape(command))
    assert words[:3] == ['cd', str(Path.cwd()), '&&']
    words = words[3:]
    words = [f'bag_recorder:run_dir:={tmp_path / "run"}' if 'run_dir' in word else word for word in words]
    assert simulate.main(words[4:]) == 0
    assert signals_digest(RecordedRun.open(tmp_path / 'run')) == table['digest'][int(number)]


def test_a_command_works_from_anywhere(tmp_path, monkeypatch):
    """Also if the campaign was started with relative names, of its own folder and of the files of parameters."""
    (tmp_path / 'start here').mkdir()
    (tmp_path / 'elsewhere').mkdir()
    monkeypatch.chdir(tmp_path / 'start here')
    Path('shaken.csv').write_text('0.0,1.0\n0.02,3.0\n0.05,-2.0\n')
    spec = {
        **SPEC,
        'name': 'relative',
        'set': {
            'deterministic_timer:duration': 0.05,
            'disturbance_generator:vibration.linear.enabled': True,
            'disturbance_generator:vibration.linear.kind': 'recording',
            'disturbance_generator:vibration.linear.recording': 'shaken.csv',
        },
        'controllers': ['pid'],
        'vary': [],
    }
    campaign = Campaign(spec)
    table = campaign.run('out')
    assert table['status'].tolist() == ['finished'], table['reason'].tolist()
    page = write_page(campaign, table, Path('out')).read_text('utf8')
    (command,) = re.findall(r'<td class="text">(cd [^<]*)</td></tr>', page)
    script = html.unescape(command).replace(
        'ros2 run hdd_servo_ros simulate', f'{sys.executable} -m {simulate.__name__}'
    )
    environment = {**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])}
    subprocess.run(script, shell=True, check=True, cwd=tmp_path / 'elsewhere', env=environment, capture_output=True)
    (found,) = re.findall(r'<code>(ros2 run [^<]*) RUN_DIR</code>', page)
    arguments = shlex.split(html.unescape(found))[4:]
    monkeypatch.chdir(tmp_path / 'elsewhere')
    assert campaign_main.main([*arguments, str(tmp_path / 'start here' / 'runs' / 'relative-000000')]) == 0


def test_runs_that_did_not_finish_do_not_hide_the_worst_ones(tmp_path):
    vary = [{'pid_controller:proportional_gain': [*(-1.0 - index for index in range(11)), 0.05, 0.04]}]
    campaign = Campaign({**SPEC, 'controllers': ['pid'], 'vary': vary, 'keep': {'worst': 1}})
    table = campaign.run(tmp_path)
    page = write_page(campaign, table, tmp_path).read_text('utf8')
    rows = re.findall(r'<tr><td>(\d+)</td>.*?<td class="text">cd ', page)
    worst = [12, 11] if table['rms_error'][12] > table['rms_error'][11] else [11, 12]
    assert [int(number) for number in rows] == [*range(10), *worst]
    # What was rejected cannot be recorded.
    assert [path.name for path in (tmp_path / 'runs').iterdir()] == [f'{worst[0]:06d}']


def test_where_no_run_has_a_metric_those_that_failed_come_first(tmp_path):
    campaign = Campaign({**SPEC, 'controllers': ['pid'], 'set': {'vcm_plant:gain': 1.0}, 'vary': [], 'seeds': [1, 2]})
    table = Table(
        {
            'run': [0, 1],
            'controller': ['pid', 'pid'],
            'status': ['finished', 'failed'],
            'reason': ['', 'no such thing'],
            'verdict': ['', ''],
            'last_tick': [3, -1],
            'digest': ['a', ''],
        }
    )
    page = write_page(campaign, table, tmp_path).read_text('utf8')
    rows = re.findall(r'<tr><td>(\d+)</td>.*?<td class="text">no such thing</td><td class="text">cd ', page)
    assert rows == ['1']
    assert 'no run has a metric' in page
