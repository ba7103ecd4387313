"""Simulation in this process with its signals in memory: without a bag, another process, or output."""

from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.recording.parameter_history import ParameterChange, plain_value
from hdd_servo_ros.recording.run_in_memory import RunInMemory
from hdd_servo_ros.recording.run_recorder import controller_name
from hdd_servo_ros.simulation.pieces import run_piece
from hdd_servo_ros.simulation.run_setup import Simulation


def run_in_memory(simulation: Simulation) -> RunInMemory:
    """
    Run a simulation from start to end and return it; a failed run contains the ticks before the failure.

    The signals are bit-identical to those that ``rig`` and ``simulate`` record with the same parameters.
    """
    period = sample_time_to_nanoseconds(simulation.timer.sample_time)
    # Before the run, because the run consumes the schedule.
    description = simulation.description()
    all_rows = simulation.experiment.empty_rows(0, simulation.last_tick + 1)
    outcome, done = FINISHED_OUTCOME, 0
    changed: list[ParameterChange] = []
    for first_tick, count in simulation.pieces(simulation.last_tick):
        outcome, valid, changes = run_piece(simulation, first_tick, count, all_rows.part(first_tick, count))
        changed += [
            ParameterChange(change.time_ns // period, change.node, name, plain_value(value))
            for change in changes
            for name, value in change.values.items()
        ]
        done += len(valid)
        if outcome != FINISHED_OUTCOME:
            break
    nodes = {
        name: {**node, 'parameters': {key: plain_value(value) for key, value in node['parameters'].items()}}
        for name, node in description['nodes'].items()
    }
    return RunInMemory(
        all_rows.before(done),
        {
            'controller': controller_name(nodes),
            'topics': {topic.name: name for topic, name in simulation.topics},
            **description,
            'nodes': nodes,
            'last_tick': done - 1,
            'status': outcome.status,
            'reason': outcome.reason,
        },
        changed,
    )
