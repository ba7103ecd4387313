"""Recorded runs with a disturbance made by the test: vibration, runout and flutter of known size."""

import numpy as np
from scipy import signal

from hdd_servo_ros import Run
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.run_recorder import RunRecorder
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.simulation.packing import Packer
from hdd_servo_ros.simulation.run_setup import Simulation

SECTORS = 84
T = 99_206e-9
"""60/(7200 x 84) s, to the nanosecond."""
PID = {'proportional_gain': 0.626, 'integral_gain': 62.0, 'derivative_gain': 1.39e-4, 'derivative_bandwidth': 3160.0}


class Shaker:
    """Vibration of 12.5 rad/s^2 from 10 to 500 Hz, and a track center with runout and white flutter."""

    topics = (DISTURBANCE,)

    def __init__(self, ticks: int, vibration: float = 12.5, runout: float = 0.030, flutter: float = 0.004) -> None:
        rng = np.random.default_rng(5)
        self.disturbance = np.zeros((ticks, 3))
        band = signal.butter(8, [10.0, 500.0], 'bandpass', fs=1.0 / T, output='sos')
        force = signal.sosfilt(band, rng.normal(size=ticks + 20_000))[20_000:]
        self.disturbance[:, 0] = vibration * 50_800.0 / 4.0968e7 * force / np.std(force)
        self.disturbance[:, 1] = runout * np.sin(2.0 * np.pi * np.arange(ticks) / SECTORS)
        self.disturbance[:, 1] += flutter * rng.normal(size=ticks)

    def rows(self, first_tick, count):
        """Return the rows of consecutive ticks."""
        return (self.disturbance[first_tick : first_tick + count],)


def shaken_run(directory, duration_ticks, *, sectors=SECTORS, pitch=1.016, **sizes):
    """Record the default drive, a PID controller holding the head at 0 while a :class:`Shaker` disturbs it."""
    arguments = ['--ros-args', '-p', f'sample_time:={T!r}', '-p', f'duration:={duration_ticks * T!r}']
    arguments += ['-p', 'controller:=pid', '-p', 'waveform:=constant', '-p', 'amplitude:=0.0']
    arguments += ['-p', f'vcm_plant:track_pitch:={pitch!r}']
    for name, value in PID.items():
        arguments += ['-p', f'pid_controller:{name}:={value!r}']
    simulation = Simulation(parse_ros_arguments(arguments))
    nodes: dict[str, dict[str, object]] = {
        'reference_generator': {'waveform': 'constant', 'amplitude': 0.0},
        'pid_controller': {**PID},
    }
    experiment = Experiment(T, 'pid', nodes, disturbance=Shaker(duration_ticks + 1, **sizes))
    topics = [*simulation.topics, (DISTURBANCE, '/disturbance')]
    description = simulation.description()
    spindle = {'spindle.revolutions_per_minute': 7200.0, 'spindle.sectors': sectors}
    description['nodes']['/disturbance_generator'] = {'outputs': ['/disturbance'], 'offers': {}, 'parameters': spindle}
    recorder = RunRecorder(str(directory), 'mcap', topics, description, separate_process=False)
    packer = Packer([topic for topic, _ in topics], T, simulation.frame_id, experiment.controller.estimate_names)
    recorder.write_ticks(duration_ticks, packer.pack(experiment.run(0, duration_ticks + 1), {}))
    recorder.finish('finished', '')
    return Run.open(directory)
