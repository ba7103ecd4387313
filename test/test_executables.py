"""Every executable is an entry point that an interrupt ends quietly, from its first import on."""

import distutils.core
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hdd_servo_ros.graph.catalog import EXECUTABLES, executable_module
from hdd_servo_ros.studies import main as study

ROOT = Path(__file__).parents[1]


def entry_points():
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        # It is setuptools' own kind, which knows entry points.
        distribution: Any = distutils.core.run_setup('setup.py', stop_after='init')
    return dict(script.split(' = ') for script in distribution.entry_points['console_scripts'])


def test_every_entry_point_leads_to_a_main():
    for name, target in entry_points().items():
        module, _, attribute = target.partition(':')
        run = getattr(importlib.import_module(module), attribute)
        assert run.args == (name,)
        target_module = executable_module(name)
        assert callable(importlib.import_module(f'hdd_servo_ros.{target_module}').main), name
        assert target_module.rsplit('.', 1)[-1] in (name, 'main')
    assert entry_points().keys() == set(EXECUTABLES)
    assert {'rig', 'simulate', 'scope', 'study', 'vcm_plant'} <= entry_points().keys()


COMMANDS = (
    'campaign',
    'compare_bags',
    'drive_response',
    'friction_curves',
    'identify',
    'instruments',
    'stability_certificate',
    'swept_sine',
    'tune',
)


def run(name, *arguments):
    """Run the script that pip or colcon makes of an entry point."""
    code = f'import sys; from hdd_servo_ros.executables import {name}; sys.exit({name}())'
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    return subprocess.run(
        [sys.executable, '-c', code, *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=250,
    )


def run_copy(bench, name, *arguments):
    """Run an entry point in the folder of the bench, in a copy of its prepared process."""
    code = f'import sys; from hdd_servo_ros.executables import {name}; sys.exit({name}())'
    (bench.directory / 'command.py').write_text(code)
    return bench.python('command.py', *arguments)


@pytest.mark.parametrize('name', COMMANDS)
def test_a_command_is_an_executable_with_a_help(name):
    assert name in entry_points()
    ended = run(name, '--help')
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith(f'usage: {name} ')
    assert 'Exit code: 0' in ended.stdout


@pytest.mark.parametrize('name', [*COMMANDS, 'simulate', 'scope'])
def test_a_wrong_option_is_one_line_with_a_hint(name, capsys):
    main = importlib.import_module(f'hdd_servo_ros.{executable_module(name)}').main
    with pytest.raises(SystemExit) as ended:
        main(['--nonsense'])
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert not said.out
    (line,) = said.err.splitlines()
    assert line.startswith(f'{name}: ')
    assert line.endswith(f'; see {name} --help')


def test_a_wrong_option_of_a_subcommand_is_one_line(capsys):
    with pytest.raises(SystemExit):
        study.main(['chapter5', '--nonsense', 'x'])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('study')


@pytest.mark.parametrize(
    ('name', 'arguments', 'code'),
    [
        ('compare_bags', ('nowhere', 'nowhere'), 3),
        ('compare_bags', ('nowhere',), 2),
        ('drive_response', ('--nonsense',), 2),
        ('friction_curves', ('--nonsense',), 2),
        ('identify', ('nowhere.csv',), 3),
        ('instruments', ('--params-file', 'nowhere.yaml'), 2),
        ('instruments', ('--seconds', '2'), 2),
        ('instruments', ('--sample-time', '0'), 2),
        ('recover', ('nowhere',), 3),
        ('replay', ('nowhere',), 3),
        ('report', ('nowhere',), 3),
        ('stability_certificate', ('nowhere',), 3),
        ('swept_sine', ('nowhere',), 3),
        ('tune', ('--params-file', 'nowhere.yaml'), 2),
    ],
)
def test_a_command_with_invalid_arguments_ends_with_its_code(bench, name, arguments, code):
    ended = run_copy(bench, name, *arguments)
    assert ended.returncode == code
    assert 'Traceback' not in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith(f'{name}: ')


@pytest.mark.parametrize('name', ['drive_response', 'friction_curves'])
def test_plots_that_cannot_be_written_end_with_1(bench, name):
    (bench.directory / 'file').touch()
    ended = run_copy(bench, name, 'file/plots')
    assert (ended.returncode, ended.stdout) == (1, '')
    assert ended.stderr.startswith(f'{name}: ')
    assert 'Traceback' not in ended.stderr


INTERRUPTED = """
import signal, sys

# A shell that starts the tests in the background has it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

class Interrupt:
    def find_spec(name, *_):
        if name == 'hdd_servo_ros.graph.catalog':
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupt)
from hdd_servo_ros.executables import rig
sys.exit(rig())
"""
"""The script that pip or colcon makes of the entry point, with an interrupt amid the imports of it."""


def test_an_interrupt_while_it_is_imported():
    ended = subprocess.run([sys.executable, '-c', INTERRUPTED], cwd=ROOT, capture_output=True, text=True, timeout=250)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, '', '')


@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM', 'SIGHUP'])
def test_a_signal_while_it_ends(name):
    """As from a launch file of which another process has just been rejected."""
    code = 'import atexit, signal, sys; from hdd_servo_ros.executables import recover; '
    code += f'atexit.register(signal.raise_signal, signal.{name}); sys.exit(recover())'
    ended = subprocess.run(
        [sys.executable, '-c', code, 'nowhere'], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 3
    assert ended.stderr.startswith('recover: nowhere is not a run folder')
    assert 'Traceback' not in ended.stderr
