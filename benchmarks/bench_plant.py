"""
Measure the cost of the drive's step: `python benchmarks/bench_plant.py`.

Prints three times per drive, each the best of several rounds: a step in a compiled loop, a step called from Python
(`Plant.step`), and a call of an empty compiled function from Python with the same arguments.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.parameters import MODELS, FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantArrays, PlantParameters, plant_step
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.numerics.compiled import compiled

Array = npt.NDArray[np.float64]

SAMPLE_TIME = 1.0e-4
TICKS = 200_000
ROUNDS = 5


@compiled
def steps(plant: PlantArrays, controls: Array) -> float:
    """Step through ``controls`` in compiled code."""
    last = 0.0
    for k in range(controls.size):
        last = plant_step(*plant, k + 1, controls[k], 0.0)[0]
    return last


@compiled
def nothing(
    constants: Array,
    nodes: Array,
    modes: Array,
    responses: Array,
    state: Array,
    motion: Array,
    tick: int,
    control: float,
    disturbance: float,
) -> tuple[float, float, float]:
    """Do nothing; arguments and result are those of the plant kernel."""
    return control, disturbance, 0.0


def best(function: Callable[[], object], count: int) -> float:
    """Return the shortest time of a round, divided by ``count`` [s]."""
    function()
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times) / count


def kernel_cost(parameters: PlantParameters, controls: Array) -> float:
    """Return the cost of a step in compiled code [s]."""
    plant = Plant(parameters, SAMPLE_TIME)
    return best(lambda: steps(plant.arrays, controls), controls.size)


def call_cost(function: Callable[..., object], parameters: PlantParameters, controls: list[float]) -> float:
    """Return the cost of a step called from Python [s]."""
    plant = Plant(parameters, SAMPLE_TIME)
    arrays = plant.arrays

    def run() -> None:
        for tick, control in enumerate(controls, start=1):
            function(*arrays, tick, control, 0.0)

    return best(run, len(controls))


def drives() -> dict[str, PlantParameters]:
    """Return the drives to time."""
    default = PlantParameters()
    sixteen = ResonanceParameters(
        form='parallel',
        frequencies=tuple(1000.0 * (i + 1) for i in range(16)),
        damping_ratios=(0.02,) * 16,
        residues=(0.1,) * 16,
    )
    network = FrictionParameters(
        model='rbf_network', node_positions=(0.0,) * 25, node_velocities=(0.0,) * 25, node_weights=(0.01,) * 25
    )
    named = {
        'default (LuGre, 4 modes)': default,
        'LuGre, 16 parallel modes': replace(default, resonance=sixteen),
        'LuGre, 4 modes, current driver': replace(default, actuator=ActuatorParameters(driver='current')),
    }
    for model in MODELS:
        if model != 'lugre':
            friction = network if model == 'rbf_network' else FrictionParameters(model=model)
            named[f'{model}, 4 modes'] = replace(default, friction=friction)
    return named


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--all', action='store_true', help='measure every friction model, not only the default drive')
    chosen = parser.parse_args().all
    random = np.random.default_rng(1)
    controls = 0.2 * random.normal(size=TICKS)
    few = controls[: TICKS // 4].tolist()
    print(f'one tick of {1e6 * SAMPLE_TIME:.0f} us, default substeps; best of {ROUNDS} rounds, ns')
    print(f'{"drive":<42}{"in compiled code":>18}{"from Python":>14}{"empty call":>12}')
    for name, parameters in drives().items():
        inside = 1e9 * kernel_cost(parameters, controls)
        outside = 1e9 * call_cost(plant_step, parameters, few)
        bare = 1e9 * call_cost(nothing, parameters, few)
        print(f'{name:<42}{inside:>18.0f}{outside:>14.0f}{bare:>12.0f}')
        if not chosen:
            break


if __name__ == '__main__':
    main()
