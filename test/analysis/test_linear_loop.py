"""The linear loop against impulse responses of the loop of blocks that a run has, for all its variants."""

import math
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.analysis.linear_laws import FrozenEstimates, frozen_law, pid_law
from hdd_servo_ros.analysis.sampled_drive import SPRING_MODELS
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.bench.ldv import Ldv, LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.drive.friction.parameters import MODELS
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
TICKS = 3000
DRIVERS: dict[str, dict[str, Any]] = {
    'reduced': {},
    'rigid': {'actuator.driver': 'rigid', 'actuator.inertia': 6e-6, 'gain': 1e7},
    'current': {'actuator.driver': 'current', 'actuator.source_resistance': 60.0},
    'voltage': {'actuator.driver': 'voltage', 'actuator.amplifier_gain': 0.4},
}
SENSORS: dict[str, dict[str, Any]] = {
    'ideal': {},
    'delay': {'demodulator_delay': 4e-5},
    'long delay and low pass': {'demodulator_delay': 1.3e-4, 'demodulator_bandwidth': 30000.0},
}
SOURCES: dict[str, dict[str, Any]] = {
    'sensor': {},
    'difference': {'velocity_source': 'difference'},
    'bare difference': {'velocity_source': 'difference', 'velocity_bandwidth': 0.0},
}
NODES = {
    'friction.node_positions': [-2.0, 1.0],
    'friction.node_velocities': [-500.0, 800.0],
    'friction.node_weights': [-0.05, 0.04],
}
# The law without what multiplies sgn r, with estimates that do not adapt.
LINEAR = {
    **BARE_LAW,
    'error_filter_lambda': 595.0,
    'feedback_gain': 5e-5,
    'phi.enabled': False,
    'network.enabled': False,
    'sigma.gain': 0.0,
    'mass.gain': 0.0,
}


def linear(controller):
    """Return the drive's vibrometer without what is not linear."""
    return from_mapping(LdvParameters, {'noise': False, 'adc_bits': 0, 'output_range': 0.0, **controller})


def voltages(plant, sensor, controller, dsp, impulse, speed=0.0, scales=None):
    """Return u of the loop, with an impulse added to what the drive gets at tick 0, on a ramp of ``speed`` [um/s]."""
    drive, ldv = Plant(plant, T), Ldv(sensor, T)
    used = scales or SensorScales(sensor.displacement_scale, sensor.velocity_scale)
    found = []
    x, v, _ = drive.output()
    for k in range(TICKS):
        inputs = used.inputs(k, *ldv.step(k, x, v), speed * k * T, speed, 0.0)
        u = dsp.step(*controller.step(inputs))[0] + (impulse if k == 0 else 0.0)
        found.append(u)
        x, v, _ = drive.step(k + 1, u)
    return np.array(found)


def measured_peak(values, sensor, make, delay=0, presliding=True, scales=None):
    """Return max |S| of the blocks' loop, from the difference that a small impulse makes."""
    speed = 0.0 if presliding else 20000.0
    plant = from_mapping(PlantParameters, {**values, 'initial_velocity': speed, 'control_limit': 1e3})
    amplitude = 1e-6 if presliding else 1e-3
    runs = [
        voltages(plant, sensor, make(), Dsp(DspParameters(computation_delay=delay), T), impulse, speed, scales)
        for impulse in (amplitude, -amplitude)
    ]
    change = (runs[0] - runs[1]) / (2.0 * amplitude)
    assert np.abs(change[-100:]).max() < 1e-3
    return float(np.abs(np.fft.rfft(change, 2**18)).max())


def predicted_peak(values, sensor, law, presliding=True, scales=None):
    margins = LoopMargins(from_mapping(PlantParameters, values), T, sensor, scales)
    if len(margins.drives) > 1:
        kept = 0 if presliding else 1
        margins.drives, margins._bare = margins.drives[kept : kept + 1], margins._bare[kept : kept + 1]
        margins.responses = margins.responses[kept : kept + 1]
    return margins.peak_sensitivity(law)


