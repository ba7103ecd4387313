"""The node of your own controller in one line: ``main = controller_main(MyController)``."""

from collections.abc import Callable, Sequence
from typing import Any

from hdd_servo_ros.graph.controller_loader import checked_controller

__all__ = ['controller_main']


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

    Raises
    ------
    ParameterError, ControllerError
        In ``main``, which prints it and returns 2, if the class is not a controller or rejects its parameters.

    Examples
    --------
    >>> from hdd_servo_ros.controllers import controller_main
    >>> from hdd_servo_ros.parameters import ParameterSet
    >>> class MyController:
    ...     def __init__(self, parameters: ParameterSet, sample_time: float) -> None:
    ...         self.parameters = parameters
    ...
    ...     def step(self, inputs):
    ...         return 0.5 * (inputs.desired_position - inputs.position)
    >>> main = controller_main(MyController)  # the module then ends with: sys.exit(main())
    >>> callable(main)
    True
    """

    def main(arguments: Sequence[str] | None = None) -> int:
        # Imported late: the file of a controller must be importable where there is no rclpy.
        from hdd_servo_ros.nodes.outside_controller import run_controller

        return run_controller(lambda: checked_controller(kind, kind.__name__), arguments)

    return main
