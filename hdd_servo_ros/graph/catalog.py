"""
The catalog of this package's executables: one row per node and one per command.

Help texts, launch files, `rig`, `simulate`, the executables that ``setup.py`` declares and the documents follow from
these rows. The topics that a node reads and writes follow from its name and role, see
:mod:`hdd_servo_ros.graph.connections`.

This file imports the standard library alone, since ``setup.py`` runs it where nothing else is installed. A row
therefore holds import paths, relative to the package, and resolves them when they are used.
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
"""The roles of these names in :mod:`hdd_servo_ros.messages.topics`."""


@functools.cache
def resolve(path: str) -> Any:
    """Return what an import path ``module:name``, relative to the package, names."""
    module, _, name = path.partition(':')
    return getattr(importlib.import_module(f'hdd_servo_ros.{module}'), name)


@dataclasses.dataclass(frozen=True)
class NodeRow:
    """
    A node that can take part in a run.

    Attributes
    ----------
    name
        Name of the node, of its executable and of its module in ``nodes``.
    purpose
        One sentence for help texts and documents.
    parameters
        Import paths of its parameter dataclasses, or the classes themselves, in this order: waiting for peers, sample
        time, others, and last those of the block.
    node
        Import path of its class; empty for the plain node around a controller's block.
    block
        Import path of the class of its block, made from the block's parameters and T [s]; empty where none runs in the
        compiled loop.
    role
        Role by which topics name their writers and readers; empty for a node that is in every run. A role is filled by
        one node of a run, see :mod:`hdd_servo_ros.graph.roles`.
    short_name
        Value of the parameter ``controller`` that stands for it; empty for what is not a built-in controller.
    follows_reference
        For a controller: whether the head is to follow the reference, so that the run has a tracking error.
    needs_ldv
        For a controller: whether it cannot do without the vibrometer.
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
        """The parameter dataclass of its block."""
        return self.parameter_sets[-1]


@dataclasses.dataclass(frozen=True)
class CommandRow:
    """
    An executable that is not a node of the loop.

    Attributes
    ----------
    name
        Name of the executable.
    module
        Its module, relative to the package.
    purpose
        One sentence for help texts and documents.
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
        'The only source of time: publishes the ticks on /clock, paces and ends the run.',
        (_PEERS, 'parameters.run_parameters:TimerParameters'),
        node='nodes.deterministic_timer:DeterministicTimer',
    ),
    NodeRow(
        'reference_generator',
        'Publishes the desired trajectory and its derivatives on /reference.',
        (*_EVERY_NODE, 'signals.reference:ReferenceParameters'),
        node='nodes.reference_generator:ReferenceGenerator',
        block='signals.reference:Reference',
    ),
    NodeRow(
        'playback',
        'Publishes the disturbance of a recorded run again in another run.',
        (*_EVERY_NODE, 'parameters.run_parameters:PlaybackParameters'),
        node='nodes.playback:PlaybackNode',
        role=DISTURBANCE_SOURCE,
    ),
    NodeRow(
        'disturbance_generator',
        'What acts on a drive in use, from runout to shock: publishes /disturbance and /base_acceleration.',
        (*_EVERY_NODE, 'disturbance.parameters:DisturbanceParameters'),
        node='nodes.disturbance_generator:DisturbanceGeneratorNode',
        block='disturbance.generator:DisturbanceGenerator',
        role=DISTURBANCE_SOURCE,
    ),
    NodeRow(
        'vcm_plant',
        'The drive: VCM actuator, pivot friction and resonances; publishes the truth on /head.',
        (*_EVERY_NODE, 'parameters.run_parameters:DriveIdentityParameters', 'drive.plant:PlantParameters'),
        node='nodes.vcm_plant:VcmPlant',
        block='drive.plant:Plant',
    ),
    NodeRow(
        'ldv_sensor',
        'The laser Doppler vibrometer: publishes its two output voltages on /ldv.',
        (*_EVERY_NODE, 'bench.ldv:LdvParameters'),
        node='nodes.ldv_sensor:LdvSensor',
        block='bench.ldv:Ldv',
        role=POSITION_SENSOR,
    ),
    NodeRow(
        'servo_sensor',
        'Decodes the servo sectors of a drive, in place of the vibrometer: publishes position error and position on '
        '/pes.',
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
        'The adaptive neural network controller, eqs. (4.10) to (4.21) of the thesis.',
        (*_EVERY_CONTROLLER, 'control.adaptive_nn:AdaptiveNnParameters'),
        node='nodes.adaptive_nn_controller:AdaptiveNnController',
        block='control.adaptive_nn:AdaptiveNn',
        role=CONTROLLER,
        short_name='adaptive_nn',
    ),
    NodeRow(
        'pid_controller',
        'The conventional PID controller, the baseline.',
        (*_EVERY_CONTROLLER, 'control.pid:PidParameters'),
        block='control.pid:Pid',
        role=CONTROLLER,
        short_name='pid',
    ),
    NodeRow(
        'seek_controller',
        'Brings the head to new targets by planned trajectories, settles and follows with a PID.',
        (*_EVERY_CONTROLLER[:-1], 'control.seek_parameters:SeekControllerParameters', 'control.pid:PidParameters'),
        block='control.pid:Pid',
        role=CONTROLLER,
        short_name='seek',
    ),
    NodeRow(
        'open_loop_controller',
        'Drives the plant open loop: the voltage is x of /reference.',
        (*_EVERY_CONTROLLER, 'control.open_loop:OpenLoopParameters'),
        block='control.open_loop:OpenLoop',
        role=CONTROLLER,
        short_name='open_loop',
        follows_reference=False,
    ),
    NodeRow(
        'signal_analyzer',
        "Sweeps a sine through the drive and writes its frequency response, in a controller's place.",
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
        'Writes every topic of the run into a rosbag2 bag, and run.yaml beside it.',
        (*_EVERY_NODE, 'parameters.run_parameters:RecorderParameters'),
        node='nodes.bag_recorder:BagRecorder',
    ),
)

NODES = {row.name: row for row in _NODE_ROWS}
"""The nodes by name, in the order in which data flows through a tick; after them registered custom controllers."""

CONTROLLERS = {row.short_name: row.name for row in _NODE_ROWS if row.short_name}
"""Values of the parameter ``controller`` of `rig` and `simulate`, and the node each stands for."""

SENSORS = {'ldv': 'ldv_sensor', 'servo': 'servo_sensor'}
"""Values of the parameter ``sensor`` of `rig` and `simulate`, and the node each stands for."""

_RIG_PARAMETERS = ('graph.rig_parameters:RigParameters',)

_COMMAND_ROWS = (
    CommandRow(
        'rig',
        'nodes.rig',
        'The whole graph in one process: runs the experiment, records it, sums it up and plots it.',
        _RIG_PARAMETERS,
    ),
    CommandRow(
        'simulate',
        'simulation.simulate',
        'The same experiment as rig without middleware: the same parameters, the same bag, much faster.',
        _RIG_PARAMETERS,
    ),
    CommandRow(
        'outside_controller',
        'nodes.outside_controller',
        'The node of a controller that is not of this package: a class by its import path or entry point.',
    ),
    CommandRow('study', 'studies.main', "Runs the thesis's experiments and makes its figures and tables."),
    CommandRow('report', 'tools.report', 'Writes metrics, plots and an HTML page of recorded runs.'),
    CommandRow('compare', 'studies.compare', 'Compares several controllers on the same experiments.'),
    CommandRow('campaign', 'campaign.main', 'Makes many runs from one specification and tabulates their metrics.'),
    CommandRow('compare_bags', 'recording.compare_bags', 'Compares the loop topics of two recorded runs byte by byte.'),
    CommandRow('replay', 'tools.replay', 'Runs a recorded run again and compares the bits.'),
    CommandRow('recover', 'tools.recover', 'Repairs a recorded run after a crash.'),
    CommandRow('scope', 'tools.scope', 'Shows the signals of a run while it goes on.'),
    CommandRow('identify', 'analysis.identify', 'Identifies gain and modes from a measured frequency response.'),
    CommandRow('tune', 'studies.tune', 'Tunes the adaptive NN controller and the PID for a drive.'),
    CommandRow(
        'stability_certificate',
        'studies.stability_certificate',
        'Gives the stability certificate of theorem 4.1 for a recorded run.',
    ),
    CommandRow('instruments', 'studies.instruments', 'Tabulates what each instrument does to the tracking error.'),
    CommandRow('swept_sine', 'studies.swept_sine', 'Measures the frequency response of the drive and identifies it.'),
    CommandRow('friction_curves', 'studies.friction_curves', 'Draws the friction curves of figs. 2.1, 2.2 and 5.5.'),
    CommandRow('drive_response', 'studies.drive_response', "Draws the default drive's frequency responses."),
)

COMMANDS = {row.name: row for row in _COMMAND_ROWS}
"""The commands by name."""

EXECUTABLES = (*NODES, *COMMANDS)
"""Names of the package's executables."""


