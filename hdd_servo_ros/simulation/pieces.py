"""Simulation in pieces: a piece ends at a scheduled change or at the chunk size."""

from hdd_servo_ros.control.controller import ReportsFault
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME, Outcome, failed
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.parameters.events import NodeChange
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
        Simulation to continue.
    first_tick, count
        First tick and number of ticks; scheduled changes are allowed at the first tick only.
    rows
        Output rows for ``count`` ticks.

    Returns
    -------
    outcome, valid, changes
        Outcome so far, the rows before a failure (all rows without one), and the scheduled changes at the first tick.
    """
    outcome, changes = FINISHED_OUTCOME, []
    rows = rows.starting_at(first_tick)
    try:
        for change in simulation.apply_schedule(first_tick):
            changes.append(change)
        simulation.experiment.run(first_tick, count, rows)
    except ControllerError as error:
        # A change that fails belongs to the end of the previous tick.
        outcome, rows = failed(str(error)), rows.before(max(error.tick, first_tick))
    invalid = first_not_finite(rows)
    if invalid is not None:
        law = simulation.experiment.controller
        fault = law.fault() if isinstance(law, ReportsFault) else ''
        outcome, rows = failed(fault or simulation.not_finite(*invalid)), rows.before(invalid[1])
    return outcome, rows, changes
