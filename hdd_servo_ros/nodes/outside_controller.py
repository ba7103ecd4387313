"""`outside_controller`: node of a custom controller."""

import sys
from collections.abc import Callable, Sequence

from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.graph.controller_loader import ENTRY_POINTS, ControllerKind, load_controller
from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.exit_codes import command
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.ros.run_plan import RunPlan

USAGE = 'usage: outside_controller MODULE:CLASS [--help] [--ros-args ...]'
HELP = f"""{USAGE}

Node of a custom controller, given as the import path of a class or as the name of an entry point of the group
{ENTRY_POINTS}. Add --help to list the parameters of the controller."""


class OutsideControllerNode(ControllerNode):
    """
    Node of a custom controller class.

    Parameters
    ----------
    kind
        The class, loaded and checked.

    Raises
    ------
    ParameterError
        If a parameter is invalid, or the controller cannot be constructed or fails in a step with zeros.
    """

    def __init__(self, kind: ControllerKind) -> None:
        self._custom = kind
        self.make = kind.make
        try:
            super().__init__(kind.node, kind.make)
        except ControllerError as error:
            raise kind.rejected_trial(error) from error

    def offers(self) -> dict[str, str]:
        return self._custom.offers()

    def prepare(self, run: RunPlan) -> None:
        try:
            super().prepare(run)
        except (ParameterError, ControllerError) as error:
            raise RunError(str(error)) from error

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        try:
            super().step(tick, stamp, messages)
        except ControllerError as error:
            raise RunError(str(error)) from error

    def update(self) -> None:
        try:
            super().update()
        except ControllerError as error:
            raise RunError(str(error)) from error


@command('outside_controller')
def run_controller(find: Callable[[], ControllerKind], arguments: Sequence[str] | None = None) -> int:
    """Run the node of a controller class until its run ends; see :func:`run_node` for the exit codes."""
    kind = find()
    return run_node(kind.node, lambda: OutsideControllerNode(kind), arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node of the controller named by the first argument."""
    command_line = list(sys.argv if arguments is None else arguments)
    if len(command_line) < 2 or command_line[1].startswith('-'):
        asked = command_line[1:2] in (['--help'], ['-h'])
        print(HELP if asked else USAGE, file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    remaining = [command_line[0], *command_line[2:]]
    if arguments is None:
        # Not passed as arguments, because the node then runs like that of any other process.
        sys.argv = remaining
    return run_controller(lambda: load_controller(command_line[1]), None if arguments is None else remaining)


if __name__ == '__main__':
    sys.exit(main())
