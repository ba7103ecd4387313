"""The node of your own controller in one line: ``main = controller_main(MyController)``."""

from collections.abc import Callable, Sequence
from typing import Any

from hdd_servo_ros.graph.controller_loader import checked_controller


def controller_main(kind: type[Any]) -> Callable[[Sequence[str] | None], int]:
    """
    Return the ``main`` of a node around a controller class: ``main = controller_main(MyController)``.

    Parameters
    ----------
    kind
        The class.

    Returns
    -------
    main
        Runs the node and returns its exit code, as the nodes of this package do; takes the command line, ``sys.argv``
        if None.
    """

    def main(arguments: Sequence[str] | None = None) -> int:
        # Imported late: the file of a controller must be importable where there is no rclpy.
        from hdd_servo_ros.nodes.outside_controller import run_controller

        return run_controller(lambda: checked_controller(kind, kind.__name__), arguments)

    return main
