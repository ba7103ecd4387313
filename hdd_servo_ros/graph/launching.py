"""Common part of the launch files: arguments, processes and end of a run. It needs launch_ros, not rclpy."""

import difflib
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown, TimerAction
from launch.events.process import ProcessExited
from launch.launch_description_entity import LaunchDescriptionEntity
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from hdd_servo_ros.graph.catalog import CONTROLLERS, nodes_of_run
from hdd_servo_ros.graph.roles import roles_of_run
from hdd_servo_ros.messages.topics import RECORDER
from hdd_servo_ros.parameters.files import parse_ros_arguments

PACKAGE = 'hdd_servo_ros'
DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
WRONG_ARGUMENTS = 2
"""Exit code of an executable that rejects its arguments."""
_LAST_WORDS = 10.0
"""After a process has failed, time for the others to end by themselves and close the bag [s]."""
_CLOSING = '20'
"""After Ctrl-C, time for a process to close the bag before it receives the next signal [s]."""
_OF_NODES = ('rate', 'duration', 'record', 'run_dir')
"""Arguments that are node parameters of the same name."""
_OF_ROS2_LAUNCH = ('launch-prefix', 'launch-prefix-filter')
"""Arguments that options of `ros2 launch` add."""


def description(
    make: Callable[[LaunchContext], list[LaunchDescriptionEntity]],
    *more: DeclareLaunchArgument,
    rate: str = '',
    duration: str = '',
) -> LaunchDescription:
    """
    Return the description of a launch file: the common arguments and the processes.

    Parameters
    ----------
    make
        Function that returns the processes when the arguments are known.
    more
        Further arguments of this launch file.
    rate, duration
        Default pace and duration [s]; empty for those of the parameter files.
    """
    as_given = 'empty to use the parameter files'
    declared = [
        *more,
        DeclareLaunchArgument(
            'controller',
            default_value='adaptive_nn',
            description=f'Controller of the loop: {", ".join(CONTROLLERS)}, or a custom one as module:Class.',
        ),
        DeclareLaunchArgument(
            'params',
            default_value=PathJoinSubstitution([FindPackageShare(PACKAGE), 'params', 'seagate_7200_10.yaml']),
            description='ROS 2 parameter files, separated by commas; later files override earlier ones.',
        ),
        DeclareLaunchArgument('namespace', default_value='', description='Namespace of all nodes and topics.'),
        DeclareLaunchArgument(
            'rate',
            default_value=rate,
            description=f'Pace: 0.0 for as fast as possible, 1.0 for real time, 0.1 for slow motion; {as_given}.',
        ),
        DeclareLaunchArgument(
            'duration', default_value=duration, description=f'Duration of the run in seconds, such as 2.0; {as_given}.'
        ),
        DeclareLaunchArgument('record', default_value='true', choices=['true', 'false'], description='Write a bag.'),
        DeclareLaunchArgument(
            'run_dir',
            default_value='',
            description='Directory of the run; if empty, runs/<date-time>-<controller> in the working directory.',
        ),
        DeclareLaunchArgument(
            'ros_args',
            default_value='',
            description='Further ROS arguments of every node, such as "-p frequency:=200.0 -r ldv:=vibrometer".',
        ),
        DeclareLaunchArgument(
            'log_level',
            default_value='info',
            choices=['debug', 'info', 'warn', 'error', 'fatal'],
            description='Lowest severity that the nodes of the run log.',
        ),
        DeclareLaunchArgument(
            'discovery_range',
            default_value=EnvironmentVariable(DISCOVERY_RANGE, default_value='LOCALHOST'),
            choices=['LOCALHOST', 'SUBNET', 'OFF', 'SYSTEM_DEFAULT'],
            description=f'Discovery range of the nodes, set as {DISCOVERY_RANGE}; the default is the value of that '
            'variable, or LOCALHOST for this machine only.',
        ),
    ]
    return LaunchDescription(
        [
            *declared,
            OpaqueFunction(function=_reject_unknown, args=[[argument.name for argument in declared]]),
            SetEnvironmentVariable(DISCOVERY_RANGE, LaunchConfiguration('discovery_range')),
            OpaqueFunction(function=make),
        ]
    )


