"""`rig`: the whole graph composed in one process; the main job."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.nodes.adaptive_nn_controller import AdaptiveNnController
from hdd_servo_ros.nodes.bag_recorder import BagRecorder
from hdd_servo_ros.nodes.deterministic_timer import DeterministicTimer
from hdd_servo_ros.nodes.ldv_sensor import LdvSensor
from hdd_servo_ros.nodes.open_loop_controller import OpenLoopController
from hdd_servo_ros.nodes.pid_controller import PidController
from hdd_servo_ros.nodes.reference_generator import ReferenceGenerator
from hdd_servo_ros.nodes.vcm_plant import VcmPlant
from hdd_servo_ros.loop_parameters import RigParameters
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.main import run_nodes

def make():
    return [DeterministicTimer(), ReferenceGenerator(), VcmPlant(), LdvSensor(), AdaptiveNnController(), BagRecorder(separate_process=True)]

def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_nodes('rig', make, arguments)


if __name__ == '__main__':
    sys.exit(main())
