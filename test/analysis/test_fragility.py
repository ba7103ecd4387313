"""The warning of fragile constants, against the drive they are used on."""

import math

import pytest

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.analysis.metrics import tracking_metrics
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.simulation.experiment import Experiment


def controller_of(sample_time=1e-4, **values):
    return AdaptiveNn(from_mapping(AdaptiveNnParameters, values), sample_time)


def test_the_default_is_sound():
    assert fragility.peak_sensitivity(controller_of(), PlantParameters()) == pytest.approx(2.0, abs=0.01)
    assert fragility.warnings(controller_of(), PlantParameters()) == ()


@pytest.mark.parametrize(
    ('controller', 'plant', 'delay', 'said'),
    [
        (controller_of(1e-3), PlantParameters(), 0, 'at T = 0.001 s, is unstable'),
        (controller_of(**{'phi.leakage': 1e4}), PlantParameters(), 0, 'above 2'),
        (controller_of(**{'phi.leakage': 1e4}), PlantParameters(), 1, 'above 2'),
        (controller_of(**{'phi.leakage': 0.0}), PlantParameters(), 0, 'is unstable'),
        (controller_of(), from_mapping(PlantParameters, {'gain': 6.0e7}), 0, 'above 2'),
        (controller_of(safe_gain=1.0), from_mapping(PlantParameters, {'gain': 6.0e7}), 0, 'above 2'),
        (
            controller_of(),
            from_mapping(PlantParameters, {'actuator.driver': 'rigid', 'actuator.inertia': 3e-6}),
            0,
            'above 2',
        ),
    ],
)
def test_fragile_constants_are_told_of(controller, plant, delay, said):
    (warning,) = fragility.warnings(controller, plant, delay)
    assert warning.startswith('fragile constants')
    assert said in warning


@pytest.mark.parametrize('driver', ['rigid', 'current', 'voltage'])
def test_a_gain_that_the_driver_does_not_read_is_no_reason_to_warn(driver):
    plant = from_mapping(PlantParameters, {'actuator.driver': driver, 'gain': 6.0e7})
    assert fragility.warnings(controller_of(), plant) == ()


def test_what_safe_gain_says_does_not_count_where_the_drive_is_known():
    controller = controller_of(safe_gain=1e-6)
    assert controller.warnings()
    assert fragility.warnings(controller, PlantParameters()) == ()


def test_a_loop_called_unstable_is():
    values = {'adaptive_nn_controller': {'phi.leakage': 5e3, 'phi.gain': 1e-3}}
    experiment = Experiment(1e-4, 'adaptive_nn', values)
    assert isinstance(experiment.controller, AdaptiveNn)
    assert math.isinf(fragility.peak_sensitivity(experiment.controller, experiment.plant.parameters))
    rows = experiment.run(0, 30_001)
    metrics = tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], 2.0)
    assert not metrics.rms_error < 0.1
