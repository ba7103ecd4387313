"""The commands in the documents run, and what they name exists."""

import configparser
import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from hdd_servo_ros.graph.catalog import EXECUTABLES, executable_module, names_with_parameters

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / 'hdd_servo_ros'
DOCUMENTS = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
TEXTS = [*DOCUMENTS, *sorted((ROOT / 'params').glob('*.yaml')), *sorted((ROOT / 'hdd_servo_ros').rglob('*.py'))]
"""Whatever may tell a user to run a command."""


MODULES = {name: executable_module(name) for name in EXECUTABLES}
SOURCES = {
    path.name
    for folder in ('hdd_servo_ros', 'test', 'examples', 'benchmarks', 'faults', 'launch')
    for path in (ROOT / folder).rglob('*.py')
} | {path.name for path in ROOT.glob('*.py')}
FOLDERS_OF_RUNS = ('runs/', 'RUN/', 'bag/')
OWN_TEST = ('tutorial-own-controller', 'tutorial-own-drive', 'tutorial-first-hour')
"""Documents whose commands have a test of their own."""
BLOCKS = [
    pytest.param(block, id=f'{document.stem}-{number}')
    for document in DOCUMENTS
    if document.stem not in OWN_TEST
    for number, block in enumerate(re.findall(r'```bash\n(.*?)```', document.read_text('utf8'), re.DOTALL))
]

SHORT_SWEEP = ('-p', 'start_frequency:=19000.0', '-p', 'integrate_time:=0.001', '-p', 'settle_time:=0.001')
"""A sweep takes as long as its plan says."""


def commands(block):
    return [shlex.split(line, comments=True) for line in block.splitlines() if shlex.split(line, comments=True)]


def assert_options_exist(bench, name, arguments):
    """Check that a command of the package has a help, which names every option given."""
    answer = bench.python('-m', f'hdd_servo_ros.{MODULES[name]}', '--help')
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith(f'usage: {name} ')
    for option in (word for word in arguments if word.startswith('--')):
        assert re.search(rf'(^|[\s\[,]){option}\b', answer.stdout), (name, option)


def record_disturbed(bench, *names):
    """Record a run with a disturbance under each name, where there is none."""
    for name in names:
        if not (bench.directory / name).exists():
            # A copy starts so fast that it may come before its readers, or after the run has begun.
            copies, bench.interpreters = bench.interpreters, None
            node = bench.start('disturbance', script=ROOT / 'examples' / 'disturbance_node.py')
            for process in [node, *bench.start_nodes(name, '-p', 'duration:=0.02').values()]:
                assert process.wait() == 0, process.output
            bench.interpreters = copies


def run_short_campaign(bench, arguments):
    """Run a campaign with a few short runs in place of many long ones."""
    spec = yaml.safe_load((ROOT / arguments[0]).read_text('utf8'))
    spec['set']['deterministic_timer:duration'] = 0.02
    for block in spec['vary']:
        block['runs'] = 2
    (bench.directory / 'short.yaml').write_text(yaml.safe_dump(spec))
    if '--dask' in arguments and importlib.util.find_spec('distributed') is None:
        pytest.skip('Dask is not installed')
    answer = bench.python('-m', 'hdd_servo_ros.campaign.main', 'short.yaml', *arguments[1:])
    assert answer.returncode == 0, answer.stderr
    assert 'table: ' in answer.stdout


def launch_arguments(file):
    """Return the names of the arguments that a launch file declares."""
    texts = [(ROOT / 'launch' / file).read_text(), (ROOT / 'hdd_servo_ros' / 'graph' / 'launching.py').read_text()]
    return set(re.findall(r"DeclareLaunchArgument\(\s*'(\w+)'", ''.join(texts)))


@pytest.mark.parametrize('block', BLOCKS)
def test_commands(bench, block):
    """The `ros2 run` of a block together, shortened; of the others, that they would run."""
    started: list[Any] = []
    reported: set[str] = set()
    for command in commands(block):
        if command[:3] == ['ros2', 'run', 'hdd_servo_ros']:
            name, arguments = command[3], command[4:]
            if name == 'study':
                assert bench.python('-m', 'hdd_servo_ros.studies.main', *arguments, '--list').returncode == 0, command
                continue
            if name == 'report':
                # On runs of the names that the document gives.
                for word in {word for word in arguments if word.startswith('runs/')} - reported:
                    reported.add(word)
                    bench.run('simulate', '-p', f'run_dir:={word}', '-p', 'duration:=0.02', '-p', 'plot:=false')
                answer = bench.python('-m', 'hdd_servo_ros.tools.report', *arguments)
                assert answer.returncode == 0, answer.stderr
                continue
            if name == 'campaign' and '--check' not in arguments:
                run_short_campaign(bench, arguments)
                continue
            if '--ros-args' not in arguments:
                assert_options_exist(bench, name, arguments)
                continue
            paths = [str(ROOT / word) if word.startswith('params/') else word for word in arguments]
            assert paths.pop(0) == '--ros-args'
            for word in arguments:
                record_disturbed(bench, *re.findall(r'recorded_run:=(.+)', word))
            shortened = SHORT_SWEEP if 'params/swept_sine.yaml' in arguments else short(paths)
            started.append(bench.start(name, *paths, *shortened, '-p', 'plot:=false', defaults=False))
        elif command[0] == 'make':
            # With PYTHON given it need not look for a suitable one.
            shown = ['make', '-n', f'PYTHON={sys.executable}', *command[1:]]
            assert subprocess.run(shown, cwd=ROOT, capture_output=True).returncode == 0, command
        elif command[:3] == ['ros2', 'launch', 'hdd_servo_ros']:
            # test_ros2_command.py runs it, where there is a `ros2`.
            assert {word.partition(':=')[0] for word in command[4:]} <= launch_arguments(command[3]), command
        elif command[:2] == ['python', '-m']:
            assert bench.python('-m', command[2], '--help').returncode == 0, command
        else:
            pytest.fail(f'a command that no test knows how to run: {command}')
    for process in started:
        assert process.wait() == 0, process.output


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda document: document.stem)
def test_executables_and_targets_that_the_text_names_exist(bench, document):
    text = document.read_text('utf8')
    for name, arguments in set(re.findall(r'`ros2 run hdd_servo_ros ([a-z]\w+)([^`]*)`', text)):
        assert_options_exist(bench, name, arguments.split())
    for target in set(re.findall(r'`make (\w+)`', text)):
        assert re.search(rf'^{target}:', (ROOT / 'Makefile').read_text(), re.MULTILINE), target


