"""Crash stops in whole runs: the same bits and the same warning in `rig` and `simulate`, and the drive's diagnosis."""

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

TICKS = 300
PARAMETERS = (
    *('-p', f'deterministic_timer:duration:={TICKS / 10_000}', '-p', 'controller:=pid'),
    *('-p', 'reference_generator:waveform:=step', '-p', 'reference_generator:amplitude:=8.0'),
    *('-p', 'vcm_plant:travel.lower:=-5.0', '-p', 'vcm_plant:travel.upper:=5.0'),
)
WARNING = 'the actuator hits the upper crash stop at 5 um by tick '


def test_the_same_bits_and_one_warning(bench):
    outputs = {name: bench.run(name, *PARAMETERS, '-p', f'run_dir:={name}').output for name in ('rig', 'simulate')}
    assert first_difference(bench.directory / 'rig', bench.directory / 'simulate') is None
    for output in outputs.values():
        assert output.count(WARNING) == 1
    ticks = {output.partition(WARNING)[2].partition(';')[0] for output in outputs.values()}
    assert len(ticks) == 1
    run = Run.open(bench.directory / 'rig')
    (tick,) = map(int, ticks)
    # The body turns round there, and the head with it, up to what the resonances swing.
    assert run.head.velocity[:tick].max() > 0.0 > run.head.velocity[tick]
    assert run.position.max() < 6.0
    ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(bench.directory / 'rig'))
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_no_warning_without_stops(bench):
    found = bench.run('simulate', *PARAMETERS[:8], '-p', 'run_dir:=run')
    assert 'crash stop' not in found.output
    assert Run.open(bench.directory / 'run').position.max() > 7.0


def test_the_limits_are_fixed_during_a_run(bench):
    schedule = "['0.01 vcm_plant travel.upper 9.0']"
    process = bench.start('simulate', *PARAMETERS, '-p', f'deterministic_timer:schedule:={schedule}')
    assert process.wait() == 2
    assert 'travel.upper' in process.output
