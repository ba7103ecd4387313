"""
Measure the cost of recording: `simulate` into a bag and the writer process of the rig, against the `rosbags` writer.

``python -m benchmarks.bench_bags [--quick]`` prints the processor time and the wall time per tick of every round [us].
Real-time factors refer to 10 kHz, where one tick is 0.1 ms.
"""

import argparse
import resource
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.bare_writer import BareWriter
from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME
from hdd_servo_ros.messages.topics import QUEUE_DEPTH
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.writer_process import WriterProcess
from hdd_servo_ros.simulation.interrupts import interrupts
from hdd_servo_ros.simulation.packing import Packer
from hdd_servo_ros.simulation.run_setup import Simulation
from hdd_servo_ros.simulation.simulate import SimulatedRun

ROOT = Path(__file__).parent.parent
PARAMS = ROOT / 'params' / 'seagate_7200_10.yaml'
TICK_US = 100.0
REPEATS = 10
ZSTD = ('-p', 'compression:=zstd')


class Recording:
    """
    Benchmarks of recording; each method returns processor time and wall time per tick [us].

    Parameters
    ----------
    directory
        Directory for the bags; each bag is removed after its measurement.
    ticks
        Length of the runs of `simulate`; the other benchmarks use a tenth of it.
    """

    def __init__(self, directory, ticks):
        self.directory = Path(directory)
        self.ticks = ticks
        self.sizes = {}
        simulation = self._simulation()
        self.topics = [(name, topic.type_name, QUEUE_DEPTH) for topic, name in simulation.topics]
        names = simulation.experiment.controller.estimate_names
        packer = Packer([topic for topic, _ in simulation.topics], 1e-4, simulation.frame_id, names)
        self.messages = messages_of(packer.pack(simulation.experiment.run(0, ticks // 10), {}))

    def _simulation(self, *arguments):
        given = ['--params-file', str(PARAMS), '-p', f'duration:={self.ticks * 1e-4}', *arguments]
        return Simulation(parse_ros_arguments(['--ros-args', *given]))

    def loop(self):
        """Run `simulate` without recording."""
        return self._run(self._simulation('-p', 'deterministic_timer:record:=false'))

    def simulate(self, *arguments):
        """Run `simulate` into a bag, from its first tick to the closed bag."""
        run = self.directory / 'run'
        values = self._run(self._simulation('-p', f'run_dir:={run}', *arguments))
        self.sizes[arguments] = sum(file.stat().st_size for file in (run / 'bag').glob('*.mcap'))
        shutil.rmtree(run)
        return values

    def _run(self, simulation):
        run = SimulatedRun(simulation)
        with interrupts() as requests, Clock(self.ticks) as clock:
            outcome = run.run(requests, None)
            if run.recorder is not None:
                run.recorder.close_bag()
        run.finish(outcome)
        assert outcome == FINISHED_OUTCOME
        return clock.values

    def rosbags(self):
        """Write the same messages with the `rosbags` writer, one by one."""
        times, payloads = self.messages
        kinds = range(len(self.topics))
        writer = BareWriter(self.directory / 'bare', self.topics)
        with Clock(len(times)) as clock:
            for stamp, messages in zip(times, payloads, strict=True):
                writer.write(kinds, (stamp,) * len(kinds), messages)
            writer.close()
        shutil.rmtree(self.directory / 'bare')
        return clock.values

    def writing_process(self):
        """Write them with the writer process of the rig, without its startup, which is a bag without a tick."""
        used = []
        # Repeats the messages, so that writing takes longer than the startup.
        for rounds in (0, REPEATS):
            before = children_time()
            started = time.perf_counter()
            writer = WriterProcess(self.directory / 'piped', 'mcap', self.topics, {})
            kinds = tuple(range(len(self.topics)))
            for _ in range(rounds):
                for stamp, messages in zip(*self.messages, strict=True):
                    writer.write(kinds, (stamp,) * len(kinds), messages)
            writer.close()
            used.append((children_time() - before, time.perf_counter() - started))
            shutil.rmtree(self.directory / 'piped')
        ticks = REPEATS * len(self.messages[0])
        return tuple(1e6 * (total - startup) / ticks for startup, total in zip(*used, strict=True))


class Clock:
    """Processor time and wall time of a block, per tick [us]."""

    def __init__(self, ticks):
        self.ticks = ticks

    def __enter__(self):
        self.started = time.process_time(), time.perf_counter()
        return self

    def __exit__(self, *_):
        ended = time.process_time(), time.perf_counter()
        self.values = tuple(1e6 * (end - start) / self.ticks for start, end in zip(self.started, ended, strict=True))


def messages_of(ticks):
    """Return the times [ns] and the messages of each tick."""
    count = len(ticks.times)
    payloads = [np.tile(np.frombuffer(template, np.uint8), (count, 1)) for template in ticks.templates]
    ticks.fill(slice(0, count), payloads)
    columns = [[row.tobytes() for row in rows] for rows in payloads]
    return ticks.times.tolist(), list(zip(*columns, strict=True))


def children_time():
    """Return the processor time of the child processes that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def bag_values(directory, repeats, ticks):
    """
    Run all benchmarks alternately, several times.

    Returns
    -------
    dict
        Best processor and wall time per tick [us] by benchmark; under ``bytes`` the bag size per tick [bytes] without
        and with compression.
    """
    recording = Recording(directory, ticks)
    measures = {
        'loop': recording.loop,
        'simulate': recording.simulate,
        'simulate, zstd': lambda: recording.simulate(*ZSTD),
        'rosbags': recording.rosbags,
        'writing process': recording.writing_process,
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in measures}
    for _ in range(repeats):
        for name, measure in measures.items():
            found[name].append(measure())
            processor, wall = found[name][-1]
            print(f'  {name:16} {processor:.3f} us processor time per tick, {wall:.3f} us wall time', flush=True)
    best = {name: tuple(min(column) for column in zip(*values, strict=True)) for name, values in found.items()}
    best['bytes'] = tuple(size / ticks for size in (recording.sizes[()], recording.sizes[ZSTD]))
    return best


def bag_rows(values):
    """Return table rows: real-time factors by processor time, and comparisons."""
    loop, simulate, rosbags, process = (values[name][0] for name in ('loop', 'simulate', 'rosbags', 'writing process'))
    plain, packed = values['bytes']
    return [
        (
            '`simulate` into an MCAP bag, all topics, one core',
            f'{TICK_US / simulate:.0f}',
            'at least 40, goal 80',
            f'{rosbags / simulate:.1f} times the `rosbags` writer; without recording {TICK_US / loop:.0f}',
        ),
        (
            '`simulate` into an MCAP bag with `compression: zstd`',
            f'{TICK_US / values["simulate, zstd"][0]:.0f}',
            '',
            f'{plain / packed:.2f} times smaller: {packed:.0f} instead of {plain:.0f} bytes per tick',
        ),
        ('`rosbags` writer with the same messages', f'{TICK_US / rosbags:.2f}', '', 'baseline'),
        (
            'writer process of the rig',
            f'{TICK_US / process:.0f}',
            '',
            f'{process / rosbags:.0%} of the processor time of the `rosbags` writer',
        ),
    ]


def main():
    """Print the values of every round, and the best."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.bench_bags', description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run one short round, as a smoke test')
    options = parser.parse_args()
    repeats, ticks = (1, 20_000) if options.quick else (5, 200_000)
    with tempfile.TemporaryDirectory() as directory:
        for row in bag_rows(bag_values(directory, repeats, ticks)):
            print(' | '.join(row))


if __name__ == '__main__':
    main()
