"""
Simulated hard disk drive servo bench as a deterministic ROS 2 node graph.

``hdd_servo_ros.Run.open(path)`` reads a recorded run; see ``docs/howto/test-with-pytest.md``.
"""

import sys
from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily
from hdd_servo_ros.version import __version__

if TYPE_CHECKING:
    from hdd_servo_ros.testing.run import Run as Run

__all__ = ['Run', '__version__']


__getattr__ = lazily(__name__, {'Run': '.testing.run'})


if sys.argv[:1] == ['-m']:
    # ``python -m`` is starting an executable, which may draw plots: these do not depend on the settings of the user.
    from hdd_servo_ros.messages.plain_matplotlib import use_plain_matplotlib

    use_plain_matplotlib()
