"""The loop with a filtered or interpolated command, against impulse responses of the blocks."""

import numpy as np
import pytest

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.analysis.command_path import driven_by
from hdd_servo_ros.analysis.feedforward_path import feedforward_path
from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.linear_laws import pid_law
from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.bench.output_filters import FilterParameters, LowPassParameters, OutputFilters
from hdd_servo_ros.control.feedforward_parameters import FeedforwardParameters
from hdd_servo_ros.control.observer import Observer, ObserverParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.parameters import ParameterError, from_mapping
from hdd_servo_ros.studies.pid_search import computation_delay

T = 1e-4
TICKS = 3000
GAINS = PidParameters(proportional_gain=0.03, derivative_gain=4e-5)
WIDE = PlantParameters(control_limit=1e3)
PATHS = [
    DspParameters(updates_per_sample=2, interpolation='linear'),
    DspParameters(updates_per_sample=4, interpolation='linear'),
    DspParameters(updates_per_sample=4, interpolation='linear', computation_delay=1),
]
FILTERS = from_mapping(
    FilterParameters,
    {
        'notch.frequencies': (4800.0, 3500.0),
        'resonant.frequencies': (1500.0,),
        'resonant.gains': (0.3,),
        'resonant.phases': (40.0,),
        'lead.frequencies': (900.0,),
        'low_pass.frequencies': (4500.0,),
    },
)
PATHS += [
    DspParameters(filters=FILTERS),
    DspParameters(filters=FILTERS, updates_per_sample=2, computation_delay=1),
    DspParameters(filters=FILTERS, updates_per_sample=4, interpolation='linear'),
]
IDS = ['2', '4', '4 late', 'filters', 'filters 2 late', 'filters 4']


def impulse_response(path, observer, size=1e-6):
    """Return the head position after an impulse on the controller's voltage at tick 0, per volt."""
    found = {}
    for sign in (1.0, -1.0):
        drive, dsp = Plant(WIDE, T, is_multirate=True), Dsp(path, T)
        controller = Pid(GAINS, T)
        block = None if observer is None else Observer(observer, T)
        x, v, _ = drive.output()
        held, positions = 0.0, []
        for tick in range(TICKS):
            positions.append(x)
            if block is not None:
                _, v = block.step(x, held)
            u, unsaturated, feedback = controller.step(ControllerInputs(tick, x, v, 0.0, 0.0, 0.0, 0.0, 0.0))
            added = sign * size * (tick == 0)
            first, _, _ = dsp.step(u + added, unsaturated + added, feedback)
            held = dsp.mean_voltage(first)
            x, v, _ = drive.step(tick + 1, first, 0.0, dsp.later_voltages)
        found[sign] = np.array(positions)
    return (found[1.0] - found[-1.0]) / (2.0 * size)


@pytest.mark.parametrize('path', PATHS, ids=IDS)
@pytest.mark.parametrize('observer', [None, ObserverParameters()], ids=['velocity', 'observer'])
def test_the_linear_loop_is_that_of_the_blocks(path, observer):
    loop = LoopSurroundings(WIDE, T, path.computation_delay, observer=observer, dsp=path).margins
    law = pid_law(GAINS, path.computation_delay)
    response = impulse_response(path, observer)
    frequencies = np.geomspace(50.0, 0.499 / T, 200)
    z = np.exp(2j * np.pi * frequencies * T)
    measured = np.array([np.sum(response * point ** -np.arange(TICKS)) for point in z])
    expected = loop.path(law, 0, frequencies)
    assert np.abs(response[-1]) < 1e-5 * np.abs(response).max()
    np.testing.assert_allclose(measured, expected, rtol=1e-3)
    assert np.abs(np.linalg.eigvals(law.closed_loop(loop.drives[0]))).max() < 1.0


@pytest.mark.parametrize('path', PATHS[:2], ids=['2', '4'])
def test_interpolation_delays_the_command(path):
    """On average by (count - 1)/(2 count) samples."""
    frequency, count = 200.0, path.updates_per_sample
    held, stepped = (driven_by(WIDE, T, True, dsp).response([frequency])[0, 0] for dsp in (None, path))
    lag = -np.angle(stepped / held) / (2.0 * np.pi * frequency * T)
    assert lag == pytest.approx(0.5 * (count - 1) / count, rel=0.01)


def test_a_held_command_has_the_drive_of_one_update():
    for dsp in (None, DspParameters(updates_per_sample=4), DspParameters(interpolation='linear')):
        assert driven_by(WIDE, T, True, dsp) is sampled_drive(WIDE, T, True)


@pytest.mark.parametrize('path', PATHS, ids=IDS)
def test_the_path_of_a_feedforward_is_that_of_the_blocks(path):
    model = FeedforwardParameters().model
    plant = from_mapping(
        PlantParameters,
        {
            'gain': model.gain,
            'friction.model': 'tangential_stiffness',
            'friction.stiffness': model.stiffness,
            'friction.coulomb_level': 1e6,
            'friction.static_level': 1e6,
            'resonance.form': 'none',
            'control_limit': 1e3,
            'substeps': 400,
        },
    )
    undamped = type(model)(gain=model.gain, stiffness=model.stiffness, viscous_coefficient=0.0)
    found = feedforward_path(Pid(GAINS, T), path, undamped, T, 300)
    drive, dsp, controller = Plant(plant, T, is_multirate=True), Dsp(path, T), Pid(GAINS, T)
    x, v, _ = drive.output()
    expected = []
    for tick in range(300):
        expected.append(x / 1e-3)
        u, unsaturated, feedback = controller.step(ControllerInputs(tick, x, v, 0.0, 0.0, 0.0, 0.0, 0.0))
        pulse = 1e-3 * (tick == 0)
        first, _, _ = dsp.step(u + pulse, unsaturated + pulse, feedback)
        x, v, _ = drive.step(tick + 1, first, 0.0, dsp.later_voltages)
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(found).max())


def test_filters_multiply_the_response_of_the_drive():
    """With one update per sample, drive and filters have the same sample time."""
    frequencies = np.geomspace(10.0, 0.49 / T, 100)
    drive = sampled_drive(WIDE, T, True).response(frequencies)
    found = driven_by(WIDE, T, True, DspParameters(filters=FILTERS)).response(frequencies)
    expected = drive * OutputFilters(FILTERS, T).response(frequencies)[:, None]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_warnings_take_the_filters_into_account():
    filters = FilterParameters(low_pass=LowPassParameters(frequencies=(700.0,)))
    plain, filtered = (
        fragility.warnings(Pid(PidParameters(), T), LoopSurroundings(WIDE, T, dsp=dsp))
        for dsp in (DspParameters(), DspParameters(filters=filters))
    )
    assert plain == ()
    assert len(filtered) == 1
    assert filtered[0].startswith('low stability margin')


def test_tuning_rejects_interpolation_and_filters():
    values: dict[str, object] = {'dsp.updates_per_sample': 2, 'dsp.interpolation': 'linear'}
    with pytest.raises(ParameterError, match=r'pid_controller\.dsp\.interpolation.*hold, because tuning'):
        computation_delay({'pid_controller': values}, 'pid_controller')
    with pytest.raises(
        ParameterError, match=r'pid_controller\.dsp\.filters.*notch\.frequencies.*empty lists, because tuning'
    ):
        computation_delay({'pid_controller': {'dsp.filters.notch.frequencies': (3000.0,)}}, 'pid_controller')
    assert computation_delay({'pid_controller': {'dsp.updates_per_sample': 2}}, 'pid_controller') == 0
