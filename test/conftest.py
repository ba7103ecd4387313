"""Real processes for the system tests: each test has its own ROS domain, and every process is ended by its pid."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import settings

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.numerics.kernel_folder import kernel_cache_directory
from hdd_servo_ros.simulation.closed_loop import Controllers
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.testing.domain import take_domain
from test.process_copies import Copies, Copy

# The first example compiles kernels; no test asserts a time. Derandomized, so that a failure is everybody's.
settings.register_profile('bench', deadline=None, derandomize=True)
settings.load_profile('bench')

ROOT = Path(__file__).parent.parent
DEFAULT = ROOT / 'params' / 'seagate_7200_10.yaml'
NODES = nodes_of_run({CONTROLLER: CONTROLLERS['adaptive_nn']})


class Process:
    """One executable of the package, running."""

    def __init__(self, name: str, popen: subprocess.Popen[bytes] | Copy, log: Path) -> None:
        self.name = name
        self.popen = popen
        self._log = log

    @property
    def output(self) -> str:
        """What it has printed so far."""
        return self._log.read_text(errors='replace')

    def wait(self, timeout: float = 250.0) -> int:
        """Return its exit code; fails the test, with its output, if it does not end in time."""
        try:
            return self.popen.wait(timeout)
        except subprocess.TimeoutExpired:
            pytest.fail(f'{self.name} did not end within {timeout} s; its output:\n{self.output}')

    def wait_for(self, text: str, timeout: float = 250.0) -> None:
        """Wait until it has printed ``text``."""
        deadline = time.monotonic() + timeout
        while text not in self.output:
            if time.monotonic() > deadline or (self.popen.poll() is not None and text not in self.output):
                pytest.fail(f'{self.name} did not print {text!r}; its output:\n{self.output}')
            time.sleep(0.02)

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self.popen.send_signal(number)


class Interpreters:
    """Starts interpreters as copies of a prepared process, where that is the same as a new one."""

    def __init__(self) -> None:
        self._environment = with_package(os.environ)
        self._server: Copies | None = None

    def start(
        self, arguments: Sequence[str], directory: Path, environment: Mapping[str, str], log: Path, errors: Path | None
    ) -> Copy | None:
        """Start ``python ARGUMENTS``; return None if it takes a new interpreter to do that."""
        if arguments[0] == '-c' or self._inherited(environment) != self._inherited(self._environment):
            return None
        if self._server is None:
            self._server = Copies(self._environment)
        paths = {'directory': str(directory), 'log': str(log), 'errors': None if errors is None else str(errors)}
        return self._server.request({'arguments': arguments, 'environment': environment, **paths})

    @staticmethod
    def _inherited(environment: Mapping[str, str]) -> dict[str, str]:
        """Return the variables on which imports depend; those of ROS are read when a node is made."""
        names = ('PYTHON', 'NUMBA', 'MPL', 'XDG_CACHE_HOME', 'HOME', 'AMENT_PREFIX_PATH', 'LD_LIBRARY_PATH')
        return {name: value for name, value in environment.items() if name.startswith(names)}

    def close(self) -> None:
        """End the prepared process."""
        if self._server is not None:
            self._server.close()


def with_package(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables with which the interpreter finds this package, and ROS what is installed."""
    return {
        **environment,
        'AMENT_PREFIX_PATH': environment.get('AMENT_PREFIX_PATH', sys.prefix),
        'PYTHONPATH': os.pathsep.join([str(ROOT), *filter(None, [environment.get('PYTHONPATH')])]),
    }


