import subprocess
import sys

import pytest

import hdd_servo_ros
from hdd_servo_ros.recording import run_folder, run_recorder
from hdd_servo_ros.recording.run_folder import DescriptionError, RunFolder, default_run_directory, read_run_yaml
from hdd_servo_ros.recording.run_recorder import RunRecorder

PAIRS = list(zip('abcdefghi', 'bcdefghij', strict=True))


def test_opened_and_closed(tmp_path):
    folder = RunFolder(tmp_path / 'a' / 'run', {'nodes': {'/x': {'parameters': {'gains': (1.0, 2.0)}}}})
    opened = read_run_yaml(folder.directory)
    assert opened['status'] == 'running'
    assert opened['nodes']['/x']['parameters']['gains'] == [1.0, 2.0]
    assert opened['versions']['hdd_servo_ros'] == hdd_servo_ros.__version__
    folder.close('failed', 'because', 41, wall_time=1.5)
    closed = read_run_yaml(folder.directory)
    assert (closed['status'], closed['reason'], closed['last_tick'], closed['wall_time']) == (
        'failed',
        'because',
        41,
        1.5,
    )
    assert closed['ended']
    assert closed.keys() >= opened.keys()
    assert not list(folder.directory.glob('*.tmp'))


def test_never_overwritten(tmp_path):
    with pytest.raises(FileExistsError, match='a run is never overwritten'):
        RunFolder(tmp_path, {})


def test_default_names_do_not_collide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = set()
    for _ in range(5):
        directory = default_run_directory('pid')
        directory.mkdir(parents=True)
        names.add(directory.name)
    assert len(names) == 5
    assert all('-pid' in name for name in names)


def test_no_run_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match=r'is not a run folder: it has no run\.yaml'):
        read_run_yaml(tmp_path)


def test_another_checkout_is_not_ours(tmp_path, monkeypatch):
    subprocess.run(['git', 'init', '-q', str(tmp_path)], check=True)
    installed = tmp_path / 'run_folder.py'
    installed.write_text('')
    monkeypatch.setattr(run_folder, '__file__', str(installed))
    assert run_folder.git_revision() == 'unknown'


def test_recording_needs_no_ros():
    code = 'import hdd_servo_ros.simulation.simulate, sys; sys.exit(any(m.startswith("rcl") for m in sys.modules))'
    assert subprocess.run([sys.executable, '-c', code]).returncode == 0


def test_two_runs_that_start_at_once_get_a_folder_each(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = iter([tmp_path / 'a', tmp_path / 'a', tmp_path / 'b'])  # the other run was faster
    monkeypatch.setattr(run_recorder, 'default_run_directory', lambda controller: next(names))
    description = {'nodes': {}, 'sample_time': 1e-4}
    recorders = [RunRecorder('', 'mcap', [], description, separate_process=False) for _ in range(2)]
    assert [recorder.directory.name for recorder in recorders] == ['a', 'b']
    for recorder in recorders:
        recorder.finish('finished', '')


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('nodes: [1]', 'nodes is'),
        ('nodes: {/x: 3}', "nodes: '/x' is 3"),
        ('nodes: {/x: {parameters: [1]}}', 'parameters of /x is'),
        ('nodes: {/x: {outputs: /head}}', 'outputs of /x is'),
        ('status: frob', "status is 'frob'"),
        ('status: 3', 'status is 3'),
        (
            'a: &a [x,x,x,x,x,x,x,x,x,x]\n' + ''.join(f'{b}: &{b} [{",".join(10 * ["*" + a])}]\n' for a, b in PAIRS),
            'aliases',
        ),
        (100_000 * '[', 'nested more than'),
        ('when: 2001-13-45', 'cannot be read'),
    ],
)
def test_what_does_not_describe_a_run_is_rejected(tmp_path, text, why):
    (tmp_path / 'run.yaml').write_text(text)
    with pytest.raises(DescriptionError, match=why):
        read_run_yaml(tmp_path)
