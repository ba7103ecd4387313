"""Runs a simulation piece by piece: the ticks between two scheduled changes, or as many as are computed at once."""

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
