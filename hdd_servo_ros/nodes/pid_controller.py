"""`pid_controller`: the conventional baseline."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node


class PidController(ControllerNode):
    """The node around :class:`Pid`."""

    def __init__(self) -> None:
        super().__init__('pid_controller', PidParameters, Pid)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('pid_controller', PidController, arguments)


if __name__ == '__main__':
    sys.exit(main())
