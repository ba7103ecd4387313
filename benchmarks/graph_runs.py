"""The graph as processes, in a temporary directory and a private ROS domain, for the benchmarks."""

import os
import re
import subprocess
import sys
from pathlib import Path

import yaml

from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run

ROOT = Path(__file__).parent.parent
PARAMS = ROOT / 'params' / 'seagate_7200_10.yaml'
NODES = nodes_of_run({CONTROLLER: CONTROLLERS['adaptive_nn']})
DEFAULT_NODES = ('recorder', 'controller', 'sensor', 'plant', 'reference', 'timer')


class Bench:
    """Runner of graphs in one directory and one private ROS domain."""

    def __init__(self, directory):
        self.directory = Path(directory)
        self.count = 0
        self.lost_by_default = 0
        self.environment = {**os.environ, 'ROS_DOMAIN_ID': str(os.getpid() % 100 + 1)}
        self.environment.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        self.environment['PYTHONPATH'] = os.pathsep.join(
            [str(ROOT), *filter(None, [self.environment.get('PYTHONPATH')])]
        )

    def popen(self, module, *arguments):
        return subprocess.Popen(
            [sys.executable, '-m', module, *map(str, arguments)],
            cwd=self.directory,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def folder(self):
        self.count += 1
        return self.directory / f'run{self.count}'

    def ros_arguments(self, run, ticks, *more):
        arguments = ['--ros-args', '--params-file', PARAMS, '-p', f'run_dir:={run}', '-p', f'duration:={ticks * 1e-4}']
        return [*arguments, '-p', 'plot:=false', *more]

    def rig(self, ticks, *more):
        run = self.folder()
        self._finish([self.popen('hdd_servo_ros.nodes.rig', *self.ros_arguments(run, ticks, *more))])
        return yaml.safe_load((run / 'run.yaml').read_text())['real_time_factor']

    def processes(self, ticks):
        run = self.folder()
        self._finish([self.popen(f'hdd_servo_ros.nodes.{node}', *self.ros_arguments(run, ticks)) for node in NODES])
        return yaml.safe_load((run / 'run.yaml').read_text())['real_time_factor']

    def default(self, ticks):
        return self._factor([self.popen('benchmarks.default_graph', ticks, self.folder())])

    def default_processes(self, ticks):
        bag = self.folder()
        processes = [self.popen('benchmarks.default_graph', ticks, bag, node) for node in DEFAULT_NODES]
        factor = self._factor([processes[-1], processes[0]], wait=False)
        for process in processes:
            process.kill()
            process.wait()
        return factor

    def lower_bound(self, ticks):
        return self._factor([self.popen('benchmarks.lower_bound', ticks)])

    def _finish(self, processes):
        for process in processes:
            output, _ = process.communicate(timeout=300)
            if process.returncode:
                raise RuntimeError(output)

    def _factor(self, processes, wait=True):
        outputs = []
        for process in processes:
            lines = []
            for line in process.stdout:
                lines.append(line)
                if not wait and re.match('real_time_factor|lost', line):
                    break
            outputs.append(''.join(lines))
        text = ''.join(outputs)
        lost = re.search(r'lost (\d+)', text)
        if lost and int(lost.group(1)):
            # Not an error of the run: a recorder without flow control cannot slow the loop down.
            print(f'  the recorder of the default executors lost {lost.group(1)} messages', flush=True)
            self.lost_by_default = max(self.lost_by_default, int(lost.group(1)))
        found = re.search(r'real_time_factor (\S+)', text)
        if not found:
            raise RuntimeError(text)
        return float(found.group(1))


def alternating(repeats, **measures):
    """Run the benchmarks alternately, several times; return the values of each."""
    values: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(repeats):
        for name, measure in measures.items():
            values[name].append(measure())
            print(f'  {name:16} {values[name][-1]:.4g}', flush=True)
    return values
