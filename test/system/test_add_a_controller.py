"""A built-in controller is added as CONTRIBUTING.md says: its block, its node, one row and one branch."""

import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMPILED_IN = 400.0
"""The copy compiles all its kernels anew [s]."""
pytestmark = pytest.mark.timeout(3 * COMPILED_IN)

BLOCK = '''"""A proportional controller."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.parameters import ParameterSet, parameter

ProportionalArrays = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class ProportionalParameters(ParameterSet):
    """Parameters of :class:`Proportional`."""

    stiffness: float = parameter(0.05, 'proportional gain k_p', unit='V/um', minimum=0.0)
    control_limit: float = parameter(1.0, 'largest magnitude of the drive voltage', unit='V', above=0.0)


@compiled
def proportional_step(
    constants: NDArray[np.float64], estimates: NDArray[np.float64], *values: Any
) -> tuple[float, float, float]:
    """Return u, u before the limit, and u once more, for it is all feedback [V]."""
    inputs = ControllerInputs(*values)
    if not all_finite(inputs):
        return math.nan, math.nan, math.nan
    estimates[0] = float(inputs.tick) * constants[2]
    estimates[1] = inputs.position - inputs.desired_position
    u = -constants[0] * estimates[1]
    return saturated(u, constants[1]), u, u


class Proportional:
    """u = -k_p e."""

    estimate_names = ('t', 'e')

    def __init__(self, parameters: ProportionalParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.estimates: NDArray[np.float64] = np.zeros(2)
        self.update(parameters)

    def update(self, parameters: ProportionalParameters) -> None:
        """Take other parameters from the next tick on."""
        values = [parameters.stiffness, parameters.control_limit, self.sample_time]
        self.constants: NDArray[np.float64] = np.array(values)

    @property
    def arrays(self) -> ProportionalArrays:
        """The arrays that the kernel takes first."""
        return self.constants, self.estimates

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit and its feedback part [V]."""
        return proportional_step(*self.arrays, *inputs)
'''

NODE = '''"""`proportional_controller`: u = -k_p e."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.nodes.controller_node import run_plain_controller


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_plain_controller('proportional_controller', arguments)


if __name__ == '__main__':
    sys.exit(main())
'''

ROW = """    NodeRow(
        'proportional_controller',
        'A proportional controller.',
        (*_EVERY_CONTROLLER, 'control.proportional:ProportionalParameters'),
        block='control.proportional:Proportional',
        role=CONTROLLER,
        short_name='proportional',
    ),
"""

BRANCH = (
    (
        'from hdd_servo_ros.drive.plant import',
        'from hdd_servo_ros.control.proportional import ProportionalArrays, proportional_step\n'
        'from hdd_servo_ros.drive.plant import',
    ),
    (
        '    signal_analyzer: SignalAnalyzerArrays\n',
        '    signal_analyzer: SignalAnalyzerArrays\n    proportional: ProportionalArrays\n',
    ),
    ('OPEN_LOOP, SIGNAL_ANALYZER = range', 'OPEN_LOOP, SIGNAL_ANALYZER, PROPORTIONAL = range'),
    (
        '        else:\n            u, unsaturated, feedback = open_loop_step',
        '        elif controller_kind == PROPORTIONAL:\n'
        '            u, unsaturated, feedback = proportional_step(*controllers.proportional, *inputs)\n'
        '            estimates = controllers.proportional[-1]\n'
        '        else:\n            u, unsaturated, feedback = open_loop_step',
    ),
)
"""What is replaced in the compiled loop: an import, a field, its index, and the branch."""


def edit(file, *replacements):
    text = file.read_text('utf8')
    for old, new in replacements:
        assert text.count(old) == 1, f'{file.name}: {old!r}'
        text = text.replace(old, new)
    file.write_text(text, 'utf8')


@pytest.fixture
def copy(bench, tmp_path):
    """A copy of the package with the controller added; the processes of ``bench`` run that copy."""
    package = tmp_path / 'copy' / 'hdd_servo_ros'
    shutil.copytree(ROOT / 'hdd_servo_ros', package, ignore=shutil.ignore_patterns('__pycache__'))
    (package / 'control' / 'proportional.py').write_text(BLOCK)
    (package / 'nodes' / 'proportional_controller.py').write_text(NODE)
    row_before = "    NodeRow(\n        'signal_analyzer',"
    edit(package / 'graph' / 'catalog.py', (row_before, ROW + row_before))
    edit(package / 'simulation' / 'closed_loop.py', *BRANCH)
    bench.environment |= {'PYTHONPATH': str(package.parent), 'XDG_CACHE_HOME': str(tmp_path / 'cache')}
    return package.parent


def test_the_same_bits_in_simulate_in_rig_and_as_a_node_of_its_own(bench, copy):
    chosen = ('-p', 'controller:=proportional')
    arguments = ('-p', 'duration:=0.1', '-p', 'proportional_controller:stiffness:=0.04')
    for name in ('simulate', 'rig'):
        process = bench.start(name, *chosen, *arguments, '-p', f'run_dir:={name}', '-p', 'plot:=false')
        assert process.wait(COMPILED_IN) == 0, process.output
    nodes = ('bag_recorder', 'proportional_controller', 'ldv_sensor', 'vcm_plant', 'reference_generator')
    processes = bench.start_nodes('separate', *arguments, nodes=(*nodes, 'deterministic_timer'))
    for process in processes.values():
        assert process.wait() == 0, process.output
    for name in ('rig', 'separate'):
        compared = bench.python('-m', 'hdd_servo_ros.recording.compare_bags', 'simulate', name)
        assert (compared.returncode, compared.stdout.strip()) == (0, 'identical'), compared.stderr
    described = bench.run_yaml('rig')['nodes']['/proportional_controller']
    assert described['parameters']['stiffness'] == 0.04
    assert described['outputs'] == ['/control', '/estimates']


def test_help_launch_files_and_setup_know_it(bench, copy):
    code = (
        'import runpy; from hdd_servo_ros.graph import catalog, parameters_document; '
        f'assert catalog.__file__.startswith({str(copy)!r}); '
        'assert "proportional_controller" in runpy.run_path(catalog.__file__)["EXECUTABLES"]; '
        'assert catalog.CONTROLLERS["proportional"] == "proportional_controller"; '
        'assert "A proportional controller." in parameters_document.pages()['
        'parameters_document.page_of("proportional_controller")]'
    )
    found = bench.python('-c', code)
    assert found.returncode == 0, found.stderr
    for module in ('nodes.rig', 'simulation.simulate'):
        text = bench.python('-m', f'hdd_servo_ros.{module}', '--help').stdout
        assert 'adaptive_nn, pid, seek, open_loop, proportional, signal_analyzer' in text
        assert 'proportional_controller' in text
    text = bench.python('-m', 'hdd_servo_ros.nodes.proportional_controller', '--help').stdout
    assert 'stiffness (default 0.05)' in text
