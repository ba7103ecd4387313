"""A campaign on a Dask cluster: the same table to the bit, also when a worker is killed on the way."""

import csv
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import yaml

from hdd_servo_ros.campaign import main as campaign_main
from hdd_servo_ros.campaign.campaign import Campaign

distributed = pytest.importorskip('distributed')

ROOT = Path(__file__).parents[2]
SPEC = {
    'name': 'clustered',
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 0.2},
    'controllers': ['adaptive_nn', 'pid'],
    'vary': [{'reference_generator:amplitude': {'linspace': [0.5, 2.5, 10]}}],
    'seeds': 2,
}


@pytest.fixture(scope='module')
def table():
    return Campaign(SPEC).run(workers=1)


@pytest.fixture(scope='module')
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


def test_the_table_is_the_same_when_a_worker_is_killed(table, cluster, tmp_path, monkeypatch):
    (tmp_path / 'spec.yaml').write_text(yaml.safe_dump(SPEC))
    results = tmp_path / 'out' / 'results.jsonl'
    killed = []

    def kill():
        """Kill one of two workers when some runs are made, and others are not."""
        with distributed.Client(cluster) as client:
            while not (results.exists() and results.read_bytes().count(b'\n') >= 3):
                threading.Event().wait(0.005)
            name, pid = next(iter(client.run(os.getpid).items()))
            made = results.read_bytes().count(b'\n')
            os.kill(pid, signal.SIGKILL)
            killed.append((name, made))

    killer = threading.Thread(target=kill)
    killer.start()
    code = campaign_main.main(
        [str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out'), '--scheduler', cluster.scheduler_address]
    )
    killer.join()
    assert code == 0
    ((_, made),) = killed
    assert made < 40
    assert (tmp_path / 'out' / 'table.csv').read_text() == table.csv()


def test_a_local_cluster_makes_the_same_table(table, tmp_path):
    (tmp_path / 'spec.yaml').write_text(yaml.safe_dump(SPEC))
    arguments = [str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out'), '--dask', '--workers', '2']
    assert campaign_main.main(arguments) == 0
    assert (tmp_path / 'out' / 'table.csv').read_text() == table.csv()


def test_metrics_of_a_users_file_are_found_by_the_workers(tmp_path):
    """By the variable that the processes of the cluster inherit."""
    (tmp_path / 'lab').mkdir()
    (tmp_path / 'lab' / 'lab_metrics.py').write_text('import os\n\ndef process(run):\n    return os.getpid()\n')
    (tmp_path / 'spec.yaml').write_text(yaml.safe_dump({**SPEC, 'metrics': ['rms_error', 'lab_metrics:process']}))
    command = [sys.executable, '-m', 'hdd_servo_ros.campaign.main', 'spec.yaml', '--output', 'out']
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join([str(ROOT), str(tmp_path / 'lab')])}
    done = subprocess.run(
        [*command, '--dask', '--workers', '2'],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / 'out' / 'table.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 40
    assert len({row['lab_metrics:process'] for row in rows}) == 2


def test_no_scheduler_is_one_line_and_exit_code_2(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('hdd_servo_ros.campaign.dask_cluster._PATIENCE', 0.5)
    (tmp_path / 'spec.yaml').write_text(yaml.safe_dump(SPEC))
    arguments = [str(tmp_path / 'spec.yaml'), '--output', str(tmp_path / 'out'), '--scheduler', 'tcp://127.0.0.1:1']
    assert campaign_main.main(arguments) == 2
    error = capsys.readouterr().err
    assert 'campaign: --scheduler tcp://127.0.0.1:1: no Dask scheduler responds there' in error.splitlines()[-1]
    assert not Path(tmp_path / 'out').exists()
