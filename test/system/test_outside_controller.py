"""A controller from outside the package: in the rig, in a process of its own and in `simulate`, with the same bits."""

import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / 'examples' / 'my_controller.py'
PATH = 'my_controller:MyController'
SPRING = ('-p', 'spring:=0.01')
"""Of the node in whose process it is given: the others do not know a parameter of that name."""
SHORT = ('-p', 'deterministic_timer:duration:=0.1')
OTHERS = ('bag_recorder', 'ldv_sensor', 'vcm_plant', 'reference_generator', 'deterministic_timer')


@pytest.fixture
def example(bench):
    """Give a bench whose folder holds the example."""
    shutil.copy(EXAMPLE, bench.directory)
    return bench


def test_the_same_bits_everywhere(example):
    """With a change of a parameter at a tick, by schedule."""
    planned = (*SHORT, '-p', "deterministic_timer:schedule:=['0.05 my_controller spring 0.02']")
    simulated = example.start('simulate', *planned, *SPRING, '-p', f'controller:={PATH}', '-p', 'run_dir:=simulated')
    rig = example.start('rig', *planned, *SPRING, '-p', f'rig:controller:={PATH}', '-p', 'run_dir:=rig')
    for process in (simulated, rig):
        assert process.wait() == 0, process.output
    processes = list(example.start_nodes('processes', *planned, nodes=OTHERS).values())
    processes.append(example.start('my_controller', *SPRING, script=example.directory / 'my_controller.py'))
    for process in processes:
        assert process.wait() == 0, process.output
    for run in ('rig', 'processes'):
        difference = first_difference(example.directory / 'simulated', example.directory / run)
        assert difference is None, difference
        content = example.run_yaml(run)
        assert content['controller'] == 'my_controller'
        assert content['controller_class'] == PATH
        assert content['nodes']['/my_controller']['parameters']['spring'] == 0.01
    signals = Run.open(example.directory / 'rig')
    left = signals.control[:, 0] + 4.0 * signals.ldv[:, 0] - 0.5 * signals.reference[:, 0]
    left += 9.7e-5 * (5000.0 * signals.ldv[:, 1] - signals.reference[:, 1])
    spring = np.where(signals.time < 0.05, 0.01, 0.02)
    np.testing.assert_allclose(left, spring * signals.reference[:, 0], atol=1e-12)
    rejected = example.python('-m', 'hdd_servo_ros.tools.replay', 'rig')
    assert rejected.returncode == 3
    assert 'to run its code, add --trust' in rejected.stderr
    replayed = example.python('-m', 'hdd_servo_ros.tools.replay', '--trust', 'rig')
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr


def test_by_its_own_executable_with_a_live_change(example):
    """The executable of the package around an import path; a parameter set while it runs, at a tick the bag shows."""
    slow = ('-p', 'deterministic_timer:rate:=0.05', '-p', 'deterministic_timer:duration:=0.4')
    processes = list(example.start_nodes('run', *slow, nodes=OTHERS).values())
    processes.append(example.start_python('my_controller', '-m', 'hdd_servo_ros.nodes.outside_controller', PATH))
    deadline = time.monotonic() + 200.0
    while not (example.directory / 'run' / 'run.yaml').exists():
        assert time.monotonic() < deadline, [process.output for process in processes]
        time.sleep(0.05)
    time.sleep(1.0)  # the folder is made before the first tick
    change = example.python(str(Path(__file__).with_name('set_parameter.py')), 'my_controller', 'spring', '0.01')
    assert change.returncode == 0, change.stderr
    for process in processes:
        assert process.wait() == 0, process.output
    from rcl_interfaces.msg import ParameterEvent

    events = Run.open(example.directory / 'run').messages_by_topic()['/parameter_events']
    ((stamp, message),) = zip(*events, strict=True)
    event = deserialize_message(message, ParameterEvent)
    assert event.node == '/my_controller'
    signals = Run.open(example.directory / 'run')
    # u + k_p e + k_d de of the recorded voltages is the feedforward: none before the event's tick, all from it on.
    e = 8.0 * signals.ldv[:, 0] - signals.reference[:, 0]
    de = 5000.0 * signals.ldv[:, 1] - signals.reference[:, 1]
    left = signals.control[:, 0] + 0.5 * e + 9.7e-5 * de
    tick = round(stamp / 1e5)
    assert 0 < tick < 4000
    np.testing.assert_allclose(left[:tick], 0.0, atol=1e-12)
    np.testing.assert_allclose(left[tick:], 0.01 * signals.reference[tick:, 0], atol=1e-12)


