"""The tutorial: its code is the example's file, and its commands run."""

import re
import shlex
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run

ROOT = Path(__file__).parent.parent
DOCUMENT = (ROOT / 'docs' / 'tutorial-own-controller.md').read_text('utf8')
EXAMPLE = ROOT / 'examples' / 'my_controller.py'
PATH = 'my_controller:MyController'
PARAMS = ROOT / 'params' / 'seagate_7200_10.yaml'
COMMANDS = [
    line
    for block in re.findall(r'```bash\n(.*?)```', DOCUMENT, re.DOTALL)
    for line in block.splitlines()
    if not line.startswith('ros2 param')
]


def test_the_code_is_the_file():
    assert EXAMPLE.read_text('utf8') in re.findall(r'```python\n(.*?)```', DOCUMENT, re.DOTALL)


def test_its_class_is_short():
    lines = [line for line in EXAMPLE.read_text('utf8').splitlines() if line.strip() and '"""' not in line]
    assert len(lines) <= 25


def test_it_tracks_alike_with_another_sensor(bench):
    """Its error is that of the loop, whatever a volt of the sensor stands for."""
    shutil.copy(EXAMPLE, bench.directory)
    sensors = {'usual': (), 'other': ('ldv_sensor:displacement_scale:=4.0', 'ldv_sensor:velocity_scale:=2000.0')}
    found = {}
    for name, values in sensors.items():
        given = [word for value in values for word in ('-p', value)]
        run = ('-p', f'controller:={PATH}', '-p', f'run_dir:={name}', '-p', 'duration:=0.5', '-p', 'plot:=false')
        bench.run('simulate', *run, *given)
        signals = Run.open(bench.directory / name)
        found[name] = np.sqrt(np.mean(signals.error[signals.since(0.1)] ** 2))
    assert found['other'] == pytest.approx(found['usual'], rel=0.02)
    assert found['usual'] < 0.05


@pytest.mark.parametrize('command', COMMANDS)
def test_command(bench, command):
    shutil.copy(EXAMPLE, bench.directory)
    words = [str(PARAMS) if word == 'PARAMS' else word for word in shlex.split(command)]
    program: str | list[str] = words[:2]
    arguments = words[2:]
    if words[:3] == ['ros2', 'run', 'hdd_servo_ros']:
        program, arguments = words[3], words[4:]
    if program == 'compare':
        # Through the graph it has a test of its own, as each run takes seconds to start.
        short = ['-p', 'duration:=0.04', '--without-ros']
        if '--params-file' not in arguments and '--experiments' not in arguments:
            short += ['--experiments', 'sine_100_hz']
        answer = bench.python('-m', 'hdd_servo_ros.studies.compare', *arguments, *short)
        assert answer.returncode == 0, answer.stderr
        assert (bench.directory / 'runs' / 'compare-without-ros' / 'compare.png').exists()
    elif program == 'report':
        for run in arguments:
            controller = PATH if run.endswith('my_controller') else 'pid'
            bench.run('simulate', '-p', f'controller:={controller}', '-p', f'run_dir:={run}', '-p', 'duration:=0.1')
        answer = bench.python('-m', 'hdd_servo_ros.tools.report', *arguments)
        assert answer.returncode == 0, answer.stderr
        assert (bench.directory / arguments[1] / 'report.html').exists()
    elif program in ('rig', 'simulate'):
        process = bench.start(program, *arguments[1:], '-p', 'duration:=0.02', '-p', 'rate:=0.0', defaults=False)
        assert process.wait() == 0, process.output
        assert 'controller  my_controller, drive seagate_7200_10' in process.output
    elif '--help' in arguments:
        assert program[0] == 'python'
        assert 'parameters of my_controller' in bench.python(*program[1:], *arguments).stdout
    else:
        # A node alone: it comes as far as waiting for the others.
        own = ['-m', 'hdd_servo_ros.nodes.outside_controller'] if program == 'outside_controller' else program[1:]
        process = bench.start_python('my_controller', *own, *arguments)
        process.wait_for('[my_controller]: waiting for deterministic_timer')
        process.signal(signal.SIGINT)
        assert process.wait() == 130
