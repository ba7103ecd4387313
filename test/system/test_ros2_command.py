"""The package as a person meets it who has ROS 2 installed: built, sourced, and used by the `ros2` command."""

import contextlib
import functools
import itertools
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import deserialize_message

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLERS, EXECUTABLES, nodes_of_run
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.testing.domain import take_domain

PACKAGE = 'hdd_servo_ros'
CONTROLLER = CONTROLLERS['adaptive_nn']
LOOP_NODES = nodes_of_run({'controller': CONTROLLER})
SLOW = ('-p', 'deterministic_timer:rate:=0.05', '-p', 'deterministic_timer:duration:=3.0')
"""A run that goes on long enough to be looked at, and leaves the machine idle."""
TIME_LIMIT = 250.0


def outer_environment():
    """The caller's, without the guard of the ROS wheels: `ros2` may be of another environment."""
    return {name: value for name, value in os.environ.items() if name != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}


@functools.cache
def why_not():
    """Return why the command cannot be used here, empty if it can."""
    if shutil.which('ros2') is None:
        return 'there is no ros2 command'
    found = subprocess.run(
        ['ros2', 'pkg', 'prefix', PACKAGE], env=outer_environment(), capture_output=True, timeout=250
    )
    return '' if found.returncode == 0 else f'`ros2 pkg prefix {PACKAGE}` fails: no install/setup.bash was sourced'


