"""The tutorial on an own drive: its files, commands and script, as printed and in the same order."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import executable_module

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs' / 'tutorial-own-drive.md').read_text('utf8')
BLOCKS = re.findall(r'```(\w+)\n(.*?)```', PAGE, re.DOTALL)
FILES = ['my_drive.yaml', 'gains.yaml']
SLOW = ('tune',)
"""Commands that take too long here and have their own tests."""


def test_tutorial(bench):
    (bench.directory / 'params').symlink_to(ROOT / 'params')
    files = iter(FILES)
    printed = ''
    for kind, block in BLOCKS:
        if kind == 'yaml':
            (bench.directory / next(files)).write_text(block)
        elif kind == 'python':
            (bench.directory / 'script.py').write_text(block)
            ended = bench.python('script.py')
            assert ended.returncode == 0, ended.stderr
            printed = ended.stdout
        elif kind == 'bash':
            for line in block.splitlines():
                ros2, run, package, name, *arguments = shlex.split(line)
                assert (ros2, run, package) == ('ros2', 'run', 'hdd_servo_ros')
                if name in SLOW:
                    continue
                plot = ('-p', 'plot:=false') if '--ros-args' in arguments else ()
                ended = bench.python('-m', f'hdd_servo_ros.{executable_module(name)}', *arguments, *plot)
                assert ended.returncode == 0, (line, ended.stderr)
                printed = ended.stdout
        else:
            for shown in block.splitlines():
                assert shown.split() in [line.split() for line in printed.splitlines()], printed
    identified = yaml.safe_load((bench.directory / 'identified.yaml').read_text())['/**/vcm_plant']['ros__parameters']
    assert identified['gain'] == pytest.approx(3e7, rel=0.01)
    assert identified['resonance.frequencies'] == pytest.approx([4200.0, 9100.0], rel=0.001)
    assert identified['resonance.damping_ratios'] == pytest.approx([0.015, 0.02], rel=0.02)
    tuned = Run.open(bench.directory / 'runs' / 'tuned')
    assert tuned.frame_id == 'my_drive'
    assert abs(tuned.error[tuned.time > 0.2]).max() < 0.3
