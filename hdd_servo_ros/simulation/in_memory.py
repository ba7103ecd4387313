"""Runs a simulation in this process and keeps its signals in memory: no bag, no process, no output."""

from hdd_servo_ros.control.controller import ReportsFault
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME, Outcome, failed
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.parameters.events import NodeChange
from hdd_servo_ros.recording.parameter_history import ParameterChange, plain_value
from hdd_servo_ros.recording.run_in_memory import RunInMemory
from hdd_servo_ros.recording.run_recorder import controller_name
from hdd_servo_ros.simulation.packing import first_not_finite
from hdd_servo_ros.simulation.run_setup import Simulation


def run_piece(
    simulation: Simulation, first_tick: int, count: int, rows: SignalRows
) -> tuple[Outcome, SignalRows, list[NodeChange]]:
    """
    Run the next ticks of a simulation.

    Parameters
    ----------
    simulation
        What runs.
    first_tick, count
        Which ticks; no scheduled change may be inside of them.
    rows
        Rows of so many ticks, which are written.

    Returns
    -------
    outcome, valid, changes
        Whether the run can go on, the rows up to where it cannot, and the scheduled changes of the first tick.
    """
    outcome, changes = FINISHED_OUTCOME, []
    rows = rows.starting_at(first_tick)
    try:
        for change in simulation.apply_schedule(first_tick):
            changes.append(change)
        simulation.experiment.run(first_tick, count, rows)
    except ControllerError as error:
        # A change that fails does so after the tick before.
        outcome, rows = failed(str(error)), rows.before(max(error.tick, first_tick))
    invalid = first_not_finite(rows)
    if invalid is not None:
        law = simulation.experiment.controller
        fault = law.fault() if isinstance(law, ReportsFault) else ''
        outcome, rows = failed(fault or simulation.not_finite(*invalid)), rows.before(invalid[1])
    return outcome, rows, changes


def run_in_memory(simulation: Simulation) -> RunInMemory:
    """
    Run a whole simulation that has not begun, and return it; one that fails has the ticks before that.

    The signals are those that `rig` and `simulate` record with the same parameters, to the bit.
    """
    period = sample_time_to_nanoseconds(simulation.timer.sample_time)
    # Before the run: a schedule is used up by it.
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