class Command:
    """`ros2 ...`, running as in a terminal: as the leader of a process group."""

    def __init__(self, arguments, directory, environment, log):
        self.line = ' '.join(['ros2', *arguments])
        self._logs = (log.with_suffix('.out'), log.with_suffix('.err'))
        with self._logs[0].open('w') as output, self._logs[1].open('w') as errors:
            self._popen = subprocess.Popen(
                ['ros2', *arguments],
                cwd=directory,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
                start_new_session=True,
            )

    @property
    def answer(self):
        """What it has printed so far on its standard output, which DDS keeps its own messages away from."""
        return self._logs[0].read_text(errors='replace')

    @property
    def output(self):
        """Everything that it has printed so far."""
        return ''.join(log.read_text(errors='replace') for log in self._logs)

    def wait(self, timeout=TIME_LIMIT):
        """Return its exit code."""
        try:
            return self._popen.wait(timeout)
        except subprocess.TimeoutExpired:
            pytest.fail(f'`{self.line}` did not end within {timeout} s; its output:\n{self.output}')

    def wait_for(self, text):
        """Wait until it has printed ``text``."""
        deadline = time.monotonic() + TIME_LIMIT
        while text not in self.output:
            ended = self._popen.poll() is not None
            if time.monotonic() > deadline or (ended and text not in self.output):
                pytest.fail(f'`{self.line}` did not print {text!r}; its output:\n{self.output}')
            time.sleep(0.05)

    def interrupt(self):
        """Do what Ctrl-C does."""
        os.killpg(self._popen.pid, signal.SIGINT)

    def end(self):
        """End it, and what it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._popen.pid, signal.SIGKILL)
        self._popen.wait()


class Ros2:
    """The `ros2` command in the bench's domain."""

    def __init__(self, bench):
        self.directory = bench.directory
        discovery = {name: bench.environment[name] for name in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')}
        # The package is the one that `ros2` finds, not these sources.
        self._environment = {**outer_environment(), **discovery}
        self._commands = []
        self._daemon = False

    def start(self, *arguments):
        """Start a command."""
        log = self.directory / f'ros2-{len(self._commands)}'
        self._commands.append(Command(arguments, self.directory, self._environment, log))
        return self._commands[-1]

    def run(self, name, *ros_arguments):
        """Start an executable of the package."""
        return self.start('run', PACKAGE, name, '--ros-args', *ros_arguments)

    def launch(self, file, *arguments):
        """Start a launch file of the package."""
        return self.start('launch', PACKAGE, file, *arguments)

    def say(self, *lines):
        """Run commands beside each other; return their answers."""
        return [command.answer for command in self.finish(*lines)]

    def finish(self, *lines):
        """Run commands beside each other to their good ends."""
        started = [self.start(*line.split(' ')) for line in lines]
        for command in started:
            assert command.wait() == 0, f'`{command.line}` said:\n{command.output}'
        return started

    def start_slow_rig(self, run, *ros_arguments):
        """Start a rig, and wait until the run is under way and the daemon knows all of it."""
        self._daemon = True
        self.say('daemon start')
        rig = self.run('rig', *SLOW, *ros_arguments, '-p', f'bag_recorder:run_dir:={run}')
        deadline = time.monotonic() + TIME_LIMIT
        expected = {f'/{name}' for name in ('rig', *LOOP_NODES)}
        while not (self.directory / run / 'run.yaml').exists() or set(self.say('node list')[0].split()) != expected:
            assert time.monotonic() < deadline, rig.output
        return rig

    def run_yaml(self, run):
        """Return what a run's folder says of it."""
        return yaml.safe_load((self.directory / run / 'run.yaml').read_text())

    def parameters_of(self, run):
        """Return the parameters of each node of a run."""
        return {name.strip('/'): node['parameters'] for name, node in self.run_yaml(run)['nodes'].items()}

    def end(self):
        """End everything that was started."""
        for command in self._commands:
            command.end()
        if self._daemon:
            self.start('daemon', 'stop').wait()


@pytest.fixture(scope='session')
def installed():
    """Let the installed package compile its kernels: the tests' time limits are for running, not for that."""
    if why_not():
        pytest.skip(why_not())
    domain, lock = take_domain()
    with lock, tempfile.TemporaryDirectory() as directory:
        environment = {
            **outer_environment(),
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }
        for executable, controller in itertools.product(('rig', 'simulate'), ('adaptive_nn', 'pid')):
            parameters = {'controller': controller, 'duration': 0.001, 'run_dir': f'{executable}-{controller}'}
            words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
            command = ['ros2', 'run', PACKAGE, executable, '--ros-args', *words]
            subprocess.run(command, cwd=directory, env=environment, stdin=subprocess.DEVNULL, timeout=600, check=True)


@pytest.fixture
def ros2(installed, bench):
    made = Ros2(bench)
    try:
        yield made
    finally:
        made.end()


def test_every_executable_is_found_and_helps(ros2):
    lines = ros2.say(f'pkg executables {PACKAGE}')[0].splitlines()
    names = [line.removeprefix(f'{PACKAGE} ') for line in lines]
    assert set(EXECUTABLES) == set(names)
    for name, text in zip(names, ros2.say(*(f'run {PACKAGE} {name} --help' for name in names)), strict=True):
        assert text.startswith(f'usage: {name} '), text


def test_rig_and_simulate(ros2):
    share = Path(ros2.say(f'pkg prefix --share {PACKAGE}')[0].strip())
    arguments = ('--params-file', str(share / 'params' / 'seagate_7200_10.yaml'), '-p', 'duration:=0.05')
    commands = [ros2.run(name, *arguments, '-p', f'run_dir:={name}') for name in ('rig', 'simulate')]
    for command in commands:
        assert command.wait() == 0, command.output
        assert '501 of 0.0001 s, 0 to 500' in command.output
    assert first_difference(ros2.directory / 'rig', ros2.directory / 'simulate') is None


def test_each_node_by_its_own_command(ros2):
    share = Path(ros2.say(f'pkg prefix --share {PACKAGE}')[0].strip())
    arguments = ('--params-file', str(share / 'params' / 'seagate_7200_10.yaml'), '-p', 'duration:=0.02')
    commands = [ros2.run(name, *arguments, '-p', 'run_dir:=run') for name in LOOP_NODES]
    for command in commands:
        assert command.wait() == 0, command.output
    assert len(Run.open(ros2.directory / 'run').time) == 201


def test_rejected_at_the_start(ros2):
    words = {
        'vcm_plant:gain:=-1.0': 'gain: -1.0; expected a finite number above 0',
        'controler:=pid': 'did you mean controller?',
        'rig:controler:=pid': 'did you mean controller?',
        'vmc_plant:gain:=1.0': "parameters for '/vmc_plant', but there are",
    }
    for argument, rig in {argument: ros2.run('rig', '-p', argument) for argument in words}.items():
        assert rig.wait() == 2, rig.output
        assert words[argument] in rig.output
        assert 'Traceback' not in rig.output


def test_looking_at_topics_and_interrupting(ros2):
    rig = ros2.start_slow_rig('run')
    rate = ros2.start('topic', 'hz', '/control')
    topics, node, head, clock = ros2.say(
        'topic list -t', 'node info /vcm_plant', 'topic echo --once /head', 'topic echo --once /clock'
    )
    for topic in LOOP_TOPICS:
        assert f'/{topic.name} [{topic.type_name}]' in topics.splitlines()
    subscribers, publishers = node.split('Publishers:')
    assert '/control: geometry_msgs/msg/Vector3Stamped' in subscribers
    assert '/head: geometry_msgs/msg/Vector3Stamped' in publishers
    message = next(yaml.safe_load_all(head))
    assert message['header']['frame_id'] == 'seagate_7200_10'
    assert message['header']['stamp']['nanosec'] % 100_000 == 0
    assert next(yaml.safe_load_all(clock))['clock']['nanosec'] % 100_000 == 0
    rate.wait_for('average rate')

    rig.interrupt()
    # `ros2 launch` sends once more what the terminal has sent to all already.
    time.sleep(0.1)
    rig.interrupt()
    assert rig.wait() == 130, rig.output
    content = ros2.run_yaml('run')
    assert content['status'] == 'interrupted'
    assert 'SIGINT' in content['reason']
    assert len(Run.open(ros2.directory / 'run').time) == content['last_tick'] + 1 > 1


def test_interrupting_a_node_that_waits(ros2):
    node = ros2.run('vcm_plant')
    node.wait_for('waiting for')
    node.interrupt()
    assert node.wait() == 130, node.output


def test_parameters_during_a_run(ros2):
    rig = ros2.start_slow_rig('run')
    # Whatever clock a user chooses, now and again below, the bag shows the tick.
    names, got, described, fixed, _ = ros2.say(
        'param list',
        'param get /reference_generator frequency',
        'param describe /vcm_plant gain',
        'param describe /deterministic_timer sample_time',
        'param set /reference_generator use_sim_time true',
    )
    for node in ('rig', *LOOP_NODES):
        assert f'/{node}:' in names.splitlines()
    assert got == 'Double value is: 100.0\n'
    assert 'Type: double' in described
    assert 'um/s^2/V' in described
    assert 'above 0' in described
    assert 'Read only: true' in fixed

    low, unknown, read_only = ros2.finish(
        'param set /reference_generator frequency -- -1.0',
        'param set /reference_generator waveform sawtooth',
        'param set /deterministic_timer sample_time 0.001',
    )
    assert 'frequency: -1.0; expected a finite number at least 0 [Hz]' in low.output
    assert "waveform: 'sawtooth'; expected one of sine" in unknown.output
    assert 'read-only' in read_only.output

    changed = {'/reference_generator': {'ros__parameters': {'use_sim_time': False, 'frequency': 150.0}}}
    (ros2.directory / 'changed.yaml').write_text(yaml.safe_dump(changed, sort_keys=False))
    assert ros2.say('param load /reference_generator changed.yaml')[0].count('successful') == 2
    rig.interrupt()
    assert rig.wait() == 130, rig.output

    signals = Run.open(ros2.directory / 'run')
    last_tick = len(signals.time) - 1
    stamps, events = Run.open(ros2.directory / 'run').messages_by_topic()['/parameter_events']
    changes = [deserialize_message(event, ParameterEvent).changed_parameters[0].name for event in events]
    assert changes == ['use_sim_time', 'use_sim_time', 'frequency']
    tick = int(stamps[-1]) // 100_000
    assert 0 < stamps[0] < stamps[-1] <= last_tick * 100_000
    frequency = np.where(np.arange(last_tick + 1) < tick, 100.0, 150.0)
    expected = 2.0 * np.sin(2.0 * np.pi * frequency * signals.time)
    np.testing.assert_allclose(signals.reference[:, 0], expected, atol=1e-8)


def test_dumped_parameters_are_a_parameter_file(ros2):
    changed: dict[str, dict[str, Any]] = {
        'reference_generator': {'amplitude': 1.5},
        'vcm_plant': {'substeps': 3},
        CONTROLLER: {'phi.gain': 1e-5},
    }
    given = [f'{node}:{name}:={value}' for node, values in changed.items() for name, value in values.items()]
    rig = ros2.start_slow_rig('run', *(word for text in given for word in ('-p', text)))
    dumps = ros2.say(*(f'param dump /{node}' for node in changed))
    rig.end()
    (ros2.directory / 'dumped.yaml').write_text(''.join(dumps))
    arguments = ('--params-file', 'dumped.yaml', '-p', 'deterministic_timer:duration:=0.02')
    runs = {name: ros2.run(name, *arguments, '-p', f'bag_recorder:run_dir:={name}') for name in ('rig', 'simulate')}
    of_all = ros2.parameters_of('run')
    for name, command in runs.items():
        assert command.wait() == 0, command.output
        parameters = ros2.parameters_of(name)
        for node, values in changed.items():
            assert values.items() <= of_all[node].items()
            assert parameters[node] == of_all[node]
    assert first_difference(ros2.directory / 'rig', ros2.directory / 'simulate') is None


LAUNCH_FILES = ('rig.launch.py', 'composed.launch.py', 'live.launch.py')


def test_launch_files_say_what_they_take(ros2):
    for text in ros2.say(*(f'launch {PACKAGE} {file} --show-args' for file in LAUNCH_FILES)):
        arguments = text.split("    '")[1:]
        names = [argument.split("'")[0] for argument in arguments]
        expected = ['controller', 'params', 'namespace', 'rate', 'duration', 'record', 'run_dir', 'discovery_range']
        assert set(expected) <= set(names)
        for argument in arguments:
            assert 'no description given' not in argument


def test_launch_gives_the_same_bits_and_ends_with_the_run(ros2):
    share = Path(ros2.say(f'pkg prefix --share {PACKAGE}')[0].strip()) / 'params'
    files = f'params:={share}/seagate_7200_10.yaml, {share}/frictionless.yaml'
    common = (files, 'duration:=0.05', 'namespace:=bench1', 'ros_args:=-p frequency:=150.0')
    commands = [
        ros2.launch('rig.launch.py', *common, 'run_dir:=separate'),
        ros2.launch('composed.launch.py', *common, 'run_dir:=composed', 'discovery_range:=OFF'),
        ros2.launch('live.launch.py', *common, 'namespace:=bench2', 'run_dir:=live', 'viewer:=none'),
    ]
    for command in commands:
        assert command.wait() == 0, command.output
    for run in ('composed', 'live'):
        assert first_difference(ros2.directory / 'separate', ros2.directory / run) is None
    parameters = ros2.run_yaml('separate')['nodes']
    assert parameters['/bench1/reference_generator']['parameters']['frequency'] == 150.0
    assert ros2.run_yaml('live')['rate'] == 1.0


def test_launch_of_a_run_that_is_rejected_or_fails(ros2):
    unwritable = ros2.directory / 'a_file'
    unwritable.write_text('')
    commands = {
        ros2.launch('composed.launch.py', 'controller:=nonsense'): "controller: 'nonsense';",
        ros2.launch('rig.launch.py', 'controller:=nonsense', 'namespace:=/bench3'): "controller: 'nonsense';",
        ros2.launch('rig.launch.py', 'ros_args:=-p gain:=-1.0', 'namespace:=/bench2'): 'gain: -1.0;',
        ros2.launch('rig.launch.py', f'run_dir:={unwritable}/run', 'namespace:=/bench1'): 'run failed',
        ros2.launch('composed.launch.py', 'record:=maybe'): 'Valid options',
        ros2.launch('composed.launch.py', 'contoller:=pid'): 'did you mean controller?',
        ros2.launch('live.launch.py', 'frequency:=200.0'): 'parameters go into ros_args:=',
    }
    for command, words in commands.items():
        assert command.wait() == 1, command.output
        assert words in command.output


def test_launches_of_the_documents(ros2):
    text = (Path(__file__).parents[2] / 'docs' / 'howto' / 'run-with-ros2.md').read_text()
    lines = [shlex.split(line) for line in text.splitlines() if line.startswith('ros2 launch ')]
    assert len(lines) > 3
    shortened = ('duration:=0.02', 'rate:=0.0')
    for number, words in enumerate(lines):
        live = ('viewer:=none',) if words[3] == 'live.launch.py' else ()
        command = ros2.start(*words[1:], *shortened, *live, f'run_dir:=run{number}')
        assert command.wait() == 0, command.output


def test_interrupting_a_launch(ros2):
    launch = ros2.launch('rig.launch.py', 'rate:=0.05', 'duration:=3.0', 'run_dir:=run')
    deadline = time.monotonic() + TIME_LIMIT
    while not (ros2.directory / 'run' / 'run.yaml').exists():
        assert time.monotonic() < deadline, launch.output
        time.sleep(0.1)
    time.sleep(1.0)
    launch.interrupt()
    assert launch.wait() == 1, launch.output
    content = ros2.run_yaml('run')
    assert content['status'] == 'interrupted'
    assert len(Run.open(ros2.directory / 'run').time) == content['last_tick'] + 1 > 1
