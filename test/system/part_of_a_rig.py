"""Four nodes of the graph in one process, which hand each other their messages; the others run elsewhere."""

import sys

from hdd_servo_ros.nodes.main import Composition, run_nodes
from hdd_servo_ros.nodes.rig import make_node

NODES = ('deterministic_timer', 'reference_generator', 'vcm_plant', 'ldv_sensor')

if __name__ == '__main__':
    sys.exit(run_nodes('rig', lambda _: Composition([make_node(name) for name in NODES], intra_process=True)))
