"""
Catalog of the executables of this package: one row per node and one per command.

The help of the commands, launch files, `rig`, `simulate`, the executables in ``setup.py`` and the reference pages are
derived from these rows. The inputs and outputs of a node are derived from its name and role, see
:mod:`hdd_servo_ros.graph.connections`.

This file imports only the standard library, because ``setup.py`` runs it before anything else is installed. A row
therefore contains import paths, relative to the package, and resolves them on use.
"""

import dataclasses
import functools
import importlib
from collections.abc import Mapping
from typing import Any

CONTROLLER = 'controller'
DISTURBANCE_SOURCE = 'disturbance source'
POSITION_SENSOR = 'position sensor'
BASE_SENSOR = 'accelerometer'
"""Role names as in :mod:`hdd_servo_ros.messages.topics`."""


@functools.cache
def resolve(path: str) -> Any:
    """Return the object with an import path ``module:name`` relative to the package."""
    module, _, name = path.partition(':')
    return getattr(importlib.import_module(f'hdd_servo_ros.{module}'), name)


@dataclasses.dataclass(frozen=True)
class NodeRow:
    """
    Catalog row of a node.

    Attributes
    ----------
    name
        Name of the node, of its executable and of its module in ``nodes``.
    purpose
        One sentence for the help and the reference pages.
    parameters
        Import paths of its parameter dataclasses, or the classes themselves, in this order: peers, sample time,
        others, block.
    node
        Import path of its class; empty for the generic node of a controller block.
    block
        Import path of its block class, constructed from the block parameters and T [s]; empty if the compiled loop has
        no such block.
    role
        Role in the definitions of the topics; empty for a node that is in every run. One node per run fills a role,
        see :mod:`hdd_servo_ros.graph.roles`.
    short_name
        Value of the parameter ``controller`` for a built-in controller; otherwise empty.
    follows_reference
        For a controller: whether the head follows the reference, so that the run has a tracking error.
    needs_ldv
        For a controller: whether it requires the vibrometer.
    """

    name: str
    purpose: str
    parameters: tuple[str | type[Any], ...]
    node: str = ''
    block: str = ''
    role: str = ''
    short_name: str = ''
    follows_reference: bool = True
    needs_ldv: bool = False

    @property
    def module(self) -> str:
        """Module of the executable, relative to the package."""
        return f'nodes.{self.name}'

    @property
    def parameter_sets(self) -> tuple[type[Any], ...]:
        """Its parameter dataclasses."""
        return _classes(self.parameters)

    @property
    def block_parameters(self) -> type[Any]:
        """Parameter dataclass of its block."""
        return self.parameter_sets[-1]


@dataclasses.dataclass(frozen=True)
class CommandRow:
    """
    Catalog row of an executable that is not a loop node.

    Attributes
    ----------
    name
        Name of the executable.
    module
        Its module, relative to the package.
    purpose
        One sentence for the help and the reference pages.
    parameters
        Import paths of its parameter dataclasses, for a command that takes ROS parameters.
    """

    name: str
    module: str
    purpose: str
    parameters: tuple[str, ...] = ()

    @property
    def parameter_sets(self) -> tuple[type[Any], ...]:
        """Its parameter dataclasses."""
        return _classes(self.parameters)


def _classes(paths: tuple[str | type[Any], ...]) -> tuple[type[Any], ...]:
    return tuple(resolve(path) if isinstance(path, str) else path for path in paths)


_PEERS = 'parameters.run_parameters:PeerParameters'
_EVERY_NODE = (_PEERS, 'parameters.run_parameters:SampleTimeParameters')
_EVERY_CONTROLLER = (
    *_EVERY_NODE,
    'bench.dsp:ControllerInputParameters',
    'bench.dsp:ControllerOutputParameters',
    'control.feedforward_parameters:ControllerFeedforwardParameters',
    'control.runout_parameters:ControllerRunoutParameters',
    'control.observer:ControllerObserverParameters',
    'control.seek_parameters:ControllerSeekParameters',
)

