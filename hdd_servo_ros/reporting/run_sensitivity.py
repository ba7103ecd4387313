"""Stability margin of a recorded run: the peak sensitivity with the recorded estimates."""

import dataclasses
import math
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.graph.block_parameters import (
    block_parameters,
    dsp_parameters,
    input_parameters,
    observer_parameters,
    sensor_scales,
)
from hdd_servo_ros.graph.recorded_nodes import kind_by_name, recorded_parameters
from hdd_servo_ros.messages.topics import ESTIMATES
from hdd_servo_ros.recording.recorded_run import RecordedRun

if TYPE_CHECKING:
    from hdd_servo_ros.analysis.fragility import LoopSurroundings
    from hdd_servo_ros.analysis.sensitivity import LinearController

PLANT, SENSOR, SERVO_SENSOR = 'vcm_plant', 'ldv_sensor', 'servo_sensor'
CONTROLLERS = {'adaptive_nn': 'adaptive_nn_controller', 'pid': 'pid_controller', 'seek': 'seek_controller'}
"""Nodes of the controllers with a linear loop."""
SAMPLES = 48
"""Number of ticks, evenly spaced over the run, at which Ms is computed in addition to the extreme estimates."""


@dataclasses.dataclass(frozen=True)
class RunSensitivity:
    """
    Peak sensitivity Ms of a run; infinite if the loop is unstable.

    Attributes
    ----------
    at_end
        Ms with the final estimates.
    largest, largest_tick
        Largest Ms during the run, and a tick where it occurs.
    estimates
        The estimates at that tick, as text; empty for a controller without estimates.
    limit
        Largest Ms with a sufficient stability margin.
    """

    at_end: float
    largest: float
    largest_tick: int
    limit: float
    estimates: str = ''


def why_no_sensitivity(run: RecordedRun) -> str:
    """Return why the peak sensitivity is unknown; empty if it is known, or not defined for the loop."""
    node = CONTROLLERS.get(run.controller)
    if node is None:
        return ''
    nodes = parameters_at_start(run)
    missing = [name for name in (PLANT, node) if name not in nodes]
    if missing:
        return f'run.yaml has no parameters of {" and ".join(missing)}'
    if node == 'adaptive_nn_controller' and ESTIMATES.name not in run:
        return f'the bag has no /{ESTIMATES.name}'
    changed = {
        kind_by_name(run.description, change.node) for change in run.parameter_changes if change.name != 'reset_count'
    }
    changed &= {PLANT, SENSOR, SERVO_SENSOR, node}
    return f'parameters of {" and ".join(sorted(changed))} were changed during the run' if changed else ''


_FOUND: weakref.WeakKeyDictionary[RecordedRun, RunSensitivity | None] = weakref.WeakKeyDictionary()


def run_sensitivity(run: RecordedRun) -> RunSensitivity | None:
    """
    Return the peak sensitivity of a run.

    None if it is unknown (see :func:`why_no_sensitivity`), not defined for the controller, or not computable because of
    overflow.
    """
    node = CONTROLLERS.get(run.controller)
    if node is None or why_no_sensitivity(run):
        return None
    if run not in _FOUND:
        from hdd_servo_ros.analysis.fragility import UNCOMPUTABLE

        try:
            with np.errstate(all='ignore'):
                _FOUND[run] = _computed(run, node)
        except UNCOMPUTABLE:
            _FOUND[run] = None
    return _FOUND[run]


def _computed(run: RecordedRun, node: str) -> RunSensitivity:
    # Imported late: only these need the compiled blocks.
    from hdd_servo_ros.analysis.fragility import MAX_ADAPTED_SENSITIVITY, ROUNDING, named_estimates
    from hdd_servo_ros.analysis.linear_laws import FrozenEstimates, pid_law
    from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY
    from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
    from hdd_servo_ros.control.pid import PidParameters

    loop = loop_surroundings(run, node)
    law = block_parameters(node, parameters_at_start(run)[node])
    if isinstance(law, PidParameters):
        ms = loop.margins.peak_sensitivity(pid_law(law, loop.delay))
        return RunSensitivity(ms, ms, _first_tick(run), MAX_SENSITIVITY + ROUNDING)
    frozen = loop.frozen_loop(AdaptiveNn(law, run.sample_time))
    if law.desired.enabled:
        # The estimates multiply signals of the reference, so that the loop is constant.
        ms = frozen.peak_sensitivity(FrozenEstimates(0.0, 0.0))
        return RunSensitivity(ms, ms, _first_tick(run), MAX_SENSITIVITY + ROUNDING)
    found = _checked_estimates(run, law.error_filter_lambda)
    points = [FrozenEstimates(*estimates) for estimates in found.values()]
    at_end = frozen.peak_sensitivity(points[-1])
    largest, where = frozen.worst_of(points)
    tick, text = list(found)[points.index(where)], named_estimates(where, loop.plant)
    return RunSensitivity(at_end, max(at_end, largest), tick, MAX_ADAPTED_SENSITIVITY, text)