def executable_module(name: str) -> str:
    """Return the module of an executable, relative to the package; raises KeyError if there is none of that name."""
    return _row(name).module


def purpose(name: str) -> str:
    """Return the one sentence that describes a node or command."""
    return _row(name).purpose


def parameter_sets(name: str) -> tuple[type[Any], ...]:
    """Return the parameter dataclasses of a node or command; raises KeyError if there is none of that name."""
    return _row(name).parameter_sets


def follows_reference(controller: str | None) -> bool:
    """
    Return whether the head is to follow the reference with a controller.

    Parameters
    ----------
    controller
        Value of the parameter ``controller``; one that is not built in, or not known, counts as following.
    """
    return controller not in CONTROLLERS or NODES[CONTROLLERS[controller]].follows_reference


def names_with_parameters() -> tuple[str, ...]:
    """Return the names of all nodes and commands for which a parameter file may have a section."""
    return (*NODES, *(row.name for row in COMMANDS.values() if row.parameters))


def nodes_of_run(by_role: Mapping[str, str]) -> tuple[str, ...]:
    """
    Return the names of a run's nodes, in the order in which data flows through a tick.

    Parameters
    ----------
    by_role
        Names of the nodes that fill the roles of this run; the vibrometer is the position sensor unless it says
        otherwise.
    """
    by_role = {POSITION_SENSOR: SENSORS['ldv'], **by_role}
    order = dict.fromkeys(row.role or row.name for row in NODES.values())
    roles = {row.role for row in NODES.values()} - by_role.keys()
    return tuple(by_role.get(item, item) for item in order if item not in roles)


def register_controller(node: str, kind: type[Any], description: str) -> None:
    """
    Add a row for a custom controller: with the parameters that every controller's node has, and its own.

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
        If another node has its name.
    """
    if node in COMMANDS or (node in NODES and NODES[node].parameters[-1] is not kind):
        raise ValueError(f'there is another node {node}')
    NODES[node] = NodeRow(node, description, (*_EVERY_CONTROLLER, kind), role=CONTROLLER)


def common_controller_parameters() -> tuple[type[Any], ...]:
    """Return the parameter dataclasses that the node of every controller has in addition to its own."""
    return _classes(_EVERY_CONTROLLER)


def _row(name: str) -> NodeRow | CommandRow:
    return NODES[name] if name in NODES else COMMANDS[name]
