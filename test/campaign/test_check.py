"""A recorded run is found in the table of its campaign by its signals."""

import shutil

import pytest

from hdd_servo_ros.campaign import main as campaign_main
from hdd_servo_ros.campaign.campaign import Campaign

SPEC = {
    'name': 'checked',
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 0.02},
    'controllers': ['pid', {'name': 'same', 'controller': 'pid'}],
    'vary': [{'reference_generator:amplitude': [1.0, 2.0]}],
    'keep': 'all',
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp('campaign')
    Campaign(SPEC).run(made, workers=1)
    return made


def test_the_runs_with_the_same_signals_are_named(folder, capsys):
    assert campaign_main.main(['--check', str(folder), str(folder / 'runs' / '000002')]) == 0
    assert 'is bit-identical to runs 2, 3 of' in capsys.readouterr().out


def test_a_run_of_another_campaign_is_exit_code_1(folder, tmp_path, capsys):
    text = (folder / 'table.csv').read_text()
    (tmp_path / 'table.csv').write_text('\n'.join(text.splitlines()[:3]) + '\n')
    assert campaign_main.main(['--check', str(tmp_path), str(folder / 'runs' / '000003')]) == 1
    assert 'matches no run of' in capsys.readouterr().out


def test_what_cannot_be_read_is_one_line_and_exit_code_3(folder, tmp_path, capsys):
    assert campaign_main.main(['--check', str(tmp_path), str(folder / 'runs' / '000003')]) == 3
    shutil.copy(folder / 'campaign.yaml', tmp_path / 'table.csv')
    assert campaign_main.main(['--check', str(tmp_path), str(folder / 'runs' / '000003')]) == 3
    assert campaign_main.main(['--check', str(folder), str(tmp_path)]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert 'table.csv: No such file or directory; only a finished campaign has a table' in lines[0]
    assert 'table.csv is not the table of a campaign' in lines[1]
    assert 'is neither a run folder nor a closed bag' in lines[2]


@pytest.mark.parametrize('arguments', [[], ['spec.yaml', '--check', 'a', 'b']])
def test_either_a_specification_or_a_check_is_asked_for(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        campaign_main.main(arguments)
    assert 'give either SPEC.yaml, or --check DIR RUN_DIR' in capsys.readouterr().err
