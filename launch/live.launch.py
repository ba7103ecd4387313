"""Run all nodes in one process, paced to real time, together with a viewer for the signals."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.launch_description_entity import LaunchDescriptionEntity
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from hdd_servo_ros.graph.launching import PACKAGE, composed, description, value

SCOPE, PLOTJUGGLER, FOXGLOVE, NONE = 'scope', 'plotjuggler', 'foxglove', 'none'


def viewer(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the viewer that the argument selects, or an empty list."""
    namespace = value(context, 'namespace') or None
    layout = PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', 'plotjuggler.xml'])
    programs = {
        SCOPE: lambda: Node(package=PACKAGE, executable='scope', namespace=namespace, output='both'),
        PLOTJUGGLER: lambda: Node(package='plotjuggler', executable='plotjuggler', arguments=['--layout', layout]),
        # Foxglove connects to the bridge; the layout for it is config/foxglove.json.
        FOXGLOVE: lambda: Node(package='foxglove_bridge', executable='foxglove_bridge', output='both'),
    }
    chosen = value(context, 'viewer')
    return [] if chosen == NONE else [programs[chosen]()]


def generate_launch_description() -> LaunchDescription:
    """Return the launch description of this file."""
    argument = DeclareLaunchArgument(
        'viewer',
        default_value=SCOPE,
        choices=[SCOPE, PLOTJUGGLER, FOXGLOVE, NONE],
        description='viewer for the signals; scope is part of this package, the others must be installed',
    )
    # The parameter files run for 1 s, which is too short for a viewer to start.
    return description(lambda context: [*viewer(context), *composed(context)], argument, rate='1.0', duration='30.0')
