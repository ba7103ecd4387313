"""`replay`: rerun a recorded run from what its folder says, and confirm that the bits are the same."""

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
"""Parameters of the timer that say how fast a run goes in wall time."""


class ReplayError(Exception):
    """A run that cannot be rerun; says why."""

    exit_code = UNREADABLE


class Recording:
    """
    What a run's folder says about how the run came to be.

    Parameters
    ----------
    run
        The run's folder.
    trusted
        Whether code that the folder names may run: the class of a custom controller.

    Raises
    ------
    ReplayError
        If the run did not end, has no tick, or somebody else's node took part in it.
    FileNotFoundError
        If it is no run folder.
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
        """The nodes that run again; others that publish optional topics alone are played back."""
        lost = [name for topic, name in left_out.items() if topic in _OPTIONAL_NAMES and not self._is_published(name)]
        if lost:
            raise ReplayError(
                f'{run}: {", ".join(lost)} was left out by parameter topics of bag_recorder, so it cannot be replayed'
            )
        if metadata['status'] == RUNNING:
            raise ReplayError(f'{run}: run.yaml says that it is running; if it is not, `recover {run}` repairs it')
        if metadata['last_tick'] is None or metadata['last_tick'] < 0:
            raise ReplayError(f'{run}: it holds no tick')
        external = [
            name
            for topic, name in self._topics.items()
            if topic not in _OPTIONAL_NAMES and not self._is_published(name)
        ]
        if external:
            raise ReplayError(
                f'{run}: {", ".join(external)} came from a node that run.yaml does not name, so it cannot be replayed'
            )
        self.played = [
            topic
            for topic, name in metadata['topics'].items()
            if topic in _OPTIONAL_NAMES and not self._is_published(name)
        ]
        """The optional topics that are played back."""
        timers = [name for name in self.nodes if self.kinds[name] == TIMER]
        if len(timers) != 1:
            raise ReplayError(f'{run}: run.yaml names {len(timers)} nodes {TIMER}, not one')
        self.timer = timers[0]
        self.namespace = self.timer.rsplit('/', 1)[0]
        self._reject_other_names()
        # A controller from outside the package is loaded by what it was given as, not by its node's name.
        self.controller: str = metadata.get('controller_class', metadata['controller'])
        if self.controller not in CONTROLLERS and not trusted:
            raise ReplayError(
                f'{run}: run.yaml names the controller {shown(self.controller)}, which is code of its own; if you '
                'trust it, ask again with --trust'
            )
        self.last_tick: int = metadata['last_tick']
        self.sample_time: float = metadata['sample_time']

    def _reject_other_names(self) -> None:
        """Reject nodes that a rerun could not give their names: they would run with parameters that nobody gave."""
        own = set(NODES)
        if 'controller_class' in self.metadata:
            # A custom controller's name is known once its class is loaded; it is what publishes /control.
            own |= {self.kinds[name] for name, node in self.nodes.items() if self._topics['control'] in node['outputs']}
        for name in self.nodes:
            if self.kinds[name] not in own:
                raise ReplayError(f'{self.run}: run.yaml names a node {name}, which is none of this package')
            if name.rpartition('/')[0] != self.namespace:
                raise ReplayError(
                    f'{self.run}: {name} was not in the namespace of {self.timer}, so it cannot be replayed'
                )

    def _runs_again(self, node: str) -> bool:
        """Return whether a node, given by its full name, is one of this package that computes what it publishes."""
        kind = self.kinds[node]
        return kind in NODES and bool(NODES[kind].block)

    def _is_published(self, topic: str) -> bool:
        return any(topic in node['outputs'] for node in self.nodes.values())

    def schedule(self) -> list[str]:
        """Return every parameter change of the run as a schedule: those of its own schedule and those made live."""
        step = sample_time_to_nanoseconds(self.sample_time)
        changes = [
            change
            for change in recorded_changes(self.run)
            if change.time_ns <= self.last_tick * step and change.node in self.nodes
        ]
        seen = {(change.time_ns, change.node, name) for change in changes for name in change.values}
        # A run that was cut short may have lost the event of a change that its schedule knows of.
        planned = parse_schedule(
            self.nodes[self.timer]['parameters'].get('schedule', ()),
            self.sample_time,
            self.metadata['last_tick_planned'],
        )
        lost = [
            NodeChange(node, change.tick * step, {change.name: _value(change.value)})
            for change in planned
            for node in self.nodes
            if change.is_for(node) and change.tick <= self.last_tick
            if (change.tick * step, node, change.name) not in seen
        ]
        return list(_entries([*lost, *changes], self.nodes, self.timer))

    def parameter_file(self, output: Path) -> dict[str, dict[str, Any]]:
        """Return the sections of a ROS parameter file that reruns the run into ``output``."""
        content = {
            name: {key: value for key, value in node['parameters'].items() if value != []}
            for name, node in self.nodes.items()
        }
        timer = content[self.timer]
        timer.pop('schedule', None)
        schedule = self.schedule()
        timer.update(
            # A run has two ticks at least.
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
        """Return the ROS arguments that give namespace and topics the names that they had."""
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
        """Iterate over what is another version here than when the run was recorded, in words."""
        recorded = {**self.metadata.get('versions', {}), 'git revision': self.metadata.get('git_revision', 'unknown')}
        here = {**versions(), 'git revision': git_revision()}
        for name in sorted(recorded.keys() & here.keys()):
            if recorded[name] != here[name]:
                yield f'{name}: recorded with {recorded[name]}, here {here[name]}'


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


def rerun(recording: Recording, output: Path, *, without_ros: bool) -> int:
    """Run the experiment of a recording again into the folder ``output``; return the run's exit code."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / 'replay.yaml'
        path.write_text(written_file(recording.parameter_file(output)), 'utf8')
        arguments = ['--ros-args', '--params-file', str(path), *recording.remaps()]
        # Imported late: without ROS there need be no rclpy.
        if without_ros:
            from hdd_servo_ros.simulation import simulate

            return simulate.main(arguments)
        from hdd_servo_ros.nodes import rig

        # All its nodes are in this process: found by others, they would end a run that goes on by the same names.
        os.environ[DISCOVERY_RANGE] = 'OFF'
        return rig.main(['rig', *arguments])