def adaptive_nn(**values):
    return AdaptiveNn(from_mapping(AdaptiveNnParameters, {**LINEAR, **values}), T)


@pytest.mark.parametrize('source', SOURCES.values(), ids=SOURCES)
@pytest.mark.parametrize('sensor', SENSORS.values(), ids=SENSORS)
@pytest.mark.parametrize('driver', DRIVERS.values(), ids=DRIVERS)
def test_every_driver_sensor_and_velocity_source(driver, sensor, source):
    used, delay = linear(sensor), len(sensor) % 2
    law = frozen_law(adaptive_nn(**source), FrozenEstimates(0.0, 0.0), delay)
    predicted = predicted_peak(driver, used, law)
    assert predicted < 10.0
    assert measured_peak(driver, used, lambda: adaptive_nn(**source), delay) == pytest.approx(predicted, rel=3e-3)


@pytest.mark.parametrize('model', SPRING_MODELS)
@pytest.mark.parametrize('driver', ['reduced', 'voltage'])
def test_presliding_of_every_friction_that_is_a_spring(model, driver):
    values = {**DRIVERS[driver], 'friction.model': model, **(NODES if model == 'rbf_network' else {})}
    law = frozen_law(adaptive_nn(), FrozenEstimates(0.0, 0.0))
    predicted = predicted_peak(values, linear({}), law)
    assert measured_peak(values, linear({}), adaptive_nn) == pytest.approx(predicted, rel=3e-3)


def test_stiffness_counts():
    """A spring so stiff that the loop has another peak with each model than without it."""
    peaks = {}
    for model in ('dahl', 'lugre', 'tangential_stiffness', 'none'):
        values = {'friction.model': model, 'friction.stiffness': 4.0, 'friction.bristle_damping': 1e-6}
        law = frozen_law(adaptive_nn(), FrozenEstimates(0.0, 0.0))
        peaks[model] = LoopMargins(from_mapping(PlantParameters, values), T).peak_sensitivity(law)
        if model != 'none':
            measured = measured_peak(values, linear({}), adaptive_nn)
            assert measured == pytest.approx(peaks[model], rel=3e-3)
            assert measured > 1.2 * peaks.get('none', 1.0)


# Where the friction still falls or grows at the speed of the test, the loop differs by so much.
SLOPES = {'square_root': 0.01, 'complete': 0.01}


@pytest.mark.parametrize('model', MODELS)
def test_sliding_of_every_friction(model):
    values = {'friction.model': model, **(NODES if model == 'rbf_network' else {})}
    if model in ('drag', 'complete'):
        # Drag is judged where it is least.
        values['friction.drag_coefficient'] = 1e-13
    law = frozen_law(adaptive_nn(), FrozenEstimates(0.0, 0.0))
    predicted = predicted_peak(values, linear({}), law, presliding=False)
    measured = measured_peak(values, linear({}), adaptive_nn, presliding=False)
    assert measured == pytest.approx(predicted, rel=SLOPES.get(model, 3e-3))


@pytest.mark.parametrize('source', SOURCES.values(), ids=SOURCES)
@pytest.mark.parametrize('estimates', [(1e-5, -2e-8), (-2e-5, 1e-8), (0.0, -3e-8)])
@pytest.mark.parametrize('integral', [0.0, 4.6e5])
def test_frozen_estimates(estimates, integral, source):
    sigma_hat, m_hat = estimates
    values = {
        **source,
        'error_filter_lambda': 1500.0,
        'integral_gain': integral,
        'sigma.initial': sigma_hat,
        'mass.initial': m_hat,
    }
    law = frozen_law(adaptive_nn(**values), FrozenEstimates(sigma_hat, m_hat))
    predicted = predicted_peak({}, linear({}), law)
    assert measured_peak({}, linear({}), lambda: adaptive_nn(**values)) == pytest.approx(predicted, rel=3e-3)


