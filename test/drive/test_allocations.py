"""Nothing allocates in the loop."""

from collections.abc import Callable
from typing import Any

import numba.core.runtime._nrt_python as nrt
import pytest
from numba.core.runtime.nrt import rtsys

from hdd_servo_ros.drive.friction.parameters import MODELS, FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantArrays, PlantParameters, plant_step
from hdd_servo_ros.numerics.compiled import jit


@jit
def steps(arrays: PlantArrays, count: int) -> float:
    last = 0.0
    for k in range(count):
        last = plant_step(*arrays, k + 1, 0.1, 0.0)[0]
    return last


@jit
def allocating_steps(arrays: PlantArrays, count: int) -> float:
    last = 0.0
    for k in range(count):
        last = plant_step(arrays[0].copy(), *arrays[1:], k + 1, 0.1, 0.0)[0]
    return last


def allocations(function: Callable[..., float], parameters: PlantParameters, count: int) -> int:
    plant = Plant(parameters, 1.0e-4)
    before = rtsys.get_allocation_stats().alloc
    function(plant.arrays, count)
    return int(rtsys.get_allocation_stats().alloc - before)


NODES: dict[str, Any] = {'node_positions': (0.0, 5.0), 'node_velocities': (0.0, 900.0), 'node_weights': (0.1, -0.1)}


@pytest.mark.parametrize('model', MODELS)
def test_a_thousand_steps_allocate_as_much_as_none(model: str) -> None:
    nrt.memsys_enable_stats()
    parameters = PlantParameters(friction=FrictionParameters(model=model, **NODES))
    few = allocations(steps, parameters, 0)
    assert allocations(steps, parameters, 1000) == few
    # The count does see allocations.
    assert allocations(allocating_steps, parameters, 1000) >= few + 1000
