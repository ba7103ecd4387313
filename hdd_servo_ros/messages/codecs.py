"""The types of the loop's messages, declared once: what each carries and where; see ``cdr.py`` for their bytes."""

import dataclasses

AXES = ('x', 'y', 'z')
"""The components of a vector message."""
ACCELERATION_COMPONENTS = (*(f'linear.{axis}' for axis in AXES), *(f'angular.{axis}' for axis in AXES))
"""The components of an acceleration message."""


@dataclasses.dataclass(frozen=True)
class Codec:
    """
    A message type of the loop.

    Attributes
    ----------
    type_name
        ROS message type.
    components
        Names of what a message carries; none if each message names its own numbers.
    width
        How many float64 stand at the end of a message; None if each message says so itself.
    is_stamped
        Whether a message begins with its time; one that does not, but names its numbers, has the time [s] as the first.
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
"""The codecs by the type of their messages."""