_NODE_ROWS = (
    NodeRow(
        'deterministic_timer',
        'Only time source of a run: publishes the ticks on /clock, paces the run and ends it.',
        (_PEERS, 'parameters.run_parameters:TimerParameters'),
        node='nodes.deterministic_timer:DeterministicTimer',
    ),
    NodeRow(
        'reference_generator',
        'Publishes the desired position and its derivatives on /reference.',
        (*_EVERY_NODE, 'signals.reference:ReferenceParameters'),
        node='nodes.reference_generator:ReferenceGenerator',
        block='signals.reference:Reference',
    ),
    NodeRow(
        'playback',
        'Publishes the disturbance of a recorded run in another run.',
        (*_EVERY_NODE, 'parameters.run_parameters:PlaybackParameters'),
        node='nodes.playback:PlaybackNode',
        role=DISTURBANCE_SOURCE,
    ),
    NodeRow(
        'disturbance_generator',
        'Disturbances of a drive in use, from runout to shock: publishes /disturbance and /base_acceleration.',
        (*_EVERY_NODE, 'disturbance.parameters:DisturbanceParameters'),
        node='nodes.disturbance_generator:DisturbanceGeneratorNode',
        block='disturbance.generator:DisturbanceGenerator',
        role=DISTURBANCE_SOURCE,
    ),
    NodeRow(
        'vcm_plant',
        'Simulated drive: VCM actuator, pivot friction and resonances; publishes the true head position on /head.',
        (*_EVERY_NODE, 'parameters.run_parameters:DriveIdentityParameters', 'drive.plant:PlantParameters'),
        node='nodes.vcm_plant:VcmPlant',
        block='drive.plant:Plant',
    ),
    NodeRow(
        'ldv_sensor',
        'Laser Doppler vibrometer: publishes its two output voltages on /ldv.',
        (*_EVERY_NODE, 'bench.ldv:LdvParameters'),
        node='nodes.ldv_sensor:LdvSensor',
        block='bench.ldv:Ldv',
        role=POSITION_SENSOR,
    ),
    NodeRow(
        'servo_sensor',
        'Servo sectors of a drive, used instead of the vibrometer: publishes position error and position on /pes.',
        (*_EVERY_NODE, 'bench.servo_sensor:ServoSensorParameters'),
        node='nodes.servo_sensor:ServoSensorNode',
        block='bench.servo_sensor:ServoSensor',
        role=POSITION_SENSOR,
    ),
    NodeRow(
        'accelerometer',
        'Two accelerometers on the base of the drive: publishes their output voltages on /accelerometer.',
        (*_EVERY_NODE, 'bench.accelerometer:AccelerometerParameters'),
        node='nodes.accelerometer:AccelerometerNode',
        block='bench.accelerometer:Accelerometer',
        role=BASE_SENSOR,
    ),
    NodeRow(
        'adaptive_nn_controller',
        'Adaptive neural network controller, thesis eqs. 4.10 to 4.21.',
        (*_EVERY_CONTROLLER, 'control.adaptive_nn:AdaptiveNnParameters'),
        node='nodes.adaptive_nn_controller:AdaptiveNnController',
        block='control.adaptive_nn:AdaptiveNn',
        role=CONTROLLER,
        short_name='adaptive_nn',
    ),
    NodeRow(
        'pid_controller',
        'Conventional PID controller, the baseline.',
        (*_EVERY_CONTROLLER, 'control.pid:PidParameters'),
        block='control.pid:Pid',
        role=CONTROLLER,
        short_name='pid',
    ),
    NodeRow(
        'seek_controller',
        'Seeks to new targets along planned trajectories, settles, and follows the track with a PID controller.',
        (*_EVERY_CONTROLLER[:-1], 'control.seek_parameters:SeekControllerParameters', 'control.pid:PidParameters'),
        block='control.pid:Pid',
        role=CONTROLLER,
        short_name='seek',
    ),
    NodeRow(
        'open_loop_controller',
        'Drives the plant in open loop: the voltage is x of /reference.',
        (*_EVERY_CONTROLLER, 'control.open_loop:OpenLoopParameters'),
        block='control.open_loop:OpenLoop',
        role=CONTROLLER,
        short_name='open_loop',
        follows_reference=False,
    ),
    NodeRow(
        'signal_analyzer',
        'Excites the drive with a swept sine instead of a controller, and writes its frequency response.',
        (*_EVERY_CONTROLLER, 'bench.signal_analyzer_parameters:SignalAnalyzerParameters'),
        node='nodes.signal_analyzer:SignalAnalyzerNode',
        block='bench.signal_analyzer:SignalAnalyzer',
        role=CONTROLLER,
        short_name='signal_analyzer',
        follows_reference=False,
        needs_ldv=True,
    ),
    NodeRow(
        'bag_recorder',
        'Records every topic of the run in a rosbag2 bag, and writes run.yaml.',
        (*_EVERY_NODE, 'parameters.run_parameters:RecorderParameters'),
        node='nodes.bag_recorder:BagRecorder',
    ),
)

NODES = {row.name: row for row in _NODE_ROWS}
"""Nodes by name, in the order of the data flow within a tick, followed by registered custom controllers."""

CONTROLLERS = {row.short_name: row.name for row in _NODE_ROWS if row.short_name}
"""Node for each value of the parameter ``controller`` of `rig` and `simulate`."""

SENSORS = {'ldv': 'ldv_sensor', 'servo': 'servo_sensor'}
"""Node for each value of the parameter ``sensor`` of `rig` and `simulate`."""

_RIG_PARAMETERS = ('graph.rig_parameters:RigParameters',)