def replay(run: Path, output: Path, *, without_ros: bool, trusted: bool = False) -> int:
    """Rerun ``run`` into ``output`` and say whether it came out the same; return the exit code."""
    with reading(run):
        try:
            recording = Recording(run, trusted=trusted)
            schedule = recording.schedule()
        except KeyError as error:
            raise ReplayError(f'{run}: run.yaml does not say {error}') from None
    for differing in recording.differing_versions():
        print(f'replay: note: {differing}')
    for entry in schedule:
        print(f'replay: parameter change {entry}')
    exit_code = rerun(recording, output, without_ros=without_ros)
    if exit_code == WRONG_ARGUMENTS:
        raise ReplayError(f'{run}: what run.yaml says is rejected, so it cannot be rerun')
    if exit_code != 0:
        print(f'replay: the rerun of {run} ended with exit code {exit_code}', file=sys.stderr)
        return 1
    with reading(run):
        difference = first_difference(run, output, recording.last_tick, labels=('the recording', 'the rerun'))
    if difference is not None:
        print(f'replay: different: {difference}')
        return 1
    print(f'replay: the same bits on every topic, ticks 0 to {recording.last_tick}')
    return 0


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='replay',
        description='Rerun a recorded run from its run.yaml and the changes in its bag, and compare the bits.',
        epilog='Exit code: 0 the bits are the same, 1 they are not, 2 wrong arguments, 3 the run cannot be read or '
        'rerun.',
    )
    parser.add_argument('run', type=Path, metavar='RUN', help='folder of the run')
    parser.add_argument('--without-ros', action='store_true', help='rerun with simulate instead of rig')
    parser.add_argument('--output', type=Path, metavar='DIR', help='keep the rerun in this new folder')
    parser.add_argument(
        '--trust', action='store_true', help="run code that the run's folder names: a custom controller's class"
    )
    return parser


@command('replay', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Rerun a run; exit code 0 if the bits are the same, 1 if not, 3 if it cannot be rerun."""
    parsed = command_line().parse_args(arguments)
    if parsed.output is not None:
        if parsed.output.exists():
            raise FileExistsError(f'{parsed.output} exists, and a run is never overwritten')
        return replay(parsed.run, parsed.output, without_ros=parsed.without_ros, trusted=parsed.trust)
    with tempfile.TemporaryDirectory() as directory:
        output = Path(directory) / 'rerun'
        return replay(parsed.run, output, without_ros=parsed.without_ros, trusted=parsed.trust)


if __name__ == '__main__':
    sys.exit(main())
