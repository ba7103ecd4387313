"""Node of a custom controller in one line: ``main = controller_main(MyController)``."""

from collections.abc import Callable, Sequence
from typing import Any

from hdd_servo_ros.graph.controller_loader import checked_controller

__all__ = ['controller_main']


def controller_main(kind: type[Any]) -> Callable[[Sequence[str] | None], int]:
    """
    Return the ``main`` function of a node for a controller class: ``main = controller_main(MyController)``.

    Parameters
    ----------
    kind
        The controller class.

    Returns
    -------
    main
        Function that runs the node and returns its exit code, like the nodes of this package. Its argument is the
        command line; ``sys.argv`` if None.

    Raises
    ------
    ParameterError, ControllerError
        In ``main``, if the class is not a controller or rejects its parameters; ``main`` prints it and returns 2.

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
        # Imported here, because the file of a controller must be importable without rclpy.
        from hdd_servo_ros.nodes.outside_controller import run_controller

        return run_controller(lambda: checked_controller(kind, kind.__name__), arguments)

    return main
