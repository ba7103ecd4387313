"""Styles shared by the figures."""

from typing import Any

from matplotlib.axes import Axes

from hdd_servo_ros.studies.seek.cases import NARROW

STYLES: dict[str, dict[str, Any]] = {
    'final_state': {'color': 'C0', 'label': 'final-state control'},
    'cnf': {'color': 'C1', 'label': 'CNF'},
    'ptos': {'color': 'C2', 'label': 'PTOS'},
    'trajectory': {'color': 'C4', 'label': 'PID with minimum-jerk reference'},
    'pid': {'color': '0.45', 'label': 'PID with step reference'},
}
"""Line styles of access times, by method."""
FRICTION_STYLES: dict[float, dict[str, Any]] = {
    0.8: {'color': 'C1', 'label': 'friction 20 % below model'},
    1.0: {'color': 'C0', 'label': 'friction as in model'},
    1.2: {'color': 'C3', 'label': 'friction 20 % above model'},
}
"""Line styles, by friction of the drive relative to the model of the controller."""


def narrow_band(axes: Axes) -> None:
    """Shade the narrow tolerance on an axis in nm."""
    axes.axhspan(-1e3 * NARROW, 1e3 * NARROW, color='0.92', zorder=0)
