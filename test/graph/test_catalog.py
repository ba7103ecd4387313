"""The catalog: its import paths exist, and it needs only the standard library."""

import dataclasses
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.graph.catalog import COMMANDS, CONTROLLERS, EXECUTABLES, NODES, CommandRow, NodeRow, resolve
from hdd_servo_ros.graph.rig_parameters import RigParameters
from hdd_servo_ros.messages import topics
from hdd_servo_ros.parameters import ParameterSet
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.simulation.closed_loop import Controllers

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize('row', NODES.values(), ids=list(NODES))
def test_every_path_of_a_node_leads_somewhere(row):
    assert callable(importlib.import_module(f'hdd_servo_ros.{row.module}').main)
    for kind in row.parameter_sets:
        assert issubclass(kind, ParameterSet)
        kind()
    if row.block:
        block = resolve(row.block)(row.block_parameters(), 1e-4)
        assert callable(block.step)
        assert callable(block.update)
    if row.node:
        assert issubclass(resolve(row.node), LoopNode)
    else:
        assert row.role == catalog.CONTROLLER
        assert row.block


@pytest.mark.parametrize('row', COMMANDS.values(), ids=list(COMMANDS))
def test_every_path_of_a_command_leads_somewhere(row):
    assert callable(importlib.import_module(f'hdd_servo_ros.{row.module}').main)
    for kind in row.parameter_sets:
        assert issubclass(kind, ParameterSet)


def test_names():
    assert len(set(EXECUTABLES)) == len(EXECUTABLES)
    rows: tuple[NodeRow | CommandRow, ...] = (*NODES.values(), *COMMANDS.values())
    for row in rows:
        assert row.purpose.endswith('.')
        assert catalog.purpose(row.name) == row.purpose
        assert dataclasses.is_dataclass(row)


def test_every_module_of_a_node_has_its_row():
    """A module of an executable has a `main`; it is in the catalog."""
    stems = {path.stem for path in (ROOT / 'hdd_servo_ros' / 'nodes').glob('*.py')}
    with_main = {
        stem
        for stem in stems
        if re.search(r'^def main\(', (ROOT / 'hdd_servo_ros' / 'nodes' / f'{stem}.py').read_text(), re.MULTILINE)
    }
    of_rows = {catalog.executable_module(name) for name in EXECUTABLES}
    assert {f'nodes.{stem}' for stem in with_main} == {module for module in of_rows if module.startswith('nodes.')}


def test_the_controllers_of_the_rows_are_those_of_the_compiled_loop():
    assert set(Controllers._fields) <= set(CONTROLLERS)
    blocks = {NODES[CONTROLLERS[name]].block for name in Controllers._fields}
    assert {NODES[node].block for node in CONTROLLERS.values()} == blocks
    assert {row.name for row in NODES.values() if row.role == topics.CONTROLLER} == set(CONTROLLERS.values())
    for name in CONTROLLERS:
        RigParameters(controller=name)
        assert name in next(
            field.metadata['declaration'].description
            for field in dataclasses.fields(RigParameters)
            if field.name == 'controller'
        )


def test_nodes_of_a_run():
    assert catalog.nodes_of_run({'controller': 'pid_controller'}) == (
        'deterministic_timer',
        'reference_generator',
        'vcm_plant',
        'ldv_sensor',
        'pid_controller',
        'bag_recorder',
    )
    assert 'controller' not in catalog.nodes_of_run({})


@pytest.fixture
def rows():
    before = dict(NODES)
    yield NODES
    NODES.clear()
    NODES.update(before)


def test_a_custom_controller_gets_a_row(rows):
    @dataclasses.dataclass(frozen=True)
    class Gains(ParameterSet):
        pass

    catalog.register_controller('mine', Gains, 'Mine.')
    assert rows['mine'].block_parameters is Gains
    assert catalog.parameter_sets('mine')[:-1] == catalog.parameter_sets('pid_controller')[:-1]
    assert catalog.nodes_of_run({'controller': 'mine'})[-2:] == ('mine', 'bag_recorder')
    catalog.register_controller('mine', Gains, 'Mine again.')
    for taken in ('vcm_plant', 'rig'):
        with pytest.raises(ValueError, match=f'there is another node {taken}'):
            catalog.register_controller(taken, Gains, 'Mine.')


def test_read_where_nothing_is_installed():
    """As setup.py reads it when pip builds the package in an isolated environment."""
    code = f"""
import runpy
rows = runpy.run_path({str(ROOT / 'hdd_servo_ros' / 'graph' / 'catalog.py')!r})
print(*rows['EXECUTABLES'])
import sys
assert not [name for name in sys.modules if name.partition('.')[0] in ('hdd_servo_ros', 'numpy', 'numba', 'rclpy')]
"""
    found = subprocess.run([sys.executable, '-I', '-S', '-c', code], capture_output=True, text=True, timeout=250)
    assert found.returncode == 0, found.stderr
    assert found.stdout.split() == list(EXECUTABLES)