class Bench:
    """
    Starts processes in a ROS domain of their own.

    ``interpreters`` starts them as copies of a prepared process; where it is None each is a new interpreter.
    """

    def __init__(self, directory: Path, interpreters: Interpreters | None) -> None:
        self.directory = directory
        self.interpreters = interpreters
        self.domain, self._domain_lock = take_domain()
        self.processes: list[Process] = []
        self.environment = {
            **with_package(os.environ),
            'ROS_DOMAIN_ID': str(self.domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run this interpreter to its end."""
        process = self._start('python', arguments, self._log('out'), errors := self._log('err'))
        code = process.wait(600.0)
        return subprocess.CompletedProcess(arguments, code, process.output, errors.read_text(errors='replace'))

    def start(self, name: str, *ros_arguments: str, script: Path | None = None, defaults: bool = True) -> Process:
        """
        Start an executable of the package (or a script of the tests) with the default parameter file.

        Its picture takes longer to draw than most of the runs: none is drawn unless ``plot`` is among the arguments.
        """
        module = 'hdd_servo_ros.simulation.simulate' if name == 'simulate' else f'hdd_servo_ros.nodes.{name}'
        command = [str(script)] if script else ['-m', module]
        command += ['--ros-args', *(['--params-file', str(DEFAULT)] if defaults else []), *ros_arguments]
        if name in ('rig', 'simulate') and not any('plot:=' in argument for argument in ros_arguments):
            # Last: of parameters before a file ROS does not let those after it win.
            command += ['-p', 'plot:=false']
        return self.start_python(name, *command)

    def start_python(self, name: str, *arguments: str) -> Process:
        """Start this interpreter."""
        return self._start(name, arguments, self._log(name), None)

    def _log(self, name: str) -> Path:
        return self.directory / f'{len(self.processes)}-{name}.log'

    def _start(self, name: str, arguments: Sequence[str], log: Path, errors: Path | None) -> Process:
        popen: subprocess.Popen[bytes] | Copy | None = None
        if self.interpreters is not None:
            popen = self.interpreters.start(arguments, self.directory, self.environment, log, errors)
        if popen is None:
            command = [sys.executable, *arguments]
            with log.open('wb') as out, (errors or log).open('ab') as err:
                stderr = subprocess.STDOUT if errors is None else err
                popen = subprocess.Popen(command, cwd=self.directory, env=self.environment, stdout=out, stderr=stderr)
        self.processes.append(Process(name, popen, log))
        return self.processes[-1]

    def run(self, name: str, *ros_arguments: str) -> Process:
        """Start an executable, and wait until it has ended well."""
        process = self.start(name, *ros_arguments)
        assert process.wait() == 0, process.output
        return process

    def start_nodes(self, run: str, *ros_arguments: str, nodes: Sequence[str] = NODES) -> dict[str, Process]:
        """Start each node in a process of its own; the run goes into the folder ``run``."""
        recorded = ('-p', f'run_dir:={run}')
        return {node: self.start(node, *recorded, *ros_arguments) for node in nodes}

    def run_yaml(self, run: str) -> dict[str, Any]:
        """Return the content of a run's ``run.yaml``."""
        return yaml.safe_load((self.directory / run / 'run.yaml').read_text())

    def end(self) -> None:
        """End every process that still runs."""
        for process in self.processes:
            if process.popen.poll() is None:
                process.popen.send_signal(signal.SIGCONT)
                process.popen.kill()
            process.popen.wait(250.0)
        self._domain_lock.close()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the folders whose files take longest: no process is to be left with one of them at the end."""
    longest = ('studies', 'system')
    items.sort(key=lambda item: min((longest.index(part) for part in item.path.parts if part in longest), default=2))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Compile the kernels before any test that starts processes: their time limits are for running, not for that."""
    if not any('bench' in getattr(item, 'fixturenames', ()) for item in session.items):
        return
    # One of the test processes compiles, the others wait for what it then finds.
    with (kernel_cache_directory() / 'tests.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for name in Controllers._fields:
            whole = Experiment(1e-4, name)
            whole.run(0, 2)
            Experiment(1e-4, whole.controller).run(0, 2)  # block by block, as the nodes do


@pytest.fixture(scope='module', autouse=True)
def only_its_own_controllers() -> Iterator[None]:
    """Remove the custom controllers that the tests of a file have loaded from the catalog of this process."""
    before = dict(catalog.NODES)
    yield
    catalog.NODES.clear()
    catalog.NODES.update(before)


@pytest.fixture(scope='session')
def interpreters() -> Iterator[Interpreters]:
    """Give all tests of a process the one whose copies are their processes."""
    made = Interpreters()
    yield made
    made.close()


@pytest.fixture
def bench(request: pytest.FixtureRequest, tmp_path: Path, interpreters: Interpreters) -> Iterator[Bench]:
    """Give a test its own domain and folder, and end what it started."""
    made = Bench(tmp_path, None if request.node.get_closest_marker('new_interpreters') else interpreters)
    try:
        yield made
    finally:
        made.end()


@pytest.fixture(scope='session')
def simulated() -> Callable[..., Path]:
    """Record a run without middleware, in this process: ``simulated(directory, '-p', 'duration:=0.2', ...)``."""
    from hdd_servo_ros.parameters.files import parse_ros_arguments
    from hdd_servo_ros.simulation.run_setup import Simulation
    from hdd_servo_ros.simulation.simulate import simulate

    def run(directory: Path, *ros_arguments: str) -> Path:
        arguments = ['--ros-args', '--params-file', str(DEFAULT), '-p', f'run_dir:={directory}', *ros_arguments]
        assert simulate(Simulation(parse_ros_arguments(arguments)), progress=False)[0] == 0
        return directory

    return run
