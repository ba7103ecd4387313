"""Message types of the loop, declared once, with the layout of their numbers; see ``cdr.py`` for their bytes."""

import dataclasses

AXES = ('x', 'y', 'z')
"""Components of a vector message."""
ACCELERATION_COMPONENTS = (*(f'linear.{axis}' for axis in AXES), *(f'angular.{axis}' for axis in AXES))
"""Components of an acceleration message."""


@dataclasses.dataclass(frozen=True)
class Codec:
    """
    Message type of the loop.

    Attributes
    ----------
    type_name
        ROS message type.
    components
        Names of the numbers of a message; empty if each message names its own numbers.
    width
        Number of float64 values at the end of a message; None if each message gives it itself.
    is_stamped
        Whether a message starts with its time. Otherwise, if it names its numbers, the first one is the time [s].
    """

    type_name: str
    components: tuple[str, ...]
    width: int | None
    is_stamped: bool


CLOCKS = Codec('rosgraph_msgs/msg/Clock', ('clock',), 0, is_stamped=True)
VECTORS = Codec('geometry_msgs/msg/Vector3Stamped', AXES, len(AXES), is_stamped=True)
ACCELERATIONS = Codec(
    'geometry_msgs/msg/AccelStamped', ACCELERATION_COMPONENTS, len(ACCELERATION_COMPONENTS), is_stamped=True
)
ARRAYS = Codec('std_msgs/msg/Float64MultiArray', (), None, is_stamped=False)
REPORTS = Codec('std_msgs/msg/Header', ('stamp', 'frame_id'), 0, is_stamped=True)
CODECS = {codec.type_name: codec for codec in (CLOCKS, VECTORS, ACCELERATIONS, ARRAYS, REPORTS)}
"""Codecs by message type."""
