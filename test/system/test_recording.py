"""The recorder of the graph stores a run as `simulate` does, whatever it is asked for."""

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

DURATION = ('-p', 'duration:=0.3', '-p', 'plot:=false')
OPTIONS = ('-p', 'compression:=zstd', '-p', 'max_bag_duration:=0.1', '-p', 'topics:=[clock, head, control]')


def test_compressed_split_and_chosen(bench):
    for name in ('rig', 'simulate'):
        bench.run(name, *DURATION, *OPTIONS, '-p', f'run_dir:={name}')
    bench.run('simulate', *DURATION, '-p', 'run_dir:=plain')
    ours, theirs, plain = (bench.directory / name for name in ('rig', 'simulate', 'plain'))
    assert first_difference(ours, theirs) is None
    assert sorted(Run.open(ours).counts) == ['clock', 'control', 'head']
    assert Run.open(ours).head.tobytes() == Run.open(plain).head.tobytes()
    names = [sorted(file.name for file in (run / 'bag').iterdir()) for run in (ours, theirs)]
    assert names[0] == names[1] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap', 'metadata.yaml']


def test_a_run_without_any_chosen_topic_says_so(bench):
    process = bench.start('rig', *DURATION, '-p', 'run_dir:=run', '-p', 'topics:=[disturbance]')
    assert process.wait() != 0
    assert (
        "invalid value for parameter bag_recorder:topics: ('disturbance',); expected names of topics of this run: "
        in process.output
    )
    assert not (bench.directory / 'run').exists()
