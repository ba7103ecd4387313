"""Custom controllers: loading, rejection, and runs identical to those of built-in controllers."""

import itertools
import re
import sys
import textwrap

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.control.outside import ControllerError
from hdd_servo_ros.graph.catalog import NODES, purpose
from hdd_servo_ros.graph.controller_loader import load_controller, snake_case
from hdd_servo_ros.graph.known_parameters import node_declarations, reject_unknown
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.simulation.interrupts import interrupts
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.simulation.simulate import SimulatedRun, main, simulate

T = 1e-4
MODULE = (f'module_of_test_controllers_{number}' for number in itertools.count())
GOOD = """
    import dataclasses
    from hdd_servo_ros.parameters import ParameterSet, group, parameter

    @dataclasses.dataclass(frozen=True)
    class Gains(ParameterSet):
        stiffness: float = parameter(0.5, 'k_p', unit='V/um', minimum=0.0)

    class Spring:
        'Pulls back. And more.'
        def __init__(self, parameters: Gains, sample_time: float) -> None:
            self.update(parameters)
        def update(self, parameters):
            self.parameters = parameters
        def step(self, inputs):
            e = inputs.position - inputs.desired_position
            return -self.parameters.stiffness * e - 4e-12 * inputs.velocity
"""


@pytest.fixture(autouse=True)
def nothing_stays(monkeypatch, tmp_path):
    """Run in an empty directory; remove modules, nodes and path entries afterward."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [entry for entry in sys.path if entry])
    modules, nodes = set(sys.modules), dict(NODES)
    yield
    for name in set(sys.modules) - modules:
        if name.startswith('module_of_test'):
            del sys.modules[name]
    NODES.clear()
    NODES.update(nodes)


def write(tmp_path, source=GOOD, *changes):
    """Write a module with replaced strings to the working directory, and return its name."""
    source = textwrap.dedent(source)
    for old, new in changes:
        assert old in source
        source = source.replace(old, new)
    name = next(MODULE)
    (tmp_path / f'{name}.py').write_text(source)
    return name


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('MyController', 'my_controller'),
        ('PIController', 'pi_controller'),
        ('H2', 'h2'),
        ('Lqg2Controller', 'lqg2_controller'),
        ('already_snake', 'already_snake'),
    ],
)
def test_node_names(name, expected):
    assert snake_case(name) == expected


def test_an_import_path_from_the_working_folder(tmp_path):
    found = load_controller(f'{write(tmp_path)}:Spring')
    assert found.node == 'spring'
    assert 'stiffness' in {declaration.name for declaration in node_declarations('spring')}
    assert {'sample_time', 'start_timeout'} <= {declaration.name for declaration in node_declarations('spring')}
    assert purpose('spring') == 'Pulls back. And more.'
    reject_unknown({'stiffness': 1.0})
    with pytest.raises(ParameterError, match='did you mean stiffness'):
        reject_unknown({'stifness': 1.0})


def test_a_node_name_of_its_own(tmp_path):
    module = write(tmp_path, GOOD, ("'Pulls back. And more.'", "node_name = 'puller'"))
    assert load_controller(f'{module}:Spring').node == 'puller'
    assert purpose('puller') == 'The controller Spring.'


def entry_point(tmp_path, distribution, name, value):
    """Install a package that provides a controller."""
    folder = tmp_path / f'{distribution}-1.0.dist-info'
    folder.mkdir()
    (folder / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n')
    (folder / 'entry_points.txt').write_text(f'[hdd_servo_ros.controllers]\n{name} = {value}\n')


def test_an_entry_point(tmp_path, monkeypatch):
    module = write(tmp_path)
    entry_point(tmp_path, 'somebodys', 'spring_of_somebody', f'{module}:Spring')
    monkeypatch.syspath_prepend(tmp_path)
    assert load_controller('spring_of_somebody').node == 'spring'
    with pytest.raises(ParameterError, match=r'one of adaptive_nn, .*, spring_of_somebody, or the import'):
        load_controller('spring_of_nobody')
    entry_point(tmp_path, 'other', 'spring_of_somebody', 'other:Spring')
    with pytest.raises(ParameterError, match=f'several installed packages offer it: {module}:Spring, other:Spring'):
        load_controller('spring_of_somebody')


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ([('def step(', 'def stop(')], r'class Spring lacks step\(inputs\)'),
        ([('def update(', 'def change(')], r'class Spring lacks update\(parameters\)'),
        ([('step(self, inputs)', 'step(self)')], r'Spring\.step\(self\) cannot be called with \(self, inputs\)'),
        ([(', sample_time: float)', ')')], r'Spring\(parameters: .*\) .* cannot be called with \(parameters, sample_t'),
        ([('parameters: Gains', 'parameters')], r'Spring\.__init__ does not annotate parameters'),
        ([('parameters: Gains', "parameters: 'Gainz'")], r'annotations of Spring\.__init__ raised NameError'),
        ([('parameters: Gains', 'parameters: dict')], r'dict is not a frozen dataclass derived from .*ParameterSet'),
        ([('@dataclasses.dataclass(frozen=True)', '')], r'Gains is not a frozen dataclass'),
        ([('(frozen=True)', ''), ('(ParameterSet)', '')], r'Gains is not a frozen dataclass'),
        ([("parameter(0.5, 'k_p', unit='V/um', minimum=0.0)", '0.5')], r'Gains\.stiffness is not declared by'),
        ([('(0.5,', '(-0.5,')], r'the defaults of Gains: invalid value for parameter stiffness: -0\.5;'),
        ([('stiffness: float', 'peer_timeout: float')], r'Gains\.peer_timeout: every node has a para'),
        ([('class Spring', 'class VcmPlant'), ], r' has no Spring'),
        ([("'Pulls back. And more.'", "node_name = 'vcm_plant'")], r'there is another node vcm_plant; give class Spr'),
        ([("'Pulls back. And more.'", "node_name = 'a node'")], r"node name 'a node' does not consist of letters"),
        ([('class Spring', 'Spring = 3\nclass Other')], r'3 is not a class'),
        ([('import dataclasses', 'import dataclasses, no_such_module')], r'importing .* raised ModuleNotFoundError: '),
        ([('import dataclasses', 'import dataclasses\nraise SystemExit(3)')], r'importing .* raised SystemExit: 3 \('),
    ],
)  # fmt: skip
def test_an_invalid_controller_is_rejected(tmp_path, changes, message):
    module = write(tmp_path, GOOD, *changes)
    with pytest.raises(ParameterError, match=message) as rejected:
        load_controller(f'{module}:Spring')
    assert str(rejected.value).startswith(f"invalid value for parameter controller: '{module}:Spring'; ")
    assert '\n' not in str(rejected.value)


FORMER = ('tick', 'displacement_volts', 'velocity_volts', 'x_d', 'dx_d', 'ddx_d')


@pytest.mark.parametrize(
    'arguments',
    [FORMER, ('k', 'x', 'v', 'x_d', 'dx_d', 'ddx_d'), ('k', 'x', 'v', '*reference'), ('tick', '*signals'), ('tick',)],
    ids=', '.join,
)
def test_the_former_arguments_of_step_are_rejected_with_what_to_change(tmp_path, capsys, arguments):
    module = write(tmp_path, GOOD, ('step(self, inputs)', f'step(self, {", ".join(arguments)})'))
    advice = (
        'Spring.step now takes one argument: inputs, with inputs.tick, inputs.position [um] and inputs.velocity [um/s]'
    )
    with pytest.raises(ParameterError, match=re.escape(advice)):
        load_controller(f'{module}:Spring')
    assert main(['--ros-args', '-p', f'controller:={module}:Spring', '-p', f'run_dir:={tmp_path}/run']) == 2
    # With a cold cache a line says first that kernels are being compiled.
    (error,) = [line for line in capsys.readouterr().err.splitlines() if 'invalid' in line]
    assert error.startswith(f"simulate: invalid value for parameter controller: '{module}:Spring'; {advice}")
    assert error.endswith('; see docs/tutorial-own-controller.md')


@pytest.mark.parametrize(
    ('arguments', 'law', 'hinted'),
    [
        ('*args', '(k, x, v, *reference) = args', True),
        ('k, x=0.0, v=0.0, x_d=0.0, dx_d=0.0, ddx_d=0.0', 'k * 1e-4', True),
        ('inputs', '(k, x, v, *reference) = inputs.tick', False),
    ],
)
def test_former_arguments_that_only_a_trial_finds_are_rejected_with_what_to_change(tmp_path, arguments, law, hinted):
    error = 'e = inputs.position - inputs.desired_position'
    module = write(tmp_path, GOOD, ('step(self, inputs)', f'step(self, {arguments})'), (error, law))
    with pytest.raises(
        ParameterError, match=r'trial step with zeros failed: spring: step raised (Type|Value)Error'
    ) as rejected:
        simulation(tmp_path, module)
    assert ('; Spring.step now takes one argument: inputs, with' in str(rejected.value)) == hinted


@pytest.mark.parametrize('arguments', ['inputs', 'measured', '*arguments', 'inputs, gain=1.0'])
def test_step_with_one_argument_of_any_name(tmp_path, arguments):
    module = write(tmp_path, GOOD, ('step(self, inputs)', f'step(self, {arguments})'))
    assert load_controller(f'{module}:Spring').node == 'spring'


@pytest.mark.parametrize('name', ['no_such_module:Spring', 'no_such_package.module:Spring'])
def test_a_module_that_is_not_there(name, tmp_path):
    with pytest.raises(ParameterError, match=f'module no_such_[a-z]+ is neither on sys.path nor in {tmp_path}'):
        load_controller(name)


def test_a_file_named_instead_of_its_module(tmp_path):
    module = write(tmp_path, GOOD)
    with pytest.raises(ParameterError, match=r'give the module without \.py'):
        load_controller(f'{module}.py:Spring')


@pytest.mark.parametrize('name', ['a:', ':B', 'a b:C', '../a:B'])
def test_an_invalid_import_path_is_rejected(name):
    with pytest.raises(ParameterError, match='is not an import path module:Class'):
        load_controller(name)


def test_two_classes_of_one_name(tmp_path):
    load_controller(f'{write(tmp_path)}:Spring')
    with pytest.raises(ParameterError, match='there is another node spring; give class Spring an attribute node_name'):
        load_controller(f'{write(tmp_path)}:Spring')


SAME_AS_PID = """
    from hdd_servo_ros.control.pid import Pid, PidParameters

    class Copy(Pid):
        def __init__(self, parameters: PidParameters, sample_time: float) -> None:
            super().__init__(parameters, sample_time)
