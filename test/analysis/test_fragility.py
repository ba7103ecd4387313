"""The warnings of low stability margin, against the drive the controller is used on."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.frozen_estimates import AllowedEstimates, allowed_estimates
from hdd_servo_ros.analysis.linear_laws import FrozenEstimates
from hdd_servo_ros.analysis.metrics import tracking_metrics
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.experiment import Experiment

PARAMS = Path(__file__).parents[2] / 'params'
# So narrow that what the estimates do is no matter.
THESIS = read_parameter_files([PARAMS / 'thesis_law.yaml'])['adaptive_nn_controller']
NARROW = {
    'projection': True,
    'sigma.minimum': -1e-9,
    'sigma.maximum': 1e-9,
    'mass.minimum': -1e-12,
    'mass.maximum': 1e-12,
}


def controller_of(sample_time=1e-4, **values):
    return AdaptiveNn(from_mapping(AdaptiveNnParameters, {**THESIS, **values}), sample_time)


def loop_of(plant=None, sample_time=1e-4, delay=0, sensor=None):
    return LoopSurroundings(plant or PlantParameters(), sample_time, delay, sensor)


def test_the_default_has_its_margin_over_all_estimates():
    controller = AdaptiveNn(AdaptiveNnParameters(), 1e-4)
    assert fragility.peak_sensitivity(controller, PlantParameters()) == pytest.approx(1.98, abs=0.01)
    assert fragility.warnings(controller, loop_of()) == ()
    allowed = allowed_estimates(controller)
    assert not allowed.unbounded
    assert loop_of().frozen_loop(controller).worst(allowed)[0] <= 2.2


def test_with_desired_compensation_no_estimate_is_in_the_loop():
    """Neither in the linear loop nor, by test_desired_compensation, in the law."""
    controller = AdaptiveNn(AdaptiveNnParameters(), 1e-4)
    loop = loop_of().frozen_loop(controller)
    peaks = [loop.peak_sensitivity(FrozenEstimates(*point)) for point in ((0.0, 0.0), (4e-5, -1e-7), (-4e-5, 3e-7))]
    assert peaks[0] == peaks[1] == peaks[2]


def test_the_gains_of_the_bare_law_are_sound_with_the_estimates_they_start_from():
    assert fragility.peak_sensitivity(controller_of(), PlantParameters()) == pytest.approx(2.0, abs=0.01)
    assert fragility.warnings(controller_of(**NARROW), loop_of()) == ()


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
        (controller_of(velocity_source='difference'), PlantParameters(), 1, 'above 2'),
    ],
)
def test_fragile_constants_are_told_of(controller, plant, delay, said):
    (warning,) = fragility.warnings(controller, loop_of(plant, controller.sample_time, delay))
    assert warning.startswith('low stability margin: k + 1/sigma_phi')
    assert said in warning


def test_the_lag_of_the_vibrometer_counts():
    late = LdvParameters(demodulator_delay=2e-4)
    assert fragility.warnings(controller_of(**NARROW), loop_of(sensor=LdvParameters())) == ()
    assert fragility.warnings(controller_of(**NARROW), loop_of(sensor=late))[0].startswith('low stability margin: k')


@pytest.mark.parametrize('driver', ['rigid', 'current', 'voltage'])
def test_a_gain_that_the_driver_does_not_read_is_no_reason_to_warn(driver):
    plant = from_mapping(PlantParameters, {'actuator.driver': driver, 'gain': 6.0e7})
    assert fragility.warnings(controller_of(**NARROW), loop_of(plant)) == ()


def test_what_safe_gain_says_does_not_count_where_the_drive_is_known():
    controller = controller_of(safe_gain=1e-6, **NARROW)
    assert controller.warnings()
    assert fragility.warnings(controller, loop_of()) == ()


def test_a_loop_called_unstable_is():
    values = {'adaptive_nn_controller': {**THESIS, 'phi.leakage': 5e3, 'phi.gain': 1e-3}}
    experiment = Experiment(1e-4, 'adaptive_nn', values)
    assert isinstance(experiment.controller, AdaptiveNn)
    assert math.isinf(fragility.peak_sensitivity(experiment.controller, experiment.plant.parameters))
    rows = experiment.run(0, 30_001)
    metrics = tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], 2.0)
    assert not metrics.rms_error < 0.1


def test_initial_estimates_count():
    values = {**NARROW, 'mass.maximum': 1e-7, 'mass.initial': 5e-8}
    (warning, other) = fragility.warnings(controller_of(**values), loop_of())
    assert warning.startswith('low stability margin: k + 1/sigma_phi')
    assert 'm_hat = 5e-08 V s^2/um has a peak sensitivity of' in warning
    assert other.startswith('low stability margin: projection allows')


def test_without_projection_the_set_is_said_to_be_unbounded_and_where_it_is_safe():
    """The bare law, which has 142 nm rms at 50 Hz, where m_hat leaves the range that is named."""
    experiment = Experiment(1e-4, 'adaptive_nn', {'adaptive_nn_controller': THESIS})
    (warning,) = experiment.warnings()
    assert warning.startswith('no bounds for sigma_hat and m_hat (projection is false)')
    ends = re.search(r'm_hat from (\S+) to (\S+) V s\^2/um', warning)
    assert ends is not None
    low, high = map(float, ends.groups())
    assert isinstance(experiment.controller, AdaptiveNn)
    loop = loop_of().frozen_loop(experiment.controller)
    for m_hat, holds in ((low * 0.98, True), (low * 1.05, False), (high * 0.95, True), (high * 1.1, False)):
        assert (loop.peak_sensitivity(FrozenEstimates(0.0, m_hat)) <= 2.2) == holds
    with pytest.raises(ValueError, match='unbounded estimates: sigma_hat and m_hat'):
        loop.worst(allowed_estimates(experiment.controller))


@pytest.mark.parametrize('projection', [True, False])
def test_estimates_without_a_law_stay_where_they_are(projection):
    values = {'sigma.enabled': False, 'mass.gain': 0.0, 'mass.initial': 1e-9, 'projection': projection}
    allowed = allowed_estimates(controller_of(**values))
    assert allowed == AllowedEstimates((0.0, 0.0), (1e-9, 1e-9))
    assert not allowed.unbounded


def test_step_references_are_told_of():
    """Their bounds let m_hat take more of the damping than the loop has."""
    files = [PARAMS / f'{name}.yaml' for name in ('seagate_7200_10', 'thesis_law', 'step_references')]
    experiment = Experiment(1e-4, 'adaptive_nn', read_parameter_files(files))
    (warning,) = experiment.warnings()
    assert warning.startswith('low stability margin: projection allows sigma_hat = ')


@pytest.mark.parametrize(
    'values',
    [
        {'mass.minimum': -3e-8, 'mass.maximum': 2e-8},
        {'mass.minimum': 0.0, 'mass.maximum': 1e-8, 'sigma.minimum': -1e-5, 'sigma.maximum': 3e-5},
        {'mass.minimum': -1e-8, 'integral_gain': 2e5, 'error_filter_lambda': 1500.0},
        {'mass.minimum': -2.2e-7, 'mass.maximum': 0.0},
    ],
)
def test_the_worst_of_the_set_against_a_finer_search(values):
    controller = controller_of(projection=True, **values)
    loop, allowed = loop_of().frozen_loop(controller), allowed_estimates(controller)
    worst, where = loop.worst(allowed)
    assert loop.peak_sensitivity(where) == worst
    finer = max(
        loop.peak_sensitivity(FrozenEstimates(sigma_hat, m_hat))
        for sigma_hat in np.linspace(*allowed.sigma_hat, 12)
        for m_hat in np.linspace(*allowed.m_hat, 16)
    )
    assert worst == finer or 0.99 * finer < worst


@pytest.mark.parametrize(
    ('values', 'pid', 'said'),
    [
        ({}, {}, None),
        ({'actuator.driver': 'voltage', 'actuator.amplifier_gain': 0.4}, {}, 'is unstable'),
        ({'actuator.driver': 'current'}, {}, 'has a peak sensitivity of 2.17, above 2'),
        ({}, {'velocity_source': 'difference'}, 'has a peak sensitivity of 4.12, above 2'),
        ({}, {'proportional_gain': 0.0}, None),
    ],
)
def test_the_pid_controller(values, pid, said):
    found = fragility.warnings(
        Pid(from_mapping(PidParameters, pid), 1e-4), loop_of(from_mapping(PlantParameters, values))
    )
    assert len(found) == (said is not None)
    assert said is None or (found[0].startswith('low stability margin') and said in found[0])
