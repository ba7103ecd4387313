"""`rig`: the whole graph composed in one process; the main job."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.node import Node

from hdd_servo_ros.graph.catalogue import refuse_unknown
from hdd_servo_ros.graph.controller_loader import load_controller
from hdd_servo_ros.nodes.adaptive_nn_controller import AdaptiveNnController
from hdd_servo_ros.nodes.bag_recorder import BagRecorder
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.deterministic_timer import DeterministicTimer
from hdd_servo_ros.nodes.ldv_sensor import LdvSensor
from hdd_servo_ros.nodes.main import run_nodes
from hdd_servo_ros.nodes.open_loop_controller import OpenLoopController
from hdd_servo_ros.nodes.outside_controller import OutsideControllerNode
from hdd_servo_ros.nodes.pid_controller import PidController
from hdd_servo_ros.nodes.playback import PlaybackNode
from hdd_servo_ros.nodes.reference_generator import ReferenceGenerator
from hdd_servo_ros.nodes.signal_analyzer import SignalAnalyzerNode
from hdd_servo_ros.nodes.vcm_plant import VcmPlant
from hdd_servo_ros.parameters.files import RosArguments
from hdd_servo_ros.parameters.run_parameters import RigParameters, TimerParameters, last_tick_of_run
from hdd_servo_ros.recording.playback import PARAMETER
from hdd_servo_ros.reporting.show import show_run
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.node_metadata import last_ticks_needed
from hdd_servo_ros.ros.node_parameters import NodeParameters, ParameterNode

PLAYBACK = 'playback'

CONTROLLER_NODES: dict[str, Callable[[], ControllerNode]] = {
    'adaptive_nn': AdaptiveNnController,
    'pid': PidController,
    'open_loop': OpenLoopController,
    'signal_analyzer': SignalAnalyzerNode,
}


def controller_node(name: str) -> Callable[[], ControllerNode]:
    """Return what constructs the node of a controller; raises :class:`ParameterError` if there is none of that name."""
    if name in CONTROLLER_NODES:
        return CONTROLLER_NODES[name]
    kind = load_controller(name)
    return lambda: OutsideControllerNode(kind)


class Rig:
    """The nodes of the graph, in the order in which data flows through a tick."""

    def __init__(self, arguments: RosArguments) -> None:
        # It has no part in the loop; its parameters can be asked for like any node's.
        self.node = ParameterNode('rig')
        given = NodeParameters(self.node, [RigParameters])
        self.parameters: RigParameters = given[RigParameters]
        # Before names are refused, for it may bring parameters of its own.
        controller = controller_node(self.parameters.controller)
        refuse_unknown(given.unknown, given.as_mapping())
        timer = DeterministicTimer()
        self.nodes: list[LoopNode] = [
            timer,
            ReferenceGenerator(),
            VcmPlant(),
            LdvSensor(),
            controller(),
        ]
        if arguments.parameters_of(PLAYBACK).get(PARAMETER):
            self.nodes.insert(1, PlaybackNode())
        # At once: the peers would find it out as well, but only when all are there.
        last_tick_of_run(
            timer.parameters[TimerParameters],
            last_ticks_needed(self.nodes, timer.parameters[TimerParameters].sample_time),
        )
        self.recorder: BagRecorder | None = None
        if timer.parameters[TimerParameters].record:
            self.recorder = BagRecorder(separate_process=True)
            self.nodes.append(self.recorder)

    def show(self) -> None:
        """Sum up and draw the run that has ended."""
        if self.recorder is None:
            return
        try:
            show_run(Path(self.recorder.directory), plot=self.parameters.plot)
        except KeyboardInterrupt:
            print(
                f'rig: the run is complete in {self.recorder.directory}; its summary was interrupted', file=sys.stderr
            )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the whole graph, then say how it went."""
    rigs: list[Rig] = []
    others: list[Node] = []

    def make(given: RosArguments) -> Sequence[LoopNode]:
        rigs.append(Rig(given))
        others.append(rigs[0].node)
        return rigs[0].nodes

    exit_code = run_nodes('rig', make, arguments, others)
    if exit_code == 0:
        rigs[0].show()
    return exit_code


if __name__ == '__main__':
    sys.exit(main())
