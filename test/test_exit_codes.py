"""Bad input ends every command in one line that names it, and in the exit code that is documented; no traceback."""

import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hdd_servo_ros.analysis import identify
from hdd_servo_ros.graph.help import COMPILING
from hdd_servo_ros.messages.exit_codes import FAILED, UNREADABLE, WRONG_ARGUMENTS, guard, reading
from hdd_servo_ros.recording import compare_bags
from hdd_servo_ros.simulation import simulate
from hdd_servo_ros.studies import compare, instruments, stability_certificate, swept_sine, tune
from hdd_servo_ros.tools import recover, replay, report

ROOT = Path(__file__).parents[1]

READERS = {
    'report': lambda run: report.main([run, '--output', f'{run}-report']),
    'compare_bags': lambda run: compare_bags.main([run, run]),
    'replay': lambda run: replay.main(['--without-ros', run]),
    'recover': lambda run: recover.main(['--dry-run', run]),
    'swept_sine': lambda run: swept_sine.main([run]),
    'stability_certificate': lambda run: stability_certificate.main([run]),
}
"""Commands that read a recorded run."""


def _nested(depth):
    return '[' * depth + ']' * depth


def _bomb():
    return 'a: &a [x, x]\n' + ''.join(f'{b}: &{b} [*{a}, *{a}, *{a}]\n' for a, b in itertools.pairwise('abcdefghi'))


DESCRIPTIONS = {
    'a list': '- 1\n',
    'a word': 'run\n',
    'nothing': '',
    'latin-1': 'frame_id: é\n'.encode('latin-1'),
    'utf-16': 'status: finished\n'.encode('utf-16'),
    'nul': b'status: fin\0ished\n',
    'a date that is none': 'status: 2001-99-99\n',
    'a binary number without digits': 'last_tick: 0b_\n',
    'many digits': f'last_tick: {"9" * 5000}\n',
    'nested': f'status: {_nested(2000)}\n',
    'aliases of aliases': f'{_bomb()}status: *i\n',
    'a tag': 'status: !!python/object/apply:os.system [exit]\n',
    'topics': 'status: finished\nlast_tick: 5\nsample_time: 0.0001\nnodes: {}\ntopics: [1]\n',
    'nodes': 'status: finished\nlast_tick: 5\nsample_time: 0.0001\nnodes: {/a: 3}\ntopics: {clock: /clock}\n',
    'sample time': 'status: finished\nlast_tick: 5\nsample_time: .nan\nnodes: {}\ntopics: {clock: /clock}\n',
}
"""Contents of run.yaml."""

METADATA = {
    'a list': '- 1\n',
    'nothing': '',
    'latin-1': 'é'.encode('latin-1'),
    'many digits': f'rosbag2_bagfile_information: {{version: {"9" * 5000}}}\n',
    'nested': f'rosbag2_bagfile_information: {_nested(2000)}\n',
    'a date that is none': 'rosbag2_bagfile_information: 2001-99-99\n',
    'a list inside': 'rosbag2_bagfile_information: [1, 2]\n',
}
"""Contents of the bag's metadata.yaml."""


@pytest.fixture(scope='module')
def run(simulated, tmp_path_factory):
    return simulated(tmp_path_factory.mktemp('run') / 'run', '-p', 'duration:=0.02', '-p', 'plot:=false')


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def expect_one_line(code, capsys, expected, *named):
    """Expect an exit code and one line that names what was wrong, and that was foreseen."""
    said = [line for line in capsys.readouterr().err.strip().splitlines() if COMPILING not in line]
    assert code == expected, said
    assert len(said) == 1, said
    assert 'Traceback' not in said[0]
    assert 'unexpected error' not in said[0]
    assert len(said[0]) < 1000
    for name in named:
        assert name in said[0]


@pytest.mark.parametrize('name', READERS)
@pytest.mark.parametrize('content', DESCRIPTIONS)
def test_a_description_that_is_none(run, tmp_path, capsys, name, content):
    shutil.copytree(run, tmp_path / 'run')
    write(tmp_path / 'run' / 'run.yaml', DESCRIPTIONS[content])
    code = READERS[name](str(tmp_path / 'run'))
    if name in ('compare_bags', 'recover') and code == 0:
        return  # The one does not need what is missing, and the other writes it anew.
    expect_one_line(code, capsys, UNREADABLE, 'run')


