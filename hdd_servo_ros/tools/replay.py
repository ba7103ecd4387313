"""`replay`: repeat a recorded run from its run directory, and check that the result is bit-identical."""

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES, SENSORS
from hdd_servo_ros.graph.recorded_nodes import kind_of_node
from hdd_servo_ros.graph.roles import PLAYBACK, RECORDED_RUN
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, WRONG_ARGUMENTS, command, reading
from hdd_servo_ros.messages.outcome import RUNNING
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, OPTIONAL_TOPICS, RECORDER
from hdd_servo_ros.parameters import Value
from hdd_servo_ros.parameters.events import NodeChange
from hdd_servo_ros.parameters.ros_yaml import written_file
from hdd_servo_ros.parameters.schedule import format_entry, parse_schedule
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.parameter_history import recorded_changes
from hdd_servo_ros.recording.run_folder import git_revision, read_run_yaml, versions

TIMER = 'deterministic_timer'
DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_OPTIONAL_NAMES = tuple(topic.name for topic in OPTIONAL_TOPICS)
_PACE = ('rate', 'progress')
"""Parameters of the timer that set the wall-clock speed and the progress display."""


class ReplayError(Exception):
    """A run that cannot be replayed; the text gives the reason."""

    exit_code = UNREADABLE


class Recording:
    """
    Setup of a recorded run: its nodes, parameters and topic names.

    Parameters
    ----------
    run
        The run directory.
    trusted
        Whether code named in the run directory may be executed: the class of a custom controller.

    Raises
    ------
    ReplayError
        If the run has not ended, has no tick, or included an external node.
    FileNotFoundError
        If it is not a run directory.
    """

    def __init__(self, run: Path, *, trusted: bool = False) -> None:
        self.run = run
        metadata = self.metadata = read_run_yaml(run)
        left_out = dict(metadata.get('topics_left_out', {}))
        self._topics: dict[str, str] = {**metadata['topics'], **left_out}
        """Every topic of the run, recorded or not."""
        self.kinds = {name: kind_of_node(name, node, metadata) for name, node in metadata['nodes'].items()}
        """The nodes' names in the catalog, by their full names in the run."""
        optional = {name for topic, name in self._topics.items() if topic in _OPTIONAL_NAMES}
        self.nodes: dict[str, dict[str, Any]] = {
            name: node
            for name, node in metadata['nodes'].items()
            if not node['outputs'] or not optional.issuperset(node['outputs']) or self._runs_again(name)
        }
        """Nodes that run again; other nodes that publish only optional topics are played back."""
        not_recorded = [
            name for topic, name in left_out.items() if topic in _OPTIONAL_NAMES and not self._is_published(name)
        ]
        if not_recorded:
            raise ReplayError(
                f'{run} cannot be replayed: parameter topics of bag_recorder excluded {", ".join(not_recorded)}'
            )
        if metadata['status'] == RUNNING:
            raise ReplayError(
                f'{run}: status in run.yaml is running; if the run has ended, repair it by `recover {run}`'
            )
        if metadata['last_tick'] is None or metadata['last_tick'] < 0:
            raise ReplayError(f'{run} contains no tick')
        external = [
            name
            for topic, name in self._topics.items()
            if topic not in _OPTIONAL_NAMES and not self._is_published(name)
        ]
        if external:
            raise ReplayError(
                f'{run} cannot be replayed: {", ".join(external)} came from a node that run.yaml does not list'
            )
        self.played = [
            topic
            for topic, name in metadata['topics'].items()
            if topic in _OPTIONAL_NAMES and not self._is_published(name)
        ]
        """The optional topics that are played back."""
        timers = [name for name in self.nodes if self.kinds[name] == TIMER]
        if len(timers) != 1:
            raise ReplayError(f'{run}: run.yaml lists {len(timers)} {TIMER} nodes, expected one')
        self.timer = timers[0]
        self.namespace = self.timer.rsplit('/', 1)[0]
        self._reject_other_names()
        # A custom controller is loaded by its class or entry point, not by its node's name.
        self.controller: str = metadata.get('controller_class', metadata['controller'])
        if self.controller not in CONTROLLERS and not trusted:
            raise ReplayError(
                f'{run}: run.yaml names the custom controller {shown(self.controller)}; to run its code, add --trust'
            )
        self.last_tick: int = metadata['last_tick']
        self.sample_time: float = metadata['sample_time']

    def _reject_other_names(self) -> None:
        """Reject nodes whose names a replay cannot restore, because they would run with default parameters."""
        own = set(NODES)
        if 'controller_class' in self.metadata:
            # The name of a custom controller, the node that publishes /control, is known only after loading its class.
            own |= {self.kinds[name] for name, node in self.nodes.items() if self._topics['control'] in node['outputs']}
        for name in self.nodes:
            if self.kinds[name] not in own:
                raise ReplayError(f'{self.run}: run.yaml lists the node {name}, which is not part of this package')
            if name.rpartition('/')[0] != self.namespace:
                raise ReplayError(f'{self.run} cannot be replayed: {name} was not in the namespace of {self.timer}')

    def _runs_again(self, node: str) -> bool:
        """Return whether a node, given by its full name, belongs to this package and computes its outputs."""
        kind = self.kinds[node]
        return kind in NODES and bool(NODES[kind].block)

    def _is_published(self, topic: str) -> bool:
        return any(topic in node['outputs'] for node in self.nodes.values())

    def schedule(self) -> list[str]:
        """Return every parameter change of the run as a schedule, including the live changes."""
        step = sample_time_to_nanoseconds(self.sample_time)
        changes = [
            change
            for change in recorded_changes(self.run)
            if change.time_ns <= self.last_tick * step and change.node in self.nodes
        ]
        seen = {(change.time_ns, change.node, name) for change in changes for name in change.values}
        # A run that ended early can lack the event of a scheduled change.
        planned = parse_schedule(
            self.nodes[self.timer]['parameters'].get('schedule', ()),
            self.sample_time,
            self.metadata['last_tick_planned'],
        )
        missing = [
            NodeChange(node, change.tick * step, {change.name: _value(change.value)})
            for change in planned
            for node in self.nodes
            if change.is_for(node) and change.tick <= self.last_tick
            if (change.tick * step, node, change.name) not in seen
        ]
        return list(_entries([*missing, *changes], self.nodes, self.timer))

    def parameter_file(self, output: Path) -> dict[str, dict[str, Any]]:
        """Return the sections of a ROS parameter file that replays the run into ``output``."""
        content = {
            name: {key: value for key, value in node['parameters'].items() if value != []}
            for name, node in self.nodes.items()
        }
        timer = content[self.timer]
        timer.pop('schedule', None)
        schedule = self.schedule()
        timer.update(
            # A run has at least two ticks.
            duration=max(self.last_tick, 1) * self.sample_time,
            rate=0.0,
            autostart=True,
            record=True,
            **({'schedule': schedule} if schedule else {}),
        )
        recorders = [name for name in self.nodes if self.kinds[name] == RECORDER]
        recorder = content.setdefault(recorders[0] if recorders else f'{self.namespace}/{RECORDER}', {})
        recorder['run_dir'] = str(output)
        if self.played:
            content[f'{self.namespace}/{PLAYBACK}'] = {RECORDED_RUN: str(self.run.resolve())}
        rig: dict[str, Any] = {'controller': self.controller, 'plot': False}
        if any(self.kinds[name] == SENSORS['servo'] for name in self.nodes):
            rig['sensor'] = 'servo'
        return {**content, f'{self.namespace}/rig': rig}

    def remaps(self) -> list[str]:
        """Return the ROS arguments that restore the namespace and the topic names of the run."""
        arguments = ['-r', f'__ns:={self.namespace}'] if self.namespace else []
        for name in self.nodes:
            own = name.rpartition('/')[2]
            if self.kinds[name] != own:
                arguments += ['-r', f'{self.kinds[name]}:__node:={own}']
        topics = {topic.name for topic in ALL_LOOP_TOPICS}
        for topic, name in self._topics.items():
            if topic in topics and name != f'{self.namespace}/{topic}':
                arguments += ['-r', f'{topic}:={name}']
        return arguments

    def differing_versions(self) -> Iterator[str]:
        """Iterate over descriptions of the versions that differ from those of the recording."""
        recorded = {**self.metadata.get('versions', {}), 'git revision': self.metadata.get('git_revision', 'unknown')}
        here = {**versions(), 'git revision': git_revision()}
        for name in sorted(recorded.keys() & here.keys()):
            if recorded[name] != here[name]:
                yield f'{name}: recorded with {recorded[name]}, now {here[name]}'


