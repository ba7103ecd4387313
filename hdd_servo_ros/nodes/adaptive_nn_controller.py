"""`adaptive_nn_controller`: the adaptive neural network controller, eqs. (4.10) to (4.21)."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node


class AdaptiveNnController(ControllerNode):
    """The node around :class:`AdaptiveNn`."""

    def __init__(self) -> None:
        super().__init__('adaptive_nn_controller', AdaptiveNnParameters, AdaptiveNn)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('adaptive_nn_controller', AdaptiveNnController, arguments)


if __name__ == '__main__':
    sys.exit(main())
