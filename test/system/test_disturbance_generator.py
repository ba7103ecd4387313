"""A run with generated disturbances is the same bits in separate processes, in `rig`, in `simulate` and replayed."""

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.recording.compare_bags import first_difference

DURATION = ('-p', 'duration:=0.1')
GENERATOR = '/disturbance_generator'
VALUES = {
    'vibration.rotational.enabled': True,
    'vibration.rotational.rms': 12.5,
    'vibration.linear.enabled': True,
    'vibration.linear.kind': 'swept_sine',
    'flutter.enabled': True,
    'force_noise.enabled': True,
    'runout.repeatable.enabled': True,
    'shock.enabled': True,
    'shock.time': 0.03,
}
SCHEDULE = (
    '-p',
    "schedule:=['0.05 disturbance_generator vibration.rotational.rms 25.0',"
    " '0.05 disturbance_generator vibration.rotational.high 300.0',"
    " '0.06 disturbance_generator flutter.enabled false', '0.07 reference_generator frequency 150']",
)


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    generator = DisturbanceGenerator(from_mapping(DisturbanceParameters, VALUES), 1e-4)
    generator.rows(0, 1)
    generator.step(1)


@pytest.fixture
def arguments(tmp_path):
    """Return the arguments of the run: a parameter file with a section of the generator, and a schedule."""
    lines = [f'    {name}: {str(value).lower()}' for name, value in VALUES.items()]
    file = tmp_path / 'generator.yaml'
    file.write_text('\n'.join(['/**/disturbance_generator:', '  ros__parameters:', *lines]) + '\n')
    return ('--params-file', str(file), *DURATION, *SCHEDULE)


def replay(bench, *arguments):
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', *arguments)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return answer.stdout


def test_the_same_bits_however_it_is_run(bench, arguments):
    for name in ('simulate', 'rig'):
        bench.run(name, *arguments, '-p', f'run_dir:={name}', '-p', 'plot:=false')
    # On a busy machine a process may be silent for seconds while the others start.
    patient = ('-p', 'peer_timeout:=30.0')
    nodes = bench.start_nodes('processes', *arguments, *patient)
    nodes['disturbance_generator'] = bench.start('disturbance_generator', *arguments, *patient)
    for process in nodes.values():
        assert process.wait() == 0, process.output
    simulated = bench.directory / 'simulate'
    for run in ('rig', 'processes'):
        assert first_difference(simulated, bench.directory / run) is None
        recorded = Run.open(bench.directory / run)
        assert recorded.description['nodes'][GENERATOR]['outputs'] == ['/disturbance', '/base_acceleration']
        assert [(change.tick, change.name) for change in recorded.parameter_changes] == [
            (500, 'vibration.rotational.high'),
            (500, 'vibration.rotational.rms'),
            (600, 'flutter.enabled'),
            (700, 'frequency'),
        ]
    # What is recorded is what the block says by itself.
    generator = DisturbanceGenerator(from_mapping(DisturbanceParameters, VALUES), 1e-4)
    disturbance, acceleration = generator.rows(0, 500)
    recorded = Run.open(simulated)
    assert recorded.disturbance[:500].tobytes() == disturbance.tobytes()
    assert recorded.base_acceleration[:500].tobytes() == acceleration.tobytes()
    assert recorded.base_acceleration.angular_z[500] != generator.rows(500, 1)[1][0, 5]
    for how in ((), ('--without-ros',)):
        text = replay(bench, 'rig', *how)
        assert '0.05 /disturbance_generator vibration.rotational.rms 25.0' in text
        assert 'bit-identical on every topic, ticks 0 to 1000' in text
    # Its disturbance alone acts on another run as well.
    bench.run('simulate', *DURATION, '-p', 'run_dir:=played', '-p', 'playback:recorded_run:=rig', '-p', 'plot:=false')
    played = Run.open(bench.directory / 'played')
    assert played.disturbance.tobytes() == recorded.disturbance.tobytes()
    assert played.base_acceleration.tobytes() == recorded.base_acceleration.tobytes()


def test_one_value_on_the_command_line_adds_the_generator(bench):
    more = ('-p', 'disturbance_generator:shock.enabled:=true', '-p', 'disturbance_generator:shock.time:=0.02')
    for name in ('simulate', 'rig'):
        bench.run(name, *DURATION, *more, '-p', f'run_dir:={name}', '-p', 'plot:=false')
    assert first_difference(bench.directory / 'simulate', bench.directory / 'rig') is None
    run = Run.open(bench.directory / 'simulate')
    assert run.disturbance.force[190:200].tolist() == [0.0] * 10
    assert run.disturbance.force[205] > 0.1
    # Where nothing acted, the run without a generator is the same.
    bench.run('simulate', *DURATION, '-p', 'run_dir:=plain', '-p', 'plot:=false')
    plain = Run.open(bench.directory / 'plain')
    assert 'disturbance' not in plain
    assert plain.head[:201].tobytes() == run.head[:201].tobytes()
    assert plain.head[202].tobytes() != run.head[202].tobytes()


@pytest.mark.parametrize('name', ['simulate', 'rig'])
def test_what_does_not_go_with_the_sample_time_is_rejected(bench, name):
    on = ('-p', 'disturbance_generator:vibration.rotational.enabled:=true')
    high = ('-p', 'disturbance_generator:vibration.rotational.high:=5000.0')
    process = bench.start(name, *DURATION, *on, *high, '-p', 'run_dir:=run')
    assert process.wait() in (1, 2)
    assert 'vibration.rotational.high: 5000.0; expected below half the sampling rate, 5000 Hz' in process.output
    entry = "schedule:=['0.05 disturbance_generator vibration.rotational.high 6000.0']"
    process = bench.start(name, *DURATION, *on, '-p', entry, '-p', 'run_dir:=other')
    assert process.wait() in (1, 2)
    assert "schedule: '0.05 disturbance_generator vibration.rotational.high 6000.0';" in process.output


def test_a_live_change_is_rejected_or_takes_effect_and_is_replayed(bench, outside):
    from diagnostic_msgs.msg import DiagnosticArray
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    statuses = {}
    outside.create_subscription(
        DiagnosticArray, '/diagnostics', lambda array: statuses.update({one.name: one for one in array.status}), 10
    )
    more = ('-p', 'disturbance_generator:vibration.rotational.enabled:=true', '-p', 'rate:=0.2')
    process = bench.start('rig', '-p', 'duration:=30.0', *more, '-p', 'run_dir:=run', '-p', 'plot:=false')

    def change(name, value):
        double = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=double)])
        answer, _ = outside.call(SetParameters, f'{GENERATOR}/set_parameters', request)
        return answer.results[0]

    # Once its diagnosis comes, the run goes on.
    name = 'disturbance_generator: sources'
    outside.spin_until(lambda: name in statuses and float(statuses[name].values[0].value) > 0.0)
    assert statuses[name].message == 'enabled: vibration.rotational'
    rejected = change('vibration.rotational.high', 6000.0)
    assert not rejected.successful
    assert 'below half the sampling rate, 5000 Hz' in rejected.reason
    assert change('vibration.rotational.rms', 30.0).successful
    outside.spin_for(1.0)
    process.signal(2)
    assert process.wait() == 130
    (made,) = Run.open(bench.directory / 'run').parameter_changes
    assert (made.name, made.value) == ('vibration.rotational.rms', 30.0)
    assert 'bit-identical on every topic' in replay(bench, 'run', '--without-ros')