@pytest.mark.parametrize('name', [name for name in READERS if name != 'recover'])
@pytest.mark.parametrize('content', METADATA)
def test_metadata_that_is_none(run, tmp_path, capsys, name, content):
    shutil.copytree(run, tmp_path / 'run')
    write(tmp_path / 'run' / 'bag' / 'metadata.yaml', METADATA[content])
    code = READERS[name](str(tmp_path / 'run'))
    expect_one_line(code, capsys, UNREADABLE, str(tmp_path))


@pytest.mark.parametrize('name', READERS)
def test_what_is_not_there(tmp_path, capsys, name):
    code = READERS[name](str(tmp_path / 'nowhere'))
    expect_one_line(code, capsys, UNREADABLE, 'nowhere')


@pytest.mark.parametrize('name', [name for name in READERS if name != 'recover'])
def test_a_run_that_is_a_file(run, capsys, name):
    code = READERS[name](str(run / 'run.yaml'))
    expect_one_line(code, capsys, UNREADABLE, 'run.yaml')


PARAMETER_FILES = {
    'latin-1': '# fréquence\n'.encode('latin-1'),
    'a date that is none': 'vcm_plant:\n  ros__parameters:\n    gain: 2001-99-99\n',
    'a list of parameters': 'vcm_plant:\n  ros__parameters: [1, 2]\n',
    'nested': f'vcm_plant:\n  ros__parameters:\n    gain: {_nested(2000)}\n',
    'aliases of aliases': _bomb(),
    'many digits': f'vcm_plant:\n  ros__parameters:\n    gain: {"9" * 5000}\n',
    'nul': b'vcm_plant:\n  ros__parameters:\n    gain: \0\n',
    'a binary number without digits': 'vcm_plant:\n  ros__parameters:\n    gain: 0b_\n',
}

TAKERS = {
    'simulate': lambda file: simulate.main(['--ros-args', '--params-file', file, '-p', 'record:=false']),
    'instruments': lambda file: instruments.main(['--params-file', file]),
    'tune': lambda file: tune.main(['--params-file', file]),
    'compare': lambda file: compare.main(['--without-ros', '--params-file', file, '--output', f'{file}-out']),
}
"""Commands that take parameter files; `test/system/test_ros_arguments.py` has the nodes."""


@pytest.mark.parametrize('name', TAKERS)
@pytest.mark.parametrize('content', PARAMETER_FILES)
def test_a_parameter_file_that_is_none(tmp_path, capsys, name, content):
    write(tmp_path / 'file.yaml', PARAMETER_FILES[content])
    code = TAKERS[name](str(tmp_path / 'file.yaml'))
    expect_one_line(code, capsys, WRONG_ARGUMENTS)


@pytest.mark.parametrize('path', ['missing.yaml', '.', 'a\0b'])
@pytest.mark.parametrize('name', TAKERS)
def test_a_parameter_file_that_cannot_be_read(capsys, name, path):
    expect_one_line(TAKERS[name](path), capsys, WRONG_ARGUMENTS, 'parameter file')


@pytest.mark.parametrize(
    'content', ['', 'a,b\n', b'\xff\xfe', '1,2,3\n' + '9' * 5000 + ',x,1\n', b'\0\0\0', _nested(500)]
)
def test_a_response_that_is_none(tmp_path, capsys, content):
    write(tmp_path / 'response.csv', content)
    expect_one_line(identify.main([str(tmp_path / 'response.csv')]), capsys, UNREADABLE, 'response.csv')


@pytest.mark.parametrize(
    ('error', 'code', 'words'),
    [
        (KeyError('topics'), FAILED, 'unexpected error: KeyError: topics'),
        (OSError(28, 'No space left on device', 'run.yaml'), FAILED, 'run.yaml: No space left on device'),
        (MemoryError(), FAILED, 'out of memory'),
        (FileExistsError('run exists'), WRONG_ARGUMENTS, 'run exists'),
        (RecursionError('too deep\nindeed'), FAILED, 'RecursionError: too deep indeed'),
    ],
)
def test_each_kind_of_error_has_its_code(capsys, error, code, words):
    def work():
        raise error

    assert guard('command', work) == code
    said = capsys.readouterr().err
    assert said.startswith('command: ')
    assert words in said
    assert len(said.splitlines()) == 1


def test_what_a_recording_leads_to_is_an_error_of_the_recording(capsys):
    def work():
        with reading(Path('run')):
            return len(dict[str, str]()['topics'])

    assert guard('command', work, UNREADABLE) == UNREADABLE
    assert 'run: cannot be read: KeyError: topics' in capsys.readouterr().err


