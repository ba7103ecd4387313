"""A schedule takes effect at its tick wherever the nodes run, and a tuning session is replayed to the bit."""

import signal
import time
from pathlib import Path

import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.parameter_history import recorded_changes

HERE = Path(__file__).parent
DURATION = ('-p', 'duration:=0.1')
SCHEDULE = (
    '-p',
    "schedule:=['0.05 adaptive_nn_controller feedback_gain 1.0e-4', '0.05 adaptive_nn_controller mass.gain 1.0e-9',"
    " '0.05 reference_generator frequency 150', 'then 0.05 reference_generator amplitude 1.5',"
    " '0.07 vcm_plant friction.stiffness 0.03', '0.1 reference_generator amplitude 2.5']",
)
CHANGES = [
    (500, '/adaptive_nn_controller', {'feedback_gain': 1e-4, 'mass.gain': 1e-9}),
    (500, '/reference_generator', {'frequency': 150.0}),
    (500, '/reference_generator', {'amplitude': 1.5}),
    (700, '/vcm_plant', {'friction.stiffness': 0.03}),
    (1000, '/reference_generator', {'amplitude': 2.5}),
]


def changes_of(run):
    return sorted(
        ((change.time_ns // 100_000, change.node, change.values) for change in recorded_changes(run)),
        key=lambda change: change[:2],
    )


def replay(bench, *arguments):
    answer = bench.python('-m', 'hdd_servo_ros.tools.replay', *arguments)
    return answer.returncode, answer.stdout + answer.stderr


def test_a_schedule_gives_the_same_bits_everywhere(bench):
    for name in ('simulate', 'rig'):
        bench.run(name, *DURATION, *SCHEDULE, '-p', f'run_dir:={name}', '-p', 'plot:=false')
    for process in bench.start_nodes('processes', *DURATION, *SCHEDULE).values():
        assert process.wait(250.0) == 0, process.output
    simulated = bench.directory / 'simulate'
    for run in ('rig', 'processes'):
        assert first_difference(simulated, bench.directory / run) is None
        assert changes_of(bench.directory / run) == CHANGES
    assert changes_of(simulated) == CHANGES
    bench.run('simulate', *DURATION, '-p', 'run_dir:=plain', '-p', 'plot:=false')
    # The reference is the first to show what happens at 0.05 s.
    difference = first_difference(simulated, bench.directory / 'plain')
    assert difference is not None
    assert difference.startswith('reference differs first at tick 500')


def test_a_change_at_every_tick(bench):
    """More changes than the middleware keeps for a reader that looks ten times a second."""
    ticks = 3000
    entries = [f'{tick * 1e-4:.4f} reference_generator phase {tick * 1e-3:.3f}' for tick in range(1, ticks)]
    file = bench.directory / 'schedule.yaml'
    file.write_text(yaml.safe_dump({'/**/deterministic_timer': {'ros__parameters': {'schedule': entries}}}))
    arguments = ('--params-file', str(file), '-p', f'duration:={ticks * 1e-4}', '-p', 'plot:=false')
    for name in ('simulate', 'rig'):
        bench.run(name, *arguments, '-p', f'run_dir:={name}')
        assert len(recorded_changes(bench.directory / name)) == len(entries)
    assert first_difference(bench.directory / 'simulate', bench.directory / 'rig') is None


@pytest.mark.parametrize('name', ['simulate', 'rig'])
@pytest.mark.parametrize(
    ('entry', 'said'),
    [
        ('0.05 vcm_plant friction.stiffnes 1', '/vcm_plant has no parameter friction.stiffnes'),
        ('0.05 nobody gain 1', 'unknown node'),
    ],
)
def test_a_wrong_entry_is_rejected_before_the_run(bench, name, entry, said):
    process = bench.start(name, *DURATION, '-p', f"schedule:=['{entry}']", '-p', 'run_dir:=run')
    assert process.wait() == 2
    (line,) = [line for line in process.output.splitlines() if entry in line]
    assert said in line
    assert not (bench.directory / 'run').exists()


def test_a_wrong_entry_ends_all_processes_before_the_run(bench):
    entry = '0.05 vcm_plant friction.stiffness -1.0'
    for process in bench.start_nodes('run', *DURATION, '-p', f"schedule:=['{entry}']").values():
        assert process.wait(250.0) == 1
        assert entry in process.output
        assert 'above 0' in process.output
    assert not (bench.directory / 'run').exists()


def test_a_live_tuning_session_is_replayed(bench):
    names = ('-r', '__ns:=/bench7', '-r', 'head:=truth')
    process = bench.start(
        'rig', '-p', 'duration:=30.0', '-p', 'rate:=0.05', '-p', 'run_dir:=run', *names, '-p', 'controller:=pid'
    )
    for name, value in (('proportional_gain', '0.002'), ('integral_gain', '0.5'), ('proportional_gain', '0.003')):
        answer = bench.python(str(HERE / 'set_parameter.py'), '/bench7/pid_controller', name, value)
        assert answer.returncode == 0, answer.stderr
    time.sleep(0.3)
    process.signal(signal.SIGINT)
    assert process.wait() == 130
    run = bench.directory / 'run'
    changes = [change.values for change in recorded_changes(run)]
    assert changes == [{'proportional_gain': 0.002}, {'integral_gain': 0.5}, {'proportional_gain': 0.003}]
    code, text = replay(bench, 'run', '--output', 'again')
    assert code == 0, text
    last_tick = bench.run_yaml('run')['last_tick']
    assert f'bit-identical on every topic, ticks 0 to {last_tick}' in text
    assert '/bench7/truth' in Run.open(bench.directory / 'again').messages_by_topic()
    code, text = replay(bench, 'run', '--without-ros')
    assert code == 0, text
    # It is the changes that make it the same run: without one of them, the control parts at its tick.
    said = bench.run_yaml('run')
    said['nodes']['/bench7/pid_controller']['parameters']['derivative_gain'] *= 1.5
    said['versions']['numpy'] = '0.1'
    (run / 'run.yaml').write_text(yaml.safe_dump(said))
    code, text = replay(bench, 'run', '--without-ros')
    assert code == 1, text
    assert 'different: control differs first at tick' in text
    assert 'numpy: recorded with 0.1, now' in text


def test_what_cannot_be_replayed(bench):
    code, text = replay(bench, 'nothing')
    assert (code, text) == (3, 'replay: nothing is not a run folder: it has no run.yaml\n')
    bench.run('simulate', *DURATION, '-p', 'run_dir:=run', '-p', 'plot:=false')
    said = bench.run_yaml('run')
    path = bench.directory / 'run' / 'run.yaml'
    path.write_text(yaml.safe_dump({**said, 'status': 'running'}))
    code, text = replay(bench, 'run')
    assert code == 3
    assert 'recover run' in text
    del said['nodes']['/adaptive_nn_controller']
    path.write_text(yaml.safe_dump(said))
    code, text = replay(bench, 'run')
    assert code == 3
    assert '/control, /estimates came from a node that run.yaml does not list' in text
    for content, words in (
        ('', 'does not describe a run'),
        ('{ : [', 'cannot be read'),
        (yaml.safe_dump({**said, 'last_tick': 'many'}), "last_tick is 'many'"),
        (yaml.safe_dump({'status': 'finished'}), "run.yaml has no entry 'topics'"),
    ):
        path.write_text(content)
        code, text = replay(bench, 'run', '--without-ros')
        assert code == 3
        assert words in text
        assert 'Traceback' not in text


def test_a_run_whose_description_or_bag_was_tampered_with_is_rejected(bench):
    bench.run('simulate', *DURATION, '-p', 'run_dir:=run', '-p', 'plot:=false')
    said = bench.run_yaml('run')
    said['nodes']['/vcm_plant']['parameters']['gain'] = -1.0
    (bench.directory / 'run' / 'run.yaml').write_text(yaml.safe_dump(said))
    code, text = replay(bench, 'run', '--without-ros')
    assert code == 3
    assert 'gain: -1.0;' in text
    bag = bench.directory / 'run' / 'bag' / 'bag.mcap'
    bag.write_bytes(bag.read_bytes()[:5000])
    code, text = replay(bench, 'run', '--without-ros')
    assert code == 3
    assert 'does not end as an MCAP file does' in text
    assert 'Traceback' not in text


def test_a_replay_beside_a_run_that_goes_on(bench):
    bench.run('simulate', *DURATION, '-p', 'run_dir:=recorded', '-p', 'plot:=false')
    other = bench.start('rig', '-p', 'duration:=30.0', '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    deadline = time.monotonic() + 200.0
    while not (bench.directory / 'run' / 'run.yaml').exists():
        assert time.monotonic() < deadline, other.output
        time.sleep(0.05)
    code, text = replay(bench, 'recorded')
    assert code == 0, text
    assert 'bit-identical' in text
    other.signal(signal.SIGINT)
    assert other.wait() == 130, other.output
