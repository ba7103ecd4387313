from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hdd_servo_ros.drive.plant import PLANT_STATE, Plant, PlantParameters
from hdd_servo_ros.numerics.records import record

Array = npt.NDArray[np.float64]
Run = Callable[..., Array]


def _run(parameters: PlantParameters, sample_time: float, control: Any, state: dict[str, float] | None = None) -> Array:
    plant = Plant(parameters, sample_time)
    for name, value in (state or {}).items():
        setattr(record(plant.state, PLANT_STATE), name, value)
    rows = [(*plant.output(), *plant.state)]
    for tick, u in enumerate(np.asarray(control, dtype=np.float64).tolist(), start=1):
        rows.append((*plant.step(tick, u), *plant.state))
    return np.array(rows)


@pytest.fixture(scope='session')
def run() -> Run:
    """
    Run a plant through held controls; one row per tick.

    Columns: head position, head velocity, friction, then the seven states (rigid position, rigid velocity,
    amplifier, coil, deflection, mean friction, friction).
    """
    return _run
