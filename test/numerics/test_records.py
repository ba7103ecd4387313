"""Names for the numbers of an array: the same in Python and in compiled code."""

import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout, record, zeros

SPRING = layout('stiffness', 'force')
BODY = layout('gain', ('left', SPRING), ('right', SPRING), 'position')


@compiled
def stretch(spring, position):
    spring.force = spring.stiffness * position
    return spring.force


@compiled
def step(body, rows, control):
    b = record(body, BODY)
    b.position += b.gain * (control - stretch(b.left, b.position) - stretch(b.right, b.position))
    total = 0.0
    for i in range(len(rows)):
        total += record(rows, SPRING, i).force
    return b.position + total


def body():
    array = zeros(BODY)
    b = record(array, BODY)
    b.gain = 0.5
    b.left.stiffness = 2.0
    b.right.stiffness = 4.0
    b.position = 1.0
    return array


def test_names_write_the_numbers_of_the_array_in_order():
    array = body()
    assert array.tolist() == [0.5, 2.0, 0.0, 4.0, 0.0, 1.0]
    record(array, BODY).right.force = 7.0
    assert array[4] == 7.0
    assert BODY.isalignedstruct


@pytest.mark.parametrize('function', [step, cast(Any, step).py_func])
def test_a_kernel_reads_and_writes_by_name(function):
    array = body()
    assert function(array, np.array([[1.0, 10.0], [2.0, 20.0]]), 10.0) == 1.0 + 0.5 * 4.0 + 30.0
    assert array.tolist() == [0.5, 2.0, 2.0, 4.0, 4.0, 3.0]
    assert function(array, np.zeros((0, 2)), 0.0) == 3.0 - 0.5 * 18.0


def test_a_record_is_a_row():
    rows = np.zeros((3, 2))
    record(rows, SPRING, 1).force = 5.0
    assert rows.tolist() == [[0.0, 0.0], [0.0, 5.0], [0.0, 0.0]]
    assert record(rows, SPRING, -2).force == 5.0


def test_a_record_needs_exactly_its_size():
    with pytest.raises(ValueError, match=r'float64 and shape \(7,\) cannot hold records of 6 float64 numbers'):
        record(np.zeros(7), BODY)
    with pytest.raises(ValueError, match=r'shape \(12,\)'):
        record(np.zeros(12), BODY)
    with pytest.raises(ValueError, match='int64'):
        record(np.zeros(6, dtype=np.int64), BODY)
    with pytest.raises(ValueError, match='contiguous'):
        record(np.zeros(12)[::2], BODY)


KERNEL = """
from enum import IntEnum
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout, record, zeros

class Kind(IntEnum):
    LINEAR = 0
    SQUARE = 1
    CUBE = 2

LAW = layout('kind', 'gain')

@compiled
def law(constants, x):
    c = record(constants, LAW)
    kind = int(c.kind)
    if kind in (Kind.SQUARE, Kind.CUBE):
        x *= x
    if kind == Kind.CUBE:
        return c.gain * x * x
    return c.gain * x

if __name__ == '__main__':
    constants = zeros(LAW)
    record(constants, LAW).kind = Kind.SQUARE
    record(constants, LAW).gain = 3.0
    print(law(constants, 2.0), sum(law.stats.cache_hits.values()))
"""


def test_a_kernel_with_layouts_and_enumerations_is_compiled_once_for_all_processes(tmp_path, monkeypatch):
    script = tmp_path / 'law.py'
    script.write_text(KERNEL)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setenv('PYTHONPATH', str(Path(__file__).parents[2]))
    command = [sys.executable, str(script)]
    outputs = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)]
    assert outputs == ['12.0 0\n', '12.0 1\n']