def _reject_unknown(context: LaunchContext, known: Sequence[str]) -> None:
    """Reject arguments that `ros2 launch` would silently ignore: misspelled ones, and names of parameters."""
    file = Path(context.locals.current_launch_file_path).resolve()
    if PACKAGE not in sys.argv and file not in (Path(word).resolve() for word in sys.argv[1:]):
        return  # Another launch file includes this one, and may have further arguments.
    for name in (word.partition(':=')[0] for word in context.argv):
        if name not in (*known, *_OF_ROS2_LAUNCH):
            similar = difflib.get_close_matches(name, known, n=1)
            hint = f'did you mean {similar[0]}?' if similar else 'parameters go into ros_args:="-p NAME:=VALUE"'
            raise RuntimeError(f'unknown argument {name} of {file.name}; expected {", ".join(known)}; {hint}')


def separate_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return one process per node of the graph."""
    controller = value(context, 'controller')
    node = CONTROLLERS.get(controller, 'outside_controller')
    arguments = parse_ros_arguments(['--ros-args', *_ros_arguments(context)])
    roles = roles_of_run(node, arguments, str(arguments.parameters_of('rig').get('sensor', 'ldv')))
    names = [name for name in nodes_of_run(roles) if name != RECORDER or value(context, 'record') == 'true']
    end = EndOfRun(len(names))
    named = {'outside_controller': [controller]}
    return [_node(context, name, [], end, arguments=named.get(name, [])) for name in names]


def composed(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return one process for the complete graph."""
    return [_node(context, 'rig', ['-p', f'controller:={value(context, "controller")}'], EndOfRun(1))]


def value(context: LaunchContext, name: str) -> str:
    """Return the value of an argument of the launch file."""
    return str(LaunchConfiguration(name).perform(context))


def _ros_arguments(context: LaunchContext) -> list[str]:
    """Return the ROS arguments of all processes."""
    words = [word for path in value(context, 'params').split(',') for word in ('--params-file', path.strip())]
    for name in _OF_NODES:
        if value(context, name):
            words += ['-p', f'{name}:={value(context, name)}']
    level = value(context, 'log_level')
    # The default is not passed, so that ros_args may set another level.
    words += ['--log-level', level] if level != 'info' else []
    return [*words, *shlex.split(value(context, 'ros_args'))]


def _node(
    context: LaunchContext,
    executable: str,
    ros_arguments: Sequence[str],
    end: 'EndOfRun',
    arguments: Sequence[str] = (),
) -> Node:
    return Node(
        package=PACKAGE,
        executable=executable,
        namespace=value(context, 'namespace') or None,
        arguments=list(arguments),
        ros_arguments=[*ros_arguments, *_ros_arguments(context)],
        output='both',
        on_exit=end,
        sigterm_timeout=_CLOSING,
    )


class EndOfRun:
    """
    Exit handler that ends the launch with the run, and as a failure if a process of the run failed.

    It also ends other processes of the launch. `ros2 launch` has only the exit codes 0 and 1, and returns 1 if a
    handler raises an error.

    Parameters
    ----------
    processes
        Number of processes of the run; each has this handler as its ``on_exit``.
    """

    def __init__(self, processes: int) -> None:
        self._left = processes
        self._failure = ''

    def __call__(self, event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Handle the end of a process."""
        self._left -= 1
        is_first = bool(event.returncode) and not self._failure
        if is_first:
            self._failure = f'{event.process_name} ended with exit code {event.returncode}'
        if not self._left:
            if self._failure:
                raise RuntimeError(f'the run failed: {self._failure}')
            return [Shutdown(reason='the run has finished')]
        if event.returncode == WRONG_ARGUMENTS:
            return [Shutdown(reason=f'{event.process_name} rejected its arguments')]
        if is_first:
            # The other processes detect the failure, and the recorder records the reason.
            return [TimerAction(period=_LAST_WORDS, actions=[Shutdown(reason=f'{event.process_name} has failed')])]
        return []