def loop_surroundings(run: RecordedRun, node: str) -> 'LoopSurroundings':
    """Return the loop without its controller, from the parameters of drive, vibrometer and controller."""
    from hdd_servo_ros.analysis.fragility import LoopSurroundings

    nodes = parameters_at_start(run)
    own = nodes[node]
    sensor = block_parameters(SENSOR, nodes[SENSOR]) if SENSOR in nodes else None
    return LoopSurroundings(
        block_parameters(PLANT, nodes[PLANT]),
        run.sample_time,
        dsp_parameters(node, own).computation_delay,
        sensor,
        None if sensor is None else sensor_scales(input_parameters(node, own), sensor),
        observer_parameters(node, own) if SERVO_SENSOR in nodes else None,
        dsp_parameters(node, own),
    )


def linear_controller_at_end(run: RecordedRun) -> 'LinearController':
    """Return the linear controller with the final estimates; see :func:`why_no_sensitivity`."""
    from hdd_servo_ros.analysis.linear_laws import FrozenEstimates, frozen_law, pid_law
    from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
    from hdd_servo_ros.control.pid import PidParameters

    node = CONTROLLERS[run.controller]
    own = parameters_at_start(run)[node]
    law, delay = block_parameters(node, own), dsp_parameters(node, own).computation_delay
    if isinstance(law, PidParameters):
        return pid_law(law, delay)
    estimates = FrozenEstimates(*(float(run.estimates[name][-1]) for name in FrozenEstimates._fields))
    return frozen_law(AdaptiveNn(law, run.sample_time), estimates, delay)


def low_margin_of(run: RecordedRun) -> str:
    """Return a line about a low stability margin; empty if it is sufficient or unknown."""
    found = run_sensitivity(run)
    if found is None or not found.largest > found.limit:
        return ''
    when = (
        f', with the estimates at {found.largest_tick * run.sample_time:g} s ({found.estimates})'
        if found.estimates
        else ''
    )
    if math.isinf(found.largest):
        return f'low stability margin: the linear loop{when} is unstable'
    ms = f'{found.largest:.3g}, above {found.limit:.1f}'
    return f'low stability margin: the linear loop{when} has a peak sensitivity of {ms}'


def parameters_at_start(run: RecordedRun) -> dict[str, dict[str, Any]]:
    """Return the initial parameters by node name without namespace."""
    return recorded_parameters(run.description)


def _first_tick(run: RecordedRun) -> int:
    return 0 if run.is_long else int(run.ticks[0])


def _checked_estimates(run: RecordedRun, error_filter_lambda: float) -> dict[int, tuple[float, float]]:
    """
    Return sigma_hat and m_hat by the tick, ascending.

    They are those of some ticks evenly over a run, and those where an estimate, or the damping of both, is extreme.
    """
    first, last = _first_tick(run), run.last_tick
    even = np.unique(np.linspace(0, last - first if run.is_long else len(run.ticks) - 1, SAMPLES).round().astype(int))
    found: dict[int, tuple[float, float]] = {}
    extremes: dict[tuple[int, int], tuple[float, int, tuple[float, float]]] = {}
    begun = 0
    for piece in run.pieces([ESTIMATES.name]):
        sigma_hat, m_hat = piece.estimates['sigma_hat'], piece.estimates['m_hat']

        def at(row: int, sigma: NDArray[np.float64] = sigma_hat, m: NDArray[np.float64] = m_hat) -> tuple[float, float]:
            return float(sigma[row]), float(m[row])

        for row in (even[(even >= begun) & (even < begun + len(m_hat))] - begun).tolist():
            found[int(piece.ticks[row])] = at(row)
        for index, values in enumerate((sigma_hat, m_hat, error_filter_lambda * m_hat - sigma_hat)):
            for sign in (-1, 1):
                row = int(np.argmax(sign * values))
                value = float(sign * values[row])
                if (index, sign) not in extremes or value > extremes[index, sign][0]:
                    extremes[index, sign] = value, int(piece.ticks[row]), at(row)
        begun += len(m_hat)
    found |= {tick: estimates for _, tick, estimates in extremes.values()}
    return dict(sorted(found.items()))
