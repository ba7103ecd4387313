"""The tutorial of the first hour: its files, commands and scripts in the order of the page, and what they print."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from hdd_servo_ros.graph.catalog import executable_module

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs' / 'tutorial-first-hour.md').read_text('utf8')
BLOCKS = [
    (kind, block)
    for kind, block in re.findall(r'^```(\w+)\n(.*?)^```', PAGE, re.DOTALL | re.MULTILINE)
    if kind != 'console'  # the clone, from an address that the page does not know
]
PROSE = re.sub(r'^```.*?^```', '', PAGE, flags=re.DOTALL | re.MULTILINE)
WITH_PLOT = 'runs/first'
"""The run whose summary the page shows whole; the plots of the others would take half of the test's time."""
EXIT_CODES = {'compare_bags runs/first runs/change': 1}
REAL_TIME_FACTOR = re.compile(r'(real-time factor +)[\d.]+')


def expanded(line):
    """Return the words of a command, those of `make` as its recipe has them."""
    if line.startswith('make '):
        # With PYTHON given it need not look for a suitable one.
        shown = ['make', '-n', f'PYTHON={sys.executable}', *shlex.split(line)[1:]]
        # Not as a part of the `make` that may have started the tests, which would add its options and lines.
        outside = {name: value for name, value in os.environ.items() if not name.startswith(('MAKE', 'MFLAGS'))}
        made = subprocess.run(shown, cwd=ROOT, env=outside, capture_output=True, text=True, check=True)
        recipe = made.stdout.splitlines()[-1]
        return shlex.split(recipe[recipe.index(' .venv/bin/') :])
    return shlex.split(line)


def run_command(bench, line):
    """Run a command of the page to its end; return what it prints and what it logs."""
    program, *arguments = expanded(line)
    if program == 'grep':
        ended = subprocess.run([program, *arguments], cwd=bench.directory, capture_output=True, text=True, check=False)
    elif program == '.venv/bin/python':
        ended = bench.python(*arguments)
    else:
        name = program.removeprefix('.venv/bin/')
        if '--ros-args' in arguments and f'run_dir:={WITH_PLOT}' not in arguments:
            arguments += ['-p', 'plot:=false']
        ended = bench.python('-m', f'hdd_servo_ros.{executable_module(name)}', *arguments)
    assert ended.returncode == EXIT_CODES.get(line.removeprefix('.venv/bin/'), 0), (line, ended.stderr)
    return ended.stdout, ended.stderr


def shows(block, printed):
    """Return whether a block is what was printed, `...` standing for lines that are left out."""
    lines = ['(?:.*\n)*' if line == '...' else re.escape(f'{line.rstrip()}\n') for line in block.splitlines()]
    return re.fullmatch(''.join(lines), ''.join(f'{line.rstrip()}\n' for line in printed.splitlines())) is not None


def without_pace(text):
    """Leave out the one number that depends on the machine."""
    return REAL_TIME_FACTOR.sub(r'\1N', text)


@pytest.fixture(scope='module')
def numbers_shown():
    """Return every number in the outputs that the page shows."""
    shown = ' '.join(block for kind, block in BLOCKS if kind == 'text')
    return set(re.findall(r'(?<![\w.])[\d.]+(?:e[+-]?\d+)?', shown))


def test_the_page_shows_what_its_commands_print(bench):
    (bench.directory / 'params').symlink_to(ROOT / 'params')
    printed = logged = ''
    for kind, block in BLOCKS:
        if kind in ('python', 'yaml'):
            (bench.directory / block.split()[1]).write_text(block, 'utf8')
        elif kind == 'bash':
            outputs = [run_command(bench, line) for line in block.splitlines()]
            printed, logged = (''.join(parts) for parts in zip(*outputs, strict=True))
        else:
            assert kind == 'text'
            block, printed, logged = map(without_pace, (block, printed, logged))
            assert shows(block, printed) or shows(block, logged), f'{block}\nis not\n{printed}\nnor\n{logged}'
    assert (bench.directory / 'look.png').stat().st_size > 10_000
    for folder, size in re.findall(r'\| `(runs/\w+)` \| ([\d.]+) \|', PROSE):
        written = sum(path.stat().st_size for path in (bench.directory / folder).rglob('*') if path.is_file())
        # A run's plot, which most runs of this test leave out, has up to 0.5 MB.
        assert written / 1e6 == pytest.approx(float(size), abs=0.5), folder


def test_every_result_in_the_text_is_in_an_output(numbers_shown):
    results = re.findall(r'([\d.]+) (?:nm|V)\b', PROSE)
    assert len(results) > 3
    given = {'10', '3'}  # the limit of the drive [V], the noise of the sensor [nm]
    assert set(results) - given <= numbers_shown


def test_a_block_shows_an_output_only_if_every_line_is_in_it():
    printed = 'a  1.0\nb\nc\n'
    assert shows('a  1.0\nb\nc\n', printed)
    assert shows('a  1.0\n...\nc\n', printed)
    assert shows('...\nb\n...\n', printed)
    for wrong in ('a  1.0\nb\n', 'a  1.1\nb\nc\n', '...\nd\n...\n', 'b\n...\n', ''):
        assert not shows(wrong, printed), wrong