"""


def test_the_results_are_bit_identical_to_those_of_the_compiled_loop(tmp_path):
    """A built-in law as a custom controller: every signal is bit-identical, wherever the run is divided."""
    module = write(tmp_path, SAME_AS_PID)
    gains = {'proportional_gain': 0.3, 'control_limit': 0.05}
    gains |= {'dsp.computation_delay': 1, 'dsp.dac_bits': 12, 'dsp.dac_range': 0.04}
    drive = {'vcm_plant': {'disturbance.amplitude': 0.01, 'disturbance.angular_frequency': 300.0}}
    outside = Experiment(T, f'{module}:Copy', {**drive, 'copy': gains})
    compiled = Experiment(T, 'pid', {**drive, 'pid_controller': gains})
    outside.compile()
    assert compiled.is_compiled
    assert not outside.is_compiled
    for first, count in ((0, 1), (1, 700), (701, 1300)):
        ours, theirs = outside.run(first, count), compiled.run(first, count)
        assert ours.estimate_names == theirs.estimate_names
        for name in ('reference', 'head', 'ldv', 'control', 'estimates'):
            assert ours[name].tobytes() == theirs[name].tobytes(), name


def simulation(tmp_path, module, *arguments):
    path = f'{module}:Spring'
    ros = ['--ros-args', '-p', f'controller:={path}', '-p', f'run_dir:={tmp_path}/run', '-p', 'duration:=0.05']
    return Simulation(parse_ros_arguments([*ros, *arguments]))


def test_its_parameters_are_taken_and_rejected_like_any(tmp_path):
    module = write(tmp_path)
    file = tmp_path / 'gains.yaml'
    file.write_text('/**/spring:\n  ros__parameters:\n    stiffness: 0.25\n')
    made = simulation(tmp_path, module, '--params-file', str(file))
    assert made.nodes['/spring']['parameters']['stiffness'] == 0.25
    assert made.nodes['/spring']['outputs'] == ['/control', '/estimates']
    assert simulation(tmp_path, module, '-p', 'stiffness:=0.75').nodes['/spring']['parameters']['stiffness'] == 0.75
    with pytest.raises(ParameterError, match=r'spring:stiffness: -1\.0; expected a finite number at least 0 \[V/um\]'):
        simulation(tmp_path, module, '-p', 'spring:stiffness:=-1.0')
    with pytest.raises(ParameterError, match='did you mean stiffness'):
        simulation(tmp_path, module, '-p', 'spring:stifness:=1.0')


def test_a_summary_without_a_record_names_its_node(tmp_path):
    made = simulation(tmp_path, write(tmp_path), '-p', 'record:=false')
    run = SimulatedRun(made)
    with interrupts() as requests:
        outcome = run.run(requests, None)
    assert 'controller  spring, drive' in run.summary(outcome)


def test_run_yaml_records_the_class(tmp_path):
    module = write(tmp_path)
    message = simulation(tmp_path, module).description()
    assert message['controller_class'] == f'{module}:Spring'
    assert len(message['controller_sha256']) == 64
    (tmp_path / f'{module}.py').write_text((tmp_path / f'{module}.py').read_text() + '\n# changed')
    assert simulation(tmp_path, module).description()['controller_sha256'] != message['controller_sha256']


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('1.0 / (inputs.tick - 0x11) if inputs.tick > 0x11 else 0.0 * inputs.tick', ''),
        (
            '1.0 / (inputs.tick - 0x12d) if inputs.tick else 0.0',
            'step raised ZeroDivisionError: float division by zero',
        ),
        ("float('nan') if inputs.tick == 0x12d else 0.0", 'control: not finite'),
        ('None if inputs.tick == 0x12d else 0.0', 'step returned None, not the voltage u'),
    ],
)
def test_a_simulation_ends_at_the_tick_that_fails(tmp_path, capsys, body, message):
    """Tick 301 is in the second piece of a simulation."""
    law = '-self.parameters.stiffness * e - 4e-12 * inputs.velocity'
    made = simulation(tmp_path, write(tmp_path, GOOD, (law, body)))
    exit_code, directory = simulate(made, progress=False)
    assert directory is not None
    ticks = len(Run.open(directory).time)
    errors = capsys.readouterr().err
    if not message:
        assert (exit_code, ticks) == (0, 501)
    else:
        assert (exit_code, ticks) == (1, 301)
        assert message in errors
        assert 'at tick 301' in errors
        assert errors.count('\n') == 1


def test_a_fault_of_its_own_is_the_reason_and_its_plan_the_length(tmp_path, capsys):
    law = 'return -self.parameters.stiffness * e - 4e-12 * inputs.velocity'
    own = "return float('nan') if inputs.tick == 40 else 0.0\n"
    own += "    last_tick = 60\n    def fault(self): return 'it is lost'"
    module = write(tmp_path, GOOD, (law, own))
    ros = ['--ros-args', '-p', f'controller:={module}:Spring', '-p', f'run_dir:={tmp_path}/run', '-p', 'duration:=0.0']
    made = Simulation(parse_ros_arguments(ros))
    assert made.last_tick == 60
    assert simulate(made, progress=False)[0] == 1
    assert capsys.readouterr().err == 'simulate: run failed: it is lost\n'


def test_warnings_that_are_no_list_end_the_command_in_one_line(tmp_path, capsys):
    warning = "def warnings(self): return 'mind'\n    def update("
    module = write(tmp_path, GOOD, ('def update(', warning))
    assert main(['--ros-args', '-p', f'controller:={module}:Spring', '-p', 'record:=false']) == 2
    message = "simulate: spring: warnings returned 'mind', not a list or tuple of strings, at tick 0\n"
    assert capsys.readouterr().err.endswith(message)


def test_a_scheduled_change_that_the_class_cannot_take_is_rejected_before_the_run(tmp_path):
    rejecting = 'assert parameters.stiffness < 1.0; self.parameters = parameters'
    module = write(tmp_path, GOOD, ('self.parameters = parameters', rejecting))
    with pytest.raises(ParameterError, match=r"schedule: '0.03 spring stiffness 1.5'; .*AssertionError"):
        simulation(tmp_path, module, '-p', "schedule:=['0.01 spring stiffness 0.75', '0.03 spring stiffness 1.5']")


def test_a_scheduled_change_that_the_class_fails_to_take_in_the_run_ends_it(tmp_path, capsys):
    # A trial cannot know what the class holds against it by then.
    rejecting = "assert parameters.stiffness < 1.0 or not hasattr(self, 'late'); self.parameters = parameters"
    late = 'e = inputs.position - inputs.desired_position; self.__dict__.update({"late": 1} if inputs.tick > 9 else {})'
    changes = (('self.parameters = parameters', rejecting), ('e = inputs.position - inputs.desired_position', late))
    module = write(tmp_path, GOOD, *changes)
    made = simulation(tmp_path, module, '-p', "schedule:=['0.01 spring stiffness 0.75', '0.03 spring stiffness 1.5']")
    exit_code, directory = simulate(made, progress=False)
    assert exit_code == 1
    assert 'spring: update raised AssertionError' in capsys.readouterr().err
    assert directory is not None
    assert len(Run.open(directory).time) == 300
    assert [change.tick for change in Run.open(directory).parameter_changes] == [100]


def test_after_what_is_not_finite_it_is_not_asked_again(tmp_path):
    law = '-self.parameters.stiffness * e - 4e-12 * inputs.velocity'
    module = write(tmp_path, GOOD, (law, "float('inf') if inputs.tick == 40 else float(round(inputs.position))"))
    rows = Experiment(T, f'{module}:Spring').run(0, 100)
    assert abs(rows.head[:41]).max() < float('inf')
    assert all(
        (signal[41:] != signal[41:]).all()
        for signal in (rows[name] for name in ('head', 'ldv', 'control', 'estimates'))
    )


def test_a_failure_leaves_the_rows_before_it(tmp_path):
    law = '-self.parameters.stiffness * e - 4e-12 * inputs.velocity'
    module = write(tmp_path, GOOD, (law, '1.0 / (60 - inputs.tick) if inputs.tick else 0.0'))
    experiment = Experiment(T, f'{module}:Spring')
    rows = experiment.empty_rows(0, 100)
    with pytest.raises(ControllerError, match=r'spring: step raised ZeroDivisionError.* at tick 60'):
        experiment.run(0, 100, rows)
    assert rows.control[:60, 0].tolist() == [0.0, *(1.0 / (60 - tick) for tick in range(1, 60))]


def test_what_fails_at_once_is_rejected_before_a_run(tmp_path):
    law = '-self.parameters.stiffness * e - 4e-12 * inputs.velocity'
    module = write(tmp_path, GOOD, (law, '1.0 / inputs.position'))
    with pytest.raises(ParameterError, match='trial step with zeros failed: spring: step raised ZeroDivisionError'):
        simulation(tmp_path, module)
