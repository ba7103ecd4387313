"""Body of the ``main`` function of every node: arguments, ROS context, lockstep and exit code."""

import atexit
import contextlib
import dataclasses
import os
import signal
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hdd_servo_ros.graph.catalog import names_with_parameters
from hdd_servo_ros.graph.help import COMPILING, parse_help
from hdd_servo_ros.graph.known_parameters import reject_unknown
from hdd_servo_ros.graph.known_sections import doubtful_sections
from hdd_servo_ros.messages.exit_codes import FAILED as FAILED_CODE
from hdd_servo_ros.messages.exit_codes import guard, one_line
from hdd_servo_ros.messages.outcome import FAILED, Outcome, failed
from hdd_servo_ros.numerics.kernel_folder import first_compilation
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, RosArguments, parse_ros_arguments, with_node
from hdd_servo_ros.parameters.run_parameters import TimerParameters
from hdd_servo_ros.parameters.schedule import reject_unknown_nodes
from hdd_servo_ros.ros.exit_deadline import SHUTDOWN_TIMEOUT, exit_deadline, start_deadline
from hdd_servo_ros.ros.lockstep import SIGNALS, Lockstep
from hdd_servo_ros.ros.log_folder import find_log_folder
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.member import CURE
from hdd_servo_ros.ros.newcomer import Lookout, outputs_of
from hdd_servo_ros.ros.topic_claims import ClaimError, TopicClaims
from hdd_servo_ros.ros.transport import (
    check_domain,
    keeps_to_this_machine,
    keeps_to_this_process,
    use_udp_alone,
    who_can_reach,
)


def run_node(name: str, make: Callable[[], LoopNode], arguments: Sequence[str] | None = None) -> int:
    """
    Run one loop node in this process until its run ends.

    Parameters
    ----------
    name
        Executable name for the help text.
    make
        Function that constructs the node.
    arguments
        Command line; ``sys.argv`` if None.

    Returns
    -------
    int
        Exit code: 0 finished, 1 failed, 2 invalid arguments or parameters, 128 + signal number when interrupted.
    """
    return run_nodes(name, lambda _: Composition([make()]), arguments)


@dataclasses.dataclass(frozen=True)
class Composition:
    """
    Nodes of a process.

    Attributes
    ----------
    nodes, others, intra_process
        See :class:`~hdd_servo_ros.ros.lockstep.Lockstep`.
    """

    nodes: Sequence[LoopNode]
    others: Sequence[Node] = ()
    intra_process: bool = False


def run_nodes(name: str, make: Callable[[RosArguments], Composition], arguments: Sequence[str] | None = None) -> int:
    """Run several loop nodes in this process; ``make`` receives the command line. See :func:`run_node`."""
    exit_code = guard(name, lambda: _run_nodes(name, make, arguments))
    if arguments is None:
        # Python and Fast DDS destroy the remaining nodes while the process exits.
        atexit.register(start_deadline, SHUTDOWN_TIMEOUT, exit_code)
    return exit_code


def _run_nodes(name: str, make: Callable[[RosArguments], Composition], arguments: Sequence[str] | None) -> int:
    command_line = list(sys.argv if arguments is None else arguments)
    check_domain(os.environ)
    warning = who_can_reach(os.environ)
    use_udp_alone(os.environ)
    find_log_folder(os.environ)
    try:
        # Parsed before ROS does, because the errors of ROS name lines of its C sources.
        given = parse_ros_arguments(command_line[1:])
        parse_help(name, given.others)
        # The lockstep handles signals and ends a run at a tick boundary; rclpy would shut down the context at once.
        rclpy.init(args=command_line, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise error if hasattr(error, 'exit_code') else ArgumentError(one_line(error)) from None
    if warning:
        print(f'{name}: warning: {warning}', file=sys.stderr, flush=True)
    if first_compilation():
        print(f'{name}: {COMPILING}', file=sys.stderr, flush=True)
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    exit_code = FAILED_CODE
    try:
        lookout = None if keeps_to_this_machine(os.environ) else Lookout()
        with given.naming_files():
            composition = make(given)
            nodes = composition.nodes
            own = {name for node in nodes for name in node.parameters.as_mapping()}
            for node in nodes:
                try:
                    reject_unknown(node.parameters.unknown, own)
                except ParameterError as error:
                    # A parameter given for all nodes is unknown to all of them.
                    raise error if given.is_for_all(error.name) else with_node(error, node.get_name()) from None
            # ROS would ignore parameters for a node that does not exist; `simulate` rejects them too.
            given.check_nodes([*names_with_parameters(), *(node.get_name() for node in nodes)])
            _check_schedule(nodes)
        for doubt in doubtful_sections(given):
            print(f'{name}: warning: {doubt}', file=sys.stderr, flush=True)
        exit_code = _run(composition, lookout)
    except KeyboardInterrupt:  # before the lockstep handles signals
        exit_code = 128 + signal.SIGINT
    finally:
        # A caller in this process, such as a replay, still has work to do: its exit code must not be 0.
        with exit_deadline(exit_code if arguments is None else exit_code or FAILED_CODE):
            rclpy.utilities.try_shutdown()
        for number, handler in handlers.items():
            if signal.getsignal(number) is not handler:
                signal.signal(number, handler)
    return exit_code


def _run(composition: Composition, lookout: Lookout | None) -> int:
    """Run the nodes unless they would disturb a running graph; return the exit code."""
    nodes = composition.nodes
    try:
        # A replay communicates with no other process, and may run at the same time as a run.
        topics = [] if keeps_to_this_process(os.environ) else outputs_of(nodes)
        claims = TopicClaims(topics, nodes[0].context.get_domain_id())
    except ClaimError as error:
        return _end_early(nodes, failed(f'{error}; {CURE}'))
    with contextlib.closing(claims):
        if lookout is not None:
            why_not = lookout.why_not_to_join(nodes)
            lookout.close()
            if why_not:
                return _end_early(nodes, failed(why_not))
        outcome = Lockstep(nodes, composition.others, intra_process=composition.intra_process).run()
    if outcome.status == FAILED:
        # Other processes may continue: without this, DDS would remember the endpoints until their lease expires.
        with exit_deadline(outcome.exit_code):
            for node in nodes:
                node.destroy_node()
    return outcome.exit_code


def _end_early(nodes: Sequence[LoopNode], outcome: Outcome) -> int:
    """End before anything is published on a loop topic, without effect on other processes; return the exit code."""
    nodes[0].get_logger().error(f'run {outcome.status}: {outcome.reason}')
    for node in nodes:
        node.finish(outcome)
    return outcome.exit_code


def _check_schedule(nodes: Sequence[LoopNode]) -> None:
    """Check the schedule for the nodes of this process; other processes check it when they receive it."""
    for timer in nodes:
        if TimerParameters in timer.parameters.kinds:
            changes = timer.parameters[TimerParameters].changes
            for node in nodes:
                node.plan(changes)
            # A node may run in another process; with only a timer here, even a node that is not of this package. Both
            # are known only when the run starts.
            if len(nodes) > 1:
                names = [node.get_fully_qualified_name() for node in nodes]
                reject_unknown_nodes(changes, [*names, *names_with_parameters()])
