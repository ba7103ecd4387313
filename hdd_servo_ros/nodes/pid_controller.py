"""`pid_controller`: conventional PID baseline."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.nodes.controller_node import run_plain_controller


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_plain_controller('pid_controller', arguments)


if __name__ == '__main__':
    sys.exit(main())