@pytest.mark.parametrize('delay', [0, 1])
@pytest.mark.parametrize('source', ['sensor', 'difference'])
def test_pid(source, delay):
    gains = {'proportional_gain': 0.06, 'integral_gain': 30.0, 'derivative_gain': 6e-5, 'derivative_bandwidth': 2500.0}
    parameters = from_mapping(PidParameters, {**gains, 'velocity_source': source})
    predicted = predicted_peak({}, linear({}), pid_law(parameters, delay))
    assert measured_peak({}, linear({}), lambda: Pid(parameters, T), delay) == pytest.approx(predicted, rel=3e-3)


def test_a_sensor_read_with_another_scale():
    scales = SensorScales(10.0, 4000.0)
    law = frozen_law(adaptive_nn(), FrozenEstimates(0.0, 0.0))
    predicted = predicted_peak({}, linear({}), law, scales=scales)
    assert predicted != pytest.approx(predicted_peak({}, linear({}), law), rel=0.01)
    assert measured_peak({}, linear({}), adaptive_nn, scales=scales) == pytest.approx(predicted, rel=3e-3)


@pytest.mark.parametrize(
    ('frequency', 'residue', 'gain', 'least'),
    [
        (2310.0, 0.01, 5e-5, 1.3),
        (7400.0, -0.01, 5e-5, 1.3),
        (11234.0, -0.002, 5e-5, 1.6),
        (12310.0, -0.002, 9.96e-5, 50.0),
        (24999.0, -0.01, 5e-5, 1.5),
    ],
)
def test_a_narrow_mode_is_not_missed(frequency, residue, gain, least):
    """One lightly damped mode, seen at its folded frequency, against a brute-force grid of 10 uHz there."""
    values = {
        'resonance.form': 'parallel',
        'resonance.frequencies': [frequency],
        'resonance.damping_ratios': [1e-5],
        'resonance.residues': [residue],
    }
    margins = LoopMargins(from_mapping(PlantParameters, values), T)
    law = LinearController.on_r(gain, 595.0, 0.0)
    folded = abs((frequency + 5000.0) % 10000.0 - 5000.0)
    fine = folded + np.linspace(-3.0, 3.0, 600_001)
    fine = fine[fine < 5000.0]
    brute = max(
        float(np.abs(1.0 / (1.0 + (law.response(fine, T) * drive.response(fine)).sum(axis=1))).max())
        for drive in margins.drives
    )
    assert brute > least
    assert margins.peak_sensitivity(law) >= brute * (1.0 - 1e-4)


SHIPPED = from_mapping(PidParameters, {})


def test_a_coil_makes_the_pid_controller_unstable():
    """The shipped gains on a voltage driver with the same gain: stable only if amplifier and coil are left out."""
    parameters = from_mapping(PlantParameters, DRIVERS['voltage'])
    assert parameters.rigid_gain == pytest.approx(PlantParameters().gain, rel=1e-6)
    assert LoopMargins(PlantParameters(), T).peak_sensitivity(pid_law(SHIPPED)) == pytest.approx(2.0, abs=1e-3)
    assert LoopMargins(parameters, T).peak_sensitivity(pid_law(SHIPPED)) == math.inf
    found = voltages(parameters, linear({}), Pid(SHIPPED, T), Dsp(DspParameters(), T), 1e-6)
    assert np.abs(found[-100:]).max() > 1e3 * np.abs(found[:100]).max()


def test_the_default_current_driver_costs_the_pid_controller_margin():
    # Sliding without a bristle, of which the integration leaves a little damping at this speed.
    values = {'actuator.driver': 'current', 'friction.model': 'coulomb_viscous'}
    predicted = predicted_peak(values, linear({}), pid_law(SHIPPED), presliding=False)
    assert predicted == pytest.approx(2.168, abs=2e-3)
    measured = measured_peak(values, linear({}), lambda: Pid(SHIPPED, T), presliding=False)
    assert measured == pytest.approx(predicted, rel=3e-3)


def test_differences_cost_the_pid_controller_margin():
    parameters = from_mapping(PidParameters, {'velocity_source': 'difference'})
    predicted = predicted_peak({}, linear({}), pid_law(parameters))
    assert predicted > 4.0
    assert measured_peak({}, linear({}), lambda: Pid(parameters, T)) == pytest.approx(predicted, rel=3e-3)
