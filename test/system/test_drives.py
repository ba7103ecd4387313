"""Any drive by a parameter file, measured from the bag; bad ones rejected."""

from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.friction.parameters import MODELS
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping, to_mapping
from hdd_servo_ros.parameters.files import parse_ros_arguments, read_parameter_files
from hdd_servo_ros.simulation.run_setup import Simulation

PARAMS = Path(__file__).parents[2] / 'params'


def amplitude(time, signal, frequency):
    """Complex amplitude of a sine, beside the drift of a drive that nothing holds."""
    turns = 2.0 * np.pi * frequency * time
    columns = np.column_stack((np.sin(turns), np.cos(turns), np.ones_like(time), time))
    sine, cosine = np.linalg.lstsq(columns, signal, rcond=None)[0][:2]
    return sine + 1j * cosine


@pytest.mark.parametrize('sample_time', [1e-4, 2e-5])
def test_sixteen_modes_respond_as_their_analytic_response(bench, sample_time):
    file = PARAMS / 'sixteen_modes.yaml'
    frequency = 1910.0  # at the peak of a mode
    arguments = ['--params-file', str(file), '-p', 'controller:=open_loop', '-p', f'sample_time:={sample_time}']
    arguments += ['-p', 'amplitude:=0.01', '-p', f'frequency:={frequency}', '-p', 'duration:=0.4', '-p', 'run_dir:=run']
    bench.run('simulate', *arguments)
    signals = Run.open(bench.directory / 'run')
    late = signals.time > 0.3  # the mode's transient has gone down by exp(-54)
    time = signals.time[late]
    measured = amplitude(time, signals.head[late, 0], frequency) / amplitude(time, signals.control[late, 0], frequency)
    known = to_mapping(PlantParameters())
    given = {
        name: value
        for node in read_parameter_files([PARAMS / 'seagate_7200_10.yaml', file]).items()
        if node[0] == 'vcm_plant'
        for name, value in node[1].items()
        if name in known
    }
    drive = from_mapping(PlantParameters, given)
    analytic = transfer.sampled_frequency_response(drive, sample_time, [frequency])[0]
    assert abs(measured / analytic - 1.0) < 1e-4


@pytest.mark.parametrize('model', MODELS)
def test_every_friction_model_runs_in_the_loop_by_a_parameter(model):
    # 0.3 V breaks the default drive loose whatever the model.
    arguments = ['--ros-args', '--params-file', str(PARAMS / 'seagate_7200_10.yaml'), '-p', 'controller:=open_loop']
    arguments += ['-p', 'amplitude:=0.3', '-p', 'frequency:=50.0', '-p', f'vcm_plant:friction.model:={model}']
    if model == 'rbf_network':
        for name, value in (('positions', 0.0), ('velocities', 1000.0), ('weights', 0.1)):
            arguments += ['-p', f'vcm_plant:friction.node_{name}:=[{value}]']
    simulation = Simulation(parse_ros_arguments(arguments))
    rows = simulation.experiment.run(0, 500)
    assert np.isfinite(rows.head).all()
    assert np.abs(rows.head[:, 0]).max() > 0.1
    assert (model == 'none') == bool((rows.head[:, 2] == 0.0).all())


@pytest.mark.parametrize(
    ('value', 'named', 'allowed'),
    [
        ('friction.stiffness:=-1.0', 'friction.stiffness', 'above 0'),
        ('friction.static_level:=0.01', 'friction.static_level', 'at least'),
        ('friction.stribeck_velocity:=0.0', 'friction.stribeck_velocity', 'above 0'),
        (
            'resonance.denominators:=[1.0, -3.0, 1e9, 1.0, 1.0, 1e9, 1.0, 1.0, 2e9, 1.0, 1.0, 8e9]',
            'resonance.denominators',
            'a2, a1, a0 above 0 (stable)',
        ),
        ('resonance.denominators:=[1.0, 3.0]', 'resonance.denominators', 'a list of 12 numbers'),
        ('resonance.form:=parallel', 'resonance.frequencies', 'form none has no resonance'),
        ('friction.model:=rbf_network', 'friction.node_weights', 'model none has no friction'),
        ('gain:=.nan', 'gain', 'finite'),
        ('substeps:=-1', 'substeps', 'at least 0'),
    ],
)
@pytest.mark.parametrize('executable', ['vcm_plant', 'simulate'])
def test_a_bad_drive_is_rejected_at_start(bench, executable, value, named, allowed):
    process = bench.start(executable, '-p', f'vcm_plant:{value}')
    assert process.wait() == 2
    assert f'{named}: ' in process.output
    assert 'invalid value for parameter' in process.output
    assert allowed in process.output
    assert len(process.output.strip().splitlines()) == 1
