"""What the launch files share: arguments, the processes of a run, and an end with it. Needs launch_ros, not rclpy."""

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
"""How long the others have, when one process has failed, to end by themselves and close the bag [s]."""
_CLOSING = '20'
"""After Ctrl-C, how long a process has to close the bag before it gets the next signal [s]."""
_OF_NODES = ('rate', 'duration', 'record', 'run_dir')
"""Arguments that are parameters of the nodes by the same name."""
_OF_ROS2_LAUNCH = ('launch-prefix', 'launch-prefix-filter')
"""What `ros2 launch` adds to the arguments by options of its own."""


def description(
    make: Callable[[LaunchContext], list[LaunchDescriptionEntity]],
    *more: DeclareLaunchArgument,
    rate: str = '',
    duration: str = '',
) -> LaunchDescription:
    """
    Return the description of a launch file: the arguments that all have, and what it starts.

    Parameters
    ----------
    make
        Makes the processes when the arguments are known.
    more
        Arguments of this launch file alone.
    rate, duration
        Default pace and length [s], empty for those of the parameter files.
    """
    as_given = 'empty leaves it to the parameter files'
    declared = [
        *more,
        DeclareLaunchArgument(
            'controller',
            default_value='adaptive_nn',
            description=f'Controller of the loop: {", ".join(CONTROLLERS)}, or your own as module:Class.',
        ),
        DeclareLaunchArgument(
            'params',
            default_value=PathJoinSubstitution([FindPackageShare(PACKAGE), 'params', 'seagate_7200_10.yaml']),
            description='ROS 2 parameter files, separated by commas; later ones win.',
        ),
        DeclareLaunchArgument('namespace', default_value='', description='Namespace of all nodes and topics.'),
        DeclareLaunchArgument(
            'rate',
            default_value=rate,
            description=f'Pace: 0.0 as fast as the graph goes, 1.0 real time, 0.1 slow motion; {as_given}.',
        ),
        DeclareLaunchArgument(
            'duration', default_value=duration, description=f'Length of the run in seconds, such as 2.0; {as_given}.'
        ),
        DeclareLaunchArgument(
            'record', default_value='true', choices=['true', 'false'], description='Whether to write a bag.'
        ),
        DeclareLaunchArgument(
            'run_dir',
            default_value='',
            description='Folder of the run; empty makes runs/<date-time>-<controller> below the working folder.',
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
            description='Lowest level of what the nodes of the run log.',
        ),
        DeclareLaunchArgument(
            'discovery_range',
            default_value=EnvironmentVariable(DISCOVERY_RANGE, default_value='LOCALHOST'),
            choices=['LOCALHOST', 'SUBNET', 'OFF', 'SYSTEM_DEFAULT'],
            description=f'Who can see the nodes: LOCALHOST, which keeps to this machine, unless {DISCOVERY_RANGE} '
            'is set; sets that variable.',
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
    """Reject arguments that `ros2 launch` would pass over without a word: misspelt ones, and parameters' names."""
    file = Path(context.locals.current_launch_file_path).resolve()
    if PACKAGE not in sys.argv and file not in (Path(word).resolve() for word in sys.argv[1:]):
        return  # Another launch file includes this one, and may have arguments of its own.
    for name in (word.partition(':=')[0] for word in context.argv):
        if name not in (*known, *_OF_ROS2_LAUNCH):
            similar = difflib.get_close_matches(name, known, n=1)
            hint = f'did you mean {similar[0]}?' if similar else 'parameters go into ros_args:="-p NAME:=VALUE"'
            raise RuntimeError(f'{file.name} has no argument {name}, but {", ".join(known)}; {hint}')


def separate_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return every node of the graph as a process of its own."""
    controller = value(context, 'controller')
    node = CONTROLLERS.get(controller, 'outside_controller')
    arguments = parse_ros_arguments(['--ros-args', *_ros_arguments(context)])
    roles = roles_of_run(node, arguments, str(arguments.parameters_of('rig').get('sensor', 'ldv')))
    names = [name for name in nodes_of_run(roles) if name != RECORDER or value(context, 'record') == 'true']
    end = EndOfRun(len(names))
    named = {'outside_controller': [controller]}
    return [_node(context, name, [], end, arguments=named.get(name, [])) for name in names]


def composed(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the whole graph as one process."""
    return [_node(context, 'rig', ['-p', f'controller:={value(context, "controller")}'], EndOfRun(1))]


def value(context: LaunchContext, name: str) -> str:
    """Return what an argument of the launch file has been given."""
    return str(LaunchConfiguration(name).perform(context))


def _ros_arguments(context: LaunchContext) -> list[str]:
    """Return the ROS arguments that all processes get."""
    words = [word for path in value(context, 'params').split(',') for word in ('--params-file', path.strip())]
    for name in _OF_NODES:
        if value(context, name):
            words += ['-p', f'{name}:={value(context, name)}']
    level = value(context, 'log_level')
    # The default is left to ROS, so that ros_args may say another.
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
    Ends the launch with the run, whatever else it has started, and as a failure if a process of the run failed.

    `ros2 launch` knows the exit codes 0 and 1 alone, and 1 is what it makes of an error that a handler raises.

    Parameters
    ----------
    processes
        How many processes the run has; each gets this as its ``on_exit``.
    """

    def __init__(self, processes: int) -> None:
        self._left = processes
        self._failure = ''

    def __call__(self, event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Take in that a process has ended."""
        self._left -= 1
        is_first = bool(event.returncode) and not self._failure
        if is_first:
            self._failure = f'{event.process_name} ended with exit code {event.returncode}'
        if not self._left:
            if self._failure:
                raise RuntimeError(f'the run has failed: {self._failure}')
            return [Shutdown(reason='the run has finished')]
        if event.returncode == WRONG_ARGUMENTS:
            return [Shutdown(reason=f'{event.process_name} rejects its arguments')]
        if is_first:
            # The others learn of it from each other, and the recorder notes the reason.
            return [TimerAction(period=_LAST_WORDS, actions=[Shutdown(reason=f'{event.process_name} has failed')])]
        return []
