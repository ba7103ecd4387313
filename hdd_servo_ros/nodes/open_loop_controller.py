"""`open_loop_controller`: drives the plant open loop, u = x of `/reference`."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.control.open_loop import OpenLoop, OpenLoopParameters
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node


class OpenLoopController(ControllerNode):
    """The node around :class:`OpenLoop`."""

    def __init__(self) -> None:
        super().__init__('open_loop_controller', OpenLoopParameters, OpenLoop)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('open_loop_controller', OpenLoopController, arguments)


if __name__ == '__main__':
    sys.exit(main())