def _value(value: Any) -> Value:
    return tuple(value) if isinstance(value, list) else value


def _entries(changes: Sequence[NodeChange], nodes: Mapping[str, Mapping[str, Any]], timer: str) -> Iterator[str]:
    changed = set()
    for change in changes:
        then = (change.time_ns, change.node) in changed
        changed.add((change.time_ns, change.node))
        for name, value in change.values.items():
            paces = change.node == timer and name in _PACE
            if name in nodes[change.node]['parameters'] and not paces:
                yield format_entry(change.time_ns, change.node, name, value, then=then)
                then = False


def repeat(recording: Recording, output: Path, *, without_ros: bool) -> int:
    """Repeat the experiment of a recording into the directory ``output``; return the exit code of the run."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / 'replay.yaml'
        path.write_text(written_file(recording.parameter_file(output)), 'utf8')
        arguments = ['--ros-args', '--params-file', str(path), *recording.remaps()]
        # Imported here, because rclpy need not be installed without ROS.
        if without_ros:
            from hdd_servo_ros.simulation import simulate

            return simulate.main(arguments)
        from hdd_servo_ros.nodes import rig

        # All nodes are in this process. If others discovered them, they would stop a running graph of the same names.
        os.environ[DISCOVERY_RANGE] = 'OFF'
        return rig.main(['rig', *arguments])


def replay(run: Path, output: Path, *, without_ros: bool, trusted: bool = False) -> int:
    """Replay ``run`` into ``output`` and report whether the result is identical; return the exit code."""
    with reading(run):
        try:
            recording = Recording(run, trusted=trusted)
            schedule = recording.schedule()
        except KeyError as error:
            raise ReplayError(f'{run}: run.yaml has no entry {error}') from None
    for differing in recording.differing_versions():
        print(f'replay: note: {differing}')
    for entry in schedule:
        print(f'replay: parameter change {entry}')
    exit_code = repeat(recording, output, without_ros=without_ros)
    if exit_code == WRONG_ARGUMENTS:
        raise ReplayError(f'{run} cannot be replayed: its parameters in run.yaml were rejected')
    if exit_code != 0:
        print(f'replay: the replay of {run} ended with exit code {exit_code}', file=sys.stderr)
        return 1
    with reading(run):
        difference = first_difference(run, output, recording.last_tick, labels=('the recording', 'the replay'))
    if difference is not None:
        print(f'replay: different: {difference}')
        return 1
    print(f'replay: bit-identical on every topic, ticks 0 to {recording.last_tick}')
    return 0


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='replay',
        description='Replay a recorded run from its run.yaml and the parameter changes in its bag, and compare the '
        'results byte by byte.',
        epilog='Exit code: 0 bit-identical, 1 different, 2 invalid arguments, 3 the run cannot be read or replayed.',
    )
    parser.add_argument('run', type=Path, metavar='RUN', help='run directory')
    parser.add_argument('--without-ros', action='store_true', help='use simulate instead of rig')
    parser.add_argument('--output', type=Path, metavar='DIR', help='keep the replay in this new directory')
    parser.add_argument('--trust', action='store_true', help='run the code of a custom controller that run.yaml names')
    return parser


@command('replay', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Replay a run; return 0 if it is bit-identical, 1 if not, 3 if it cannot be replayed."""
    parsed = command_line().parse_args(arguments)
    if parsed.output is not None:
        if parsed.output.exists():
            raise FileExistsError(f'{parsed.output} exists; a run is never overwritten')
        return replay(parsed.run, parsed.output, without_ros=parsed.without_ros, trusted=parsed.trust)
    with tempfile.TemporaryDirectory() as directory:
        output = Path(directory) / 'replay'
        return replay(parsed.run, output, without_ros=parsed.without_ros, trusted=parsed.trust)


if __name__ == '__main__':
    sys.exit(main())
