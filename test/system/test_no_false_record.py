"""What a run records is what its nodes did: no event of a stranger, and no number that is none in a finished run."""

from pathlib import Path

import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / 'examples' / 'disturbance_node.py'
FORGED = ('/reference_generator', 'frequency', '500.0')
SLOW = ('-p', 'deterministic_timer:rate:=0.05', '-p', 'deterministic_timer:duration:=0.1')
SCHEDULE = "deterministic_timer:schedule:=['0.05 reference_generator frequency 150']"

CONTROLLER = """
import dataclasses
import math

from hdd_servo_ros.parameters import ParameterSet, parameter


@dataclasses.dataclass(frozen=True)
class Gains(ParameterSet):
    gain: float = parameter(0.1, 'voltage per position error', unit='V/um')


class Law:
    estimate_names = ('t', 'a', 'b')

    def __init__(self, parameters: Gains, sample_time: float) -> None:
        self.update(parameters)
        self.sample_time = sample_time
        self.estimates = [0.0, 0.0, 0.0]

    def update(self, parameters: Gains) -> None:
        self.parameters = parameters

    def step(self, inputs):
        self.estimates = [inputs.tick * self.sample_time, 1e308, 1e308]
        if inputs.tick == 77:
            self.estimates[2] = VALUE
        u = 0.1 * (inputs.desired_position - inputs.position)
        # Finite, though the sum of the three is not.
        return u, 1.2e308, 1.2e308
"""


@pytest.fixture
def stranger(bench):
    return bench.start_python('stranger', str(HERE / 'forged_event.py'), *FORGED)


def test_an_event_of_a_stranger_is_not_recorded(bench, stranger):
    planned = (*SLOW, '-p', SCHEDULE)
    process = bench.start('rig', *planned, '-p', 'run_dir:=run')
    assert process.wait() == 0, process.output
    changes = Run.open(bench.directory / 'run').parameter_changes
    assert [(change.tick, change.name, change.value) for change in changes] == [(500, 'frequency', 150.0)]
    simulated = bench.start('simulate', *planned, '-p', 'run_dir:=simulated')
    assert simulated.wait() == 0, simulated.output
    assert first_difference(bench.directory / 'simulated', bench.directory / 'run') is None


def test_between_processes_a_run_with_events_of_a_stranger_does_not_finish(bench, stranger):
    """There an event tells nobody who published it; that there are more than changes is seen."""
    processes = bench.start_nodes('run', *SLOW)
    assert {process.wait() for process in processes.values()} != {0}
    content = bench.run_yaml('run')
    assert content['status'] == 'failed'
    assert 'an external node publishes in its name' in content['reason']


@pytest.mark.parametrize(('value', 'written'), [('math.nan', 'nan'), ('math.inf', 'inf')])
def test_estimates_that_are_not_finite_end_a_run_in_the_same_way(bench, value, written):
    (bench.directory / 'law.py').write_text(CONTROLLER.replace('VALUE', value))
    said = []
    for name, run in (('rig', 'a'), ('simulate', 'b')):
        process = bench.start(name, '-p', 'duration:=0.02', '-p', 'controller:=law:Law', '-p', f'run_dir:={run}')
        assert process.wait() == 1, process.output
        content = bench.run_yaml(run)
        assert (content['status'], content['last_tick']) == ('failed', 76)
        said.append(content['reason'])
    assert said == [f'/estimates: not finite at tick 77: (b = {written}); published by law'] * 2
    assert first_difference(bench.directory / 'a', bench.directory / 'b') is None


@pytest.mark.parametrize('tick', [100, 1000])
def test_a_disturbance_that_is_not_finite_is_not_in_a_finished_run(bench, tick):
    """At the last tick too, which nothing in the loop reads."""
    source = EXAMPLE.read_text('utf8')
    unchecked = 'self.publish_bytes(0, self._codec.pack(stamp, force, 0.0, 0.0))'
    source = source.replace(
        'self.publish_vector(0, tick, self._codec.pack(stamp, force, 0.0, 0.0), force, 0.0, 0.0)',
        f"force = float('nan') if tick == {tick} else force\n        {unchecked}",
    )
    assert unchecked in source
    script = bench.directory / 'shaker.py'
    script.write_text(source)
    processes = [*bench.start_nodes('run', '-p', 'deterministic_timer:duration:=0.1').values()]
    processes.append(bench.start('disturbance', script=script))
    for process in processes:
        process.wait()
    content = bench.run_yaml('run')
    assert content['status'] == 'failed'
    assert f'not finite at tick {tick}' in content['reason'] or f'not finite at tick {tick + 1}' in content['reason']