_COMMAND_ROWS = (
    CommandRow(
        'rig',
        'nodes.rig',
        'Complete graph in one process: runs the experiment, records it, summarizes it and plots it.',
        _RIG_PARAMETERS,
    ),
    CommandRow(
        'simulate',
        'simulation.simulate',
        'Same experiment as rig without ROS middleware: same parameters, same bag, much faster.',
        _RIG_PARAMETERS,
    ),
    CommandRow(
        'outside_controller',
        'nodes.outside_controller',
        'Node of a custom controller, given as the import path or entry point of a class.',
    ),
    CommandRow('study', 'studies.main', 'Runs the experiments of the thesis and produces its figures and tables.'),
    CommandRow('report', 'tools.report', 'Writes metrics, plots and an HTML report of recorded runs.'),
    CommandRow('compare', 'studies.compare', 'Compares several controllers on the same experiments.'),
    CommandRow('campaign', 'campaign.main', 'Executes many runs from one specification and tabulates their metrics.'),
    CommandRow('compare_bags', 'recording.compare_bags', 'Compares the loop topics of two recorded runs byte by byte.'),
    CommandRow('replay', 'tools.replay', 'Replays a recorded run and compares the two byte by byte.'),
    CommandRow('recover', 'tools.recover', 'Repairs a recorded run after a crash.'),
    CommandRow('scope', 'tools.scope', 'Shows the signals of a run in progress.'),
    CommandRow(
        'identify', 'analysis.identify', 'Identifies the gain and the modes from a measured frequency response.'
    ),
    CommandRow('tune', 'studies.tune', 'Tunes the adaptive NN controller and the PID controller for a drive.'),
    CommandRow(
        'stability_certificate',
        'studies.stability_certificate',
        'Computes the stability certificate of theorem 4.1 for a recorded run.',
    ),
    CommandRow('instruments', 'studies.instruments', 'Tabulates the effect of each instrument on the tracking error.'),
    CommandRow('swept_sine', 'studies.swept_sine', 'Measures the frequency response of the drive and identifies it.'),
    CommandRow('friction_curves', 'studies.friction_curves', 'Plots the friction curves of figs. 2.1, 2.2 and 5.5.'),
    CommandRow('drive_response', 'studies.drive_response', 'Plots the frequency responses of the default drive.'),
)

COMMANDS = {row.name: row for row in _COMMAND_ROWS}
"""Commands by name."""

EXECUTABLES = (*NODES, *COMMANDS)
"""Names of the executables of this package."""


def executable_module(name: str) -> str:
    """Return the module of an executable, relative to the package; raises KeyError for an unknown name."""
    return _row(name).module


def purpose(name: str) -> str:
    """Return the purpose of a node or command in one sentence."""
    return _row(name).purpose


def parameter_sets(name: str) -> tuple[type[Any], ...]:
    """Return the parameter dataclasses of a node or command; raises KeyError for an unknown name."""
    return _row(name).parameter_sets


def follows_reference(controller: str | None) -> bool:
    """
    Return whether the head follows the reference with a controller.

    Parameters
    ----------
    controller
        Value of the parameter ``controller``; a custom or unknown controller counts as following.
    """
    return controller not in CONTROLLERS or NODES[CONTROLLERS[controller]].follows_reference


def names_with_parameters() -> tuple[str, ...]:
    """Return the names of all nodes and commands that may have a section in a parameter file."""
    return (*NODES, *(row.name for row in COMMANDS.values() if row.parameters))


def nodes_of_run(by_role: Mapping[str, str]) -> tuple[str, ...]:
    """
    Return the names of the nodes of a run, in the order of the data flow within a tick.

    Parameters
    ----------
    by_role
        Names of the nodes that fill the roles of the run; the default position sensor is the vibrometer.
    """
    by_role = {POSITION_SENSOR: SENSORS['ldv'], **by_role}
    order = dict.fromkeys(row.role or row.name for row in NODES.values())
    roles = {row.role for row in NODES.values()} - by_role.keys()
    return tuple(by_role.get(item, item) for item in order if item not in roles)


def register_controller(node: str, kind: type[Any], description: str) -> None:
    """
    Add a row for a custom controller, with the common controller parameters and its own.

    Parameters
    ----------
    node
        Name of its node.
    kind
        Its own parameters.
    description
        Its purpose in one sentence.

    Raises
    ------
    ValueError
        If another node has the same name.
    """
    if node in COMMANDS or (node in NODES and NODES[node].parameters[-1] is not kind):
        raise ValueError(f'there is another node {node}')
    NODES[node] = NodeRow(node, description, (*_EVERY_CONTROLLER, kind), role=CONTROLLER)


def common_controller_parameters() -> tuple[type[Any], ...]:
    """Return the parameter dataclasses that every controller node has in addition to its own."""
    return _classes(_EVERY_CONTROLLER)


def _row(name: str) -> NodeRow | CommandRow:
    return NODES[name] if name in NODES else COMMANDS[name]