@pytest.mark.parametrize('path', TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_commands_that_a_text_names_are_executables(path):
    text = path.read_text('utf8')
    assert set(re.findall(r'ros2 run hdd_servo_ros ([a-z]\w*)', text)) <= MODULES.keys()
    # What a user runs is an executable; `make docs` alone runs a module.
    assert set(re.findall(r'python -m\s+hdd_servo_ros\.([\w.]+)', text)) <= {'graph.manual'}


def short(arguments):
    """Return the arguments for 200 ticks at the sample time that the parameter files give."""
    sample_time = 1e-4
    for word in arguments:
        if word.endswith('.yaml'):
            timer = yaml.safe_load(Path(word).read_text()).get('/**/deterministic_timer', {'ros__parameters': {}})
            sample_time = timer['ros__parameters'].get('sample_time', sample_time)
    return '-p', f'duration:={200 * sample_time!r}'


@pytest.mark.parametrize('path', TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_source_files_that_a_text_names_exist(path):
    text = path.read_text('utf8')
    # Scripts that a reader saves from the text begin with their names.
    own = set(re.findall(r'^```python\n# (\w+\.py)$', text, re.MULTILINE))
    # A name alone is that of a file somewhere; a path begins at the root, in the package or beside the text.
    for name in set(re.findall(r'(?<![\w./*<{-])(?:[\w.-]+/)*\w+\.py\b', text)) - own:
        if '/' in name:
            assert any((base / name).is_file() for base in (ROOT, PACKAGE, path.parent)), name
        else:
            assert name in SOURCES, name
    # Folders with the slash after them, as the documents write them: `control/`, `drive/friction/`.
    for name in set(re.findall(r'`((?:\w+/)+)`', text)):
        is_there = any((base / name).is_dir() for base in (ROOT, PACKAGE, path.parent))
        assert is_there or name.startswith(FOLDERS_OF_RUNS), name


@pytest.mark.parametrize('path', TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_modules_that_a_text_names_exist(path):
    for name in set(re.findall(r'\bhdd_servo_ros((?:\.\w+)+)', path.read_text('utf8'))):
        assert is_in_package(name.strip('.').split('.')), name


def is_in_package(parts):
    """Return whether dotted names lead to a module, or to what a module's text names."""
    folder = PACKAGE
    for number, part in enumerate(parts):
        if (folder / part).is_dir():
            folder = folder / part
            continue
        module = folder / f'{part}.py'
        rest = parts[number + 1 :] if module.is_file() else parts[number:]
        text = (module if module.is_file() else folder / '__init__.py').read_text('utf8')
        return all(re.search(rf'\b{name}\b', text) for name in rest)
    return True


def table_rows(document, header):
    """Return the first cell of each row of a document's table with this header, as the names that it holds."""
    table = document.read_text('utf8').partition(f'\n{header}\n')[2].partition('\n\n')[0]
    return [re.findall(r'`(.+?)`', line.split('|')[1]) for line in table.splitlines()[1:]]


def test_contributing_lists_the_layers_of_the_contract_and_every_folder():
    contract = configparser.ConfigParser()
    contract.read(ROOT / '.importlinter')
    layers = [set(re.findall(r'\w+', line)) for line in contract['importlinter:contract:floors']['layers'].split('\n')]
    listed = [set(names) for names in table_rows(ROOT / 'CONTRIBUTING.md', '| layer | holds |')]
    assert listed == [names for names in layers if names]
    folders = {path.parent.name for path in PACKAGE.glob('*/__init__.py')}
    modules = {path.stem for path in PACKAGE.glob('*.py')} - {'__init__'}
    assert set.union(*listed) == folders | modules


@pytest.mark.parametrize('name', names_with_parameters())
def test_every_executable_has_a_help(bench, name):
    module = f'hdd_servo_ros.{executable_module(name)}'
    answer = bench.python('-m', module, '--help')
    assert answer.returncode == 0
    assert f'parameters of {name}' in answer.stdout
    assert bench.python('-m', module, '--nonsense').returncode == 2
