"""`rig`: the complete graph composed in one process."""

import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES, nodes_of_run, resolve
from hdd_servo_ros.graph.controller_loader import ControllerKind, load_controller
from hdd_servo_ros.graph.known_parameters import reject_unknown
from hdd_servo_ros.graph.rig_parameters import RigParameters
from hdd_servo_ros.graph.roles import roles_of_run
from hdd_servo_ros.graph.topic_names import topic_names
from hdd_servo_ros.messages.topics import RECORDER
from hdd_servo_ros.nodes.bag_recorder import BagRecorder
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import Composition, run_nodes
from hdd_servo_ros.nodes.outside_controller import OutsideControllerNode
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import RosArguments, with_node
from hdd_servo_ros.parameters.run_parameters import TimerParameters, last_tick_of_run
from hdd_servo_ros.recording.writer_process import launch_writer
from hdd_servo_ros.reporting.show import show_run
from hdd_servo_ros.ros.lockstep import SIGNALS
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.node_metadata import last_ticks_needed
from hdd_servo_ros.ros.node_parameters import NodeParameters, ParameterNode


def make_node(name: str, custom: ControllerKind | None = None) -> LoopNode:
    """
    Return a new node by its name in the catalog.

    Parameters
    ----------
    name
        The name.
    custom
        Custom controller, if any.

    Raises
    ------
    ParameterError
        If a parameter is invalid; the message names the node too.
    """
    try:
        if custom is not None and name == custom.node:
            return OutsideControllerNode(custom)
        path = NODES[name].node
        node: LoopNode = resolve(path)() if path else ControllerNode(name)
    except ParameterError as error:
        # An invalid controller class is reported as the parameter `controller` of rig.
        raise error if error.name == 'controller' else with_node(error, name) from error.__cause__
    return node


class Rig:
    """Nodes of the graph, in the order of the data flow within a tick."""

    def __init__(self, arguments: RosArguments) -> None:
        # Not a loop node, but its parameter services are served as those of every node.
        self.node = ParameterNode('rig')
        given = NodeParameters(self.node, [RigParameters])
        self.parameters: RigParameters = given[RigParameters]
        controller, custom = self.parameters.controller, None
        if controller not in CONTROLLERS:
            # Before unknown names are rejected, because it may declare further parameters.
            custom = load_controller(controller)
        reject_unknown(given.unknown, given.as_mapping())
        node = CONTROLLERS[controller] if custom is None else custom.node
        names = nodes_of_run(roles_of_run(node, arguments, self.parameters.sensor))
        arguments.check_names('rig', ['rig', *names])
        topic_names(arguments, names)
        self.nodes: list[LoopNode] = [make_node(names[0])]
        timer: TimerParameters = self.nodes[0].parameters[TimerParameters]
        # Before the other nodes: it starts while they are constructed.
        writer = launch_writer() if timer.record else None
        self.nodes += [make_node(name, custom) for name in names[1:] if name != RECORDER]
        # Checked here, because the handshake checks it only when all nodes have started.
        last_tick_of_run(timer, last_ticks_needed(self.nodes, timer.sample_time))
        self._check(timer)
        self.recorder: BagRecorder | None = None
        if writer is not None:
            self.recorder = BagRecorder(process=writer)
            self.nodes.append(self.recorder)

    def _check(self, timer: TimerParameters) -> None:
        """Reject parameters that do not match each other or T, as `simulate` does before a run."""
        nodes = {node.get_fully_qualified_name(): {'parameters': node.parameters.as_mapping()} for node in self.nodes}
        for node in self.nodes:
            try:
                node.check_start(timer.sample_time, nodes)
            except ParameterError as error:
                raise with_node(error, node.get_name()) from None
        for node in self.nodes:
            node.check_schedule(timer.changes, timer.sample_time, nodes)

    def show(self) -> None:
        """Print the summary of the run and plot it."""
        if self.recorder is None:
            return
        # The run is finished, so that any request to end costs the summary alone, and the exit code stays 0.
        handlers = {number: signal.signal(number, signal.default_int_handler) for number in SIGNALS}
        try:
            show_run(Path(self.recorder.directory), plot=self.parameters.plot)
        except KeyboardInterrupt:
            print(
                f'rig: the run is complete in {self.recorder.directory}; its summary was interrupted', file=sys.stderr
            )
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the complete graph, then print a summary of the run."""
    rigs: list[Rig] = []

    def make(given: RosArguments) -> Composition:
        rig = Rig(given)
        rigs.append(rig)
        return Composition(rig.nodes, [rig.node], rig.parameters.intra_process)

    exit_code = run_nodes('rig', make, arguments)
    if exit_code == 0:
        rigs[0].show()
    return exit_code


if __name__ == '__main__':
    sys.exit(main())
