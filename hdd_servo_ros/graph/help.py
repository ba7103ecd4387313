"""Help texts of the executables, from the parameters' declarations; no ROS import."""

import argparse
from collections.abc import Sequence

from hdd_servo_ros.graph.catalogue import NODE_PARAMETERS, node_declarations

COMPILING = 'compiling the drive and the controllers, once; this takes some twenty seconds'
PURPOSE = {
    'deterministic_timer': 'The only source of time: publishes the ticks on /clock, paces and ends the run.',
    'reference_generator': 'Publishes the desired trajectory and its derivatives on /reference.',
    'vcm_plant': 'The drive: VCM actuator, pivot friction and resonances; publishes the truth on /head.',
    'ldv_sensor': 'The laser Doppler vibrometer: publishes its two output voltages on /ldv.',
    'adaptive_nn_controller': 'The adaptive neural network controller, eqs. (4.10) to (4.21) of the thesis.',
    'pid_controller': 'The conventional PID controller, the baseline.',
    'open_loop_controller': 'Drives the plant open loop: the voltage is x of /reference.',
    'signal_analyzer': "Sweeps a sine through the drive and writes its frequency response, in a controller's place.",
    'playback': 'Publishes the optional topics of a recorded run, such as /disturbance, again in another run.',
    'bag_recorder': 'Writes every topic of the run into a rosbag2 bag, and run.yaml beside it.',
    'rig': 'The whole graph in one process: runs the experiment, records it, sums it up and plots it.',
    'simulate': 'The same experiment as rig without middleware: the same parameters, the same bag, much faster.',
}


def parse_help(name: str, arguments: Sequence[str]) -> None:
    """Answer ``--help``, and refuse arguments that are none of ROS's; exits the process in both cases."""
    parser = argparse.ArgumentParser(
        prog=name,
        description=PURPOSE[name],
        epilog=_parameters_text(name),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage=f'{name} [--help] [--ros-args [--params-file FILE] [-p NODE:PARAMETER:=VALUE] [-r FROM:=TO] ...]',
    )
    _, others = parser.parse_known_args(arguments)
    if others:
        hint = '; ROS arguments stand behind --ros-args' if any(':=' in word for word in others) else ''
        parser.error(f'unrecognized arguments: {" ".join(others)}{hint}')


def _parameters_text(name: str) -> str:
    nodes = [node for node in NODE_PARAMETERS if node not in ('rig', 'simulate')] if name in ('rig', 'simulate') else []
    lines = [f'parameters of {name}:']
    for declaration in node_declarations(name):
        default = list(declaration.default) if isinstance(declaration.default, tuple) else declaration.default
        lines.append(f'  {declaration.name} (default {default})')
        lines.append(f'      {declaration.description}; {declaration.allowed}')
    if nodes:
        lines.append(f'and those of the nodes in it, as NODE:PARAMETER (see NODE --help): {", ".join(nodes)}')
    return '\n'.join(lines)
