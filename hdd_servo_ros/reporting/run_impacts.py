"""Impacts on the crash stops in a recorded run, by simulating the drive with the recorded voltages."""

import weakref
from typing import TYPE_CHECKING

from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.messages.topics import CONTROL, DISTURBANCE, HEAD
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.run_sensitivity import PLANT, parameters_at_start

if TYPE_CHECKING:
    from hdd_servo_ros.drive.travel import StopImpacts

_FOUND: 'weakref.WeakKeyDictionary[RecordedRun, dict[str, StopImpacts]]' = weakref.WeakKeyDictionary()


def has_stops(run: RecordedRun) -> bool:
    """Return whether the drive of a run is known to have crash stops."""
    parameters = parameters_at_start(run).get(PLANT, {})
    return any(parameters.get(name, 0.0) != 0.0 for name in ('travel.lower', 'travel.upper'))


def why_no_impacts(run: RecordedRun) -> str:
    """Return why the impacts on the crash stops are unknown; empty if they are known, or without crash stops."""
    if not has_stops(run):
        return ''
    missing = [f'/{topic.name}' for topic in (CONTROL, HEAD) if topic.name not in run]
    if missing:
        return f'the bag has no {" and no ".join(missing)}'
    if not run.is_long and run.ticks[0] != 0:
        return 'the bag does not start at tick 0'
    if any(change.node.rpartition('/')[2] == PLANT for change in run.parameter_changes):
        return f'parameters of {PLANT} were changed during the run'
    if _impacts(run) is None:
        return f'/{HEAD.name} is not the motion of the drive of run.yaml'
    return ''


def run_impacts(run: RecordedRun) -> 'dict[str, StopImpacts] | None':
    """Return the impacts on each crash stop that was hit; None without stops or if they are unknown."""
    if not has_stops(run) or why_no_impacts(run):
        return None
    return _impacts(run)


def _impacts(run: RecordedRun) -> 'dict[str, StopImpacts] | None':
    """Simulate the drive; return None if its head does not end at the recorded position."""
    if run not in _FOUND:
        # Imported late: only this needs the compiled block.
        from hdd_servo_ros.drive.plant import Plant

        plant = Plant(block_parameters(PLANT, parameters_at_start(run)[PLANT]), run.sample_time)
        tick = 0
        head: list[float] = []
        waiting: list[tuple[float, float]] = []
        for piece in run.pieces([CONTROL.name, HEAD.name, DISTURBANCE.name]):
            voltages = piece.command.tolist()
            forces = piece[DISTURBANCE.name][:, 0].tolist() if DISTURBANCE.name in piece else [0.0] * len(voltages)
            # The command of the last tick acts only after the end of the recording.
            inputs = waiting + list(zip(voltages, forces, strict=True))
            waiting = [inputs.pop()]
            for voltage, force in inputs:
                tick += 1
                plant.step(tick, voltage, force)
            head = piece[HEAD.name][-1].tolist()
        if plant.output() != tuple(head):
            return None
        _FOUND[run] = plant.impacts
    return _FOUND[run]