@pytest.mark.parametrize(
    ('fault', 'beginning', 'end'),
    [
        (
            '(1.0 / (inputs.tick - 77) if inputs.tick else 0.0)',
            'my_controller: step raised ZeroDivisionError: float division by zero (',
            'failing.py:33) at tick 77',
        ),
        (
            "(float('nan') if inputs.tick == 77 else 0.0)",
            '/control: not finite at tick 77: (nan, nan, nan)',
            '; published by my_controller',
        ),
    ],
)
def test_a_failing_step_says_the_same_in_the_rig_and_without_it(bench, fault, beginning, end):
    source = EXAMPLE.read_text().replace('return p.spring', f'return {fault} + p.spring')
    (bench.directory / 'failing.py').write_text(source)
    said = []
    for name, run in (('rig', 'a'), ('simulate', 'b')):
        process = bench.start(name, *SHORT, '-p', 'controller:=failing:MyController', '-p', f'run_dir:={run}')
        assert process.wait() == 1, process.output
        assert 'Traceback' not in process.output
        content = bench.run_yaml(run)
        assert content['status'] == 'failed'
        assert content['last_tick'] == 76
        said.append(content['reason'])
    assert said[0] == said[1]
    assert said[0].startswith(beginning)
    assert said[0].endswith(end)
    assert first_difference(bench.directory / 'a', bench.directory / 'b') is None


@pytest.mark.parametrize('name', ['rig', 'simulate'])
def test_what_cannot_be_found_is_one_line(bench, name):
    process = bench.start(name, '-p', 'controller:=no_such_module:MyController')
    assert process.wait() == 2
    here = bench.directory
    reason = f'module no_such_module is neither on sys.path nor in {here}'
    expected = f"{name}: invalid value for parameter controller: 'no_such_module:MyController'; {reason}\n"
    assert process.output.endswith(expected)


@pytest.mark.parametrize('name', ['rig', 'simulate'])
def test_the_former_arguments_of_step_are_one_line(bench, name):
    source = EXAMPLE.read_text().replace(
        'step(self, inputs)', 'step(self, tick, displacement_volts, velocity_volts, x_d, dx_d, ddx_d)'
    )
    (bench.directory / 'former.py').write_text(source)
    process = bench.start(name, '-p', 'controller:=former:MyController')
    assert process.wait() == 2
    (line,) = [line for line in process.output.splitlines() if 'former:MyController' in line]
    assert line.startswith(
        f"{name}: invalid value for parameter controller: 'former:MyController'; MyController.step now takes one"
    )
    assert line.endswith('; see docs/tutorial-own-controller.md')
    assert 'Traceback' not in process.output


def test_help(example):
    for command in (['my_controller.py'], ['-m', 'hdd_servo_ros.nodes.outside_controller', PATH]):
        answer = example.python(*command, '--help')
        assert answer.returncode == 0, answer.stderr
        assert 'State feedback with feedforward' in answer.stdout
        assert 'spring (default 0.0)' in answer.stdout
        assert 'at least 0 and at most 0.1 [V/um]' in answer.stdout
        assert example.python(*command, '--nonsense').returncode == 2
    usage = example.python('-m', 'hdd_servo_ros.nodes.outside_controller', '--help')
    assert usage.returncode == 0
    assert usage.stdout.startswith('usage: outside_controller MODULE:CLASS')
    rejected = example.python('-m', 'hdd_servo_ros.nodes.outside_controller', 'my_controller:Mine')
    assert rejected.returncode == 2
    assert 'has no Mine' in rejected.stderr


def test_the_file_needs_no_ros(example):
    """`simulate` runs it where rclpy is not installed."""
    program = (
        "import sys; sys.modules['rclpy'] = None; import my_controller; from hdd_servo_ros.simulation import simulate; "
    )
    program += f"raise SystemExit(simulate.main(['--ros-args', '-p', 'controller:={PATH}', '-p', 'duration:=0.01']))"
    answer = example.python('-c', program)
    assert answer.returncode == 0, answer.stderr