# Processes with an environment of their own.

RUN = """
import sys
from hdd_servo_ros import executables
sys.exit(getattr(executables, sys.argv.pop(1))())
"""


def started(name, *arguments, cwd, stdout=subprocess.PIPE, **environment):
    """Run an executable in a new interpreter; a variable that is None is taken out of its environment."""
    variables = {**os.environ, 'PYTHONPATH': str(ROOT), **environment}
    return subprocess.run(
        [sys.executable, '-c', RUN, name, *arguments],
        cwd=cwd,
        env={key: value for key, value in variables.items() if value is not None},
        stdout=stdout,
        stderr=subprocess.PIPE,
        timeout=300,
    )


def test_the_callers_matplotlib_does_not_reach_in(run, tmp_path):
    """A notebook's backend, and a matplotlibrc in the working folder that asks for LaTeX: the same picture."""
    (tmp_path / 'usetex').mkdir()
    (tmp_path / 'usetex' / 'matplotlibrc').write_text('text.usetex: True\nlines.linewidth: 9\n')
    (tmp_path / 'none').mkdir()
    (tmp_path / 'none' / 'matplotlibrc').write_bytes(b'\xff\xfe: 1\n')
    pictures: list[bytes] = []
    for folder, backend in (('.', None), ('usetex', 'module://matplotlib_inline.backend_inline'), ('none', 'bogus')):
        out = tmp_path / f'out-{len(pictures)}'
        ended = started('report', str(run), '--output', str(out), cwd=tmp_path / folder, MPLBACKEND=backend)
        assert ended.returncode == 0, ended.stderr
        assert ended.stderr == b''
        pictures.append((out / 'report.png').read_bytes())
    assert len(set(pictures)) == 1


@pytest.mark.parametrize(
    'environment',
    [
        {'HOME': None, 'XDG_CACHE_HOME': None},
        {'HOME': '/dev/null', 'XDG_CACHE_HOME': '/dev/null/cache'},
        {'LANG': 'C', 'LC_ALL': 'C', 'PYTHONIOENCODING': 'ascii', 'PYTHONUTF8': '0'},
        {'NUMBA_CACHE_DIR': '/dev/null/numba', 'MPLCONFIGDIR': '/dev/null/matplotlib'},
        {'MPLCONFIGDIR': '/proc/nope'},
    ],
    ids=['no home', 'no folder for caches', 'ASCII', 'no folder for Numba', 'no folder for matplotlib'],
)
def test_no_environment_ends_in_a_traceback(tmp_path, environment):
    arguments = ('--ros-args', '-p', 'duration:=0.002', '-p', 'run_dir:=run')
    ended = started('simulate', *arguments, cwd=tmp_path, **environment)
    assert ended.returncode == 0, ended.stderr
    assert b'Traceback' not in ended.stderr
    others = [line for line in ended.stderr.splitlines() if line.strip() and not line.startswith(b'simulate')]
    assert not others


def test_a_folder_whose_name_is_not_utf_8(run, tmp_path):
    folder = os.fsencode(tmp_path) + b'/r\xe9n'
    shutil.copytree(run, os.fsdecode(folder))
    for name in ('report', 'compare_bags', 'recover'):
        arguments = (folder, folder) if name == 'compare_bags' else (folder,)
        ended = started(name, *arguments, cwd=tmp_path)
        assert ended.returncode == 0, ended.stderr
        assert b'Traceback' not in ended.stderr
    ended = started('simulate', '--ros-args', '-p', b'run_dir:=' + folder, cwd=tmp_path)
    assert (ended.returncode, ended.stdout) == (2, b'')
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='there is no /dev/full')
def test_a_full_disk_is_a_failure(run, tmp_path):
    with Path('/dev/full').open('w') as full:
        ended = started('compare_bags', str(run), str(run), cwd=tmp_path, stdout=full)
    assert ended.returncode == FAILED
    assert ended.stderr.decode().splitlines() == ['compare_bags: [Errno 28] No space left on device']


def test_a_reader_that_has_seen_enough(run, tmp_path):
    read, write_end = os.pipe()
    os.close(read)
    ended = started('compare_bags', str(run), str(run), cwd=tmp_path, stdout=write_end)
    os.close(write_end)
    assert (ended.returncode, ended.stderr) == (0, b'')
