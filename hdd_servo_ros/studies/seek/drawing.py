"""Styles that the figures share."""

from typing import Any

from matplotlib.axes import Axes

from hdd_servo_ros.studies.seek.cases import NARROW

STYLES: dict[str, dict[str, Any]] = {
    'final_state': {'color': 'C0', 'label': 'final-state control'},
    'cnf': {'color': 'C1', 'label': 'CNF'},
    'ptos': {'color': 'C2', 'label': 'PTOS'},
    'trajectory': {'color': 'C4', 'label': 'PID on a minimum-jerk reference'},
    'pid': {'color': '0.45', 'label': 'PID on the step'},
}
"""Of the lines of access times, by method."""
FRICTION_STYLES: dict[float, dict[str, Any]] = {
    0.8: {'color': 'C1', 'label': 'friction 20 % below the model'},
    1.0: {'color': 'C0', 'label': 'friction of the model'},
    1.2: {'color': 'C3', 'label': 'friction 20 % above the model'},
}
"""By the friction of the drive over that of the controller's model."""


def narrow_band(axes: Axes) -> None:
    """Mark the errors within the narrow tolerance, on an axis in nm."""
    axes.axhspan(-1e3 * NARROW, 1e3 * NARROW, color='0.92', zorder=0)
