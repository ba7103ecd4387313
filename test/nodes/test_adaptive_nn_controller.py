"""Diagnoses of the estimates and the certificate by the adaptive NN controller node."""

import math
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.bench.dsp import ControllerOutputParameters, Dsp, DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.nodes.adaptive_nn_controller import AdaptiveNnController
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.ros.diagnosis import OK, WARN
from hdd_servo_ros.signals.reference import ReferenceParameters
from hdd_servo_ros.stability.margin import CertificateMargin

THESIS = read_parameter_files([Path(__file__).parents[2] / 'params' / 'thesis_law.yaml'])['adaptive_nn_controller']


@pytest.mark.parametrize(
    ('values', 'level', 'message'),
    [
        ({}, OK, 'finite'),
        ({'phi.maximum': 1e-9}, WARN, 'at its bound: phi_hat'),
        ({'phi.maximum': 1e-9, 'projection': False}, OK, 'finite'),
        ({'phi.enabled': False}, OK, 'finite'),
        ({'bristle.spring.minimum': 0.0217}, WARN, 'at its bound: spring_hat'),
        ({'bristle.spring.minimum': 0.0217, 'bristle.enabled': False}, OK, 'finite'),
    ],
)
def test_an_estimate_at_its_bound_is_reported_if_it_is_enabled(values, level, message):
    parameters = from_mapping(AdaptiveNnParameters, {'projection': True, **values})
    controller = AdaptiveNn(parameters, 1e-4)
    for tick in range(2):
        controller.step(SensorScales(8.0, 5000.0).inputs(tick, 0.0, 0.0, 1.0, 0.0, 0.0))
    node = SimpleNamespace(parameters={AdaptiveNnParameters: parameters}, _controller=controller)
    found = AdaptiveNnController._diagnose_adaptation(node)  # type: ignore[arg-type]
    assert (found.level, message in found.message) == (level, True)


IDEAL_SENSOR = LdvParameters(noise=False, adc_bits=0)
SINE = ReferenceParameters()
RIGID = PlantParameters(resonance=ResonanceParameters(form='none'))


@pytest.mark.parametrize(
    ('sigma_hat', 'm_hat', 'delay', 'level', 'message'),
    [
        (0.0, 0.0, 0, OK, 'peak sensitivity 1.99'),
        # What the bare law comes to at 50 Hz.
        (2.28e-5, -1.235e-7, 0, WARN, 'peak sensitivity 8'),
        (2.28e-5, -1.4e-7, 0, WARN, 'unstable'),
        (0.0, 1.5e-8, 0, OK, 'peak sensitivity'),
        (0.0, -2.5e-8, 1, OK, 'peak sensitivity'),
        (-3e-5, 0.0, 0, WARN, 'peak sensitivity'),
        (math.nan, 0.0, 0, WARN, 'unstable'),
    ],
)
def test_the_margin_with_the_present_estimates(sigma_hat, m_hat, delay, level, message):
    controller = AdaptiveNn(from_mapping(AdaptiveNnParameters, THESIS), 1e-4)
    for name, value in (('sigma_hat', sigma_hat), ('m_hat', m_hat)):
        controller.estimates[controller.estimate_names.index(name)] = value
    dsp = Dsp(DspParameters(computation_delay=delay), 1e-4)
    node = SimpleNamespace(_controller=controller, _loop=LoopSurroundings(PlantParameters(), 1e-4), _dsp=dsp)
    found = AdaptiveNnController._diagnose_margin(node)  # type: ignore[arg-type]
    assert (found.level, message in found.message) == (level, True), found
    assert found.values['m_hat'] == pytest.approx(m_hat)


def test_no_margin_without_a_drive():
    node = SimpleNamespace(_loop=None)
    found = AdaptiveNnController._diagnose_margin(node)  # type: ignore[arg-type]
    assert (found.level, 'no vcm_plant' in found.message) == (OK, True)


@pytest.mark.parametrize(
    ('controller', 'plant', 'dsp', 'sensor', 'reference', 'limited', 'is_disturbed', 'named'),
    [
        ({}, RIGID, {}, IDEAL_SENSOR, SINE, 0, False, 'sampling'),
        ({}, RIGID, {'dac_range': 10.0}, IDEAL_SENSOR, SINE, 0, False, 'sampling'),
        ({}, PlantParameters(), {}, LdvParameters(), SINE, 0, False, 'sampling, resonances, measurement'),
        ({}, RIGID, {}, IDEAL_SENSOR, SINE, 3, False, 'sampling, saturation'),
        ({}, RIGID, {}, IDEAL_SENSOR, SINE, 0, True, 'sampling, /disturbance'),
        ({}, RIGID, {'computation_delay': 1}, IDEAL_SENSOR, SINE, 0, False, 'sampling, dsp.computation_delay'),
        (
            {},
            RIGID,
            {'dac_bits': 16, 'dac_range': 10.0, 'computation_delay': 1},
            IDEAL_SENSOR,
            SINE,
            0,
            False,
            'sampling, dsp.dac_bits, dsp.computation_delay',
        ),
        (
            {'boundary_layer': 1.0, 'r_limit': 500.0, 'compensator.enabled': True},
            RIGID,
            {},
            IDEAL_SENSOR,
            ReferenceParameters(waveform='square'),
            0,
            False,
            'sampling, boundary_layer, r_limit, reference steps, compensator.lag',
        ),
        ({'velocity_source': 'difference'}, RIGID, {}, IDEAL_SENSOR, SINE, 0, False, 'sampling, measurement'),
        ({}, RIGID, {}, None, None, 0, False, 'sampling, measurement, reference steps'),
        ({'projection': True}, RIGID, {}, IDEAL_SENSOR, SINE, 0, False, 'sampling, projection'),
    ],
)
@pytest.mark.parametrize(('r', 'level', 'where'), [(10.0, OK, 'inside'), (1e12, WARN, 'outside')])
def test_the_certificate_names_what_it_does_not_cover(
    controller, plant, dsp, sensor, reference, limited, is_disturbed, named, r, level, where, margin
):
    parameters = from_mapping(AdaptiveNnParameters, {**THESIS, **controller})
    node = SimpleNamespace(
        tick=1,
        changes=(),
        parameters={ControllerOutputParameters: ControllerOutputParameters(dsp=DspParameters(**dsp))},
        _at_start=parameters,
        _drive=plant,
        _sensor=sensor,
        _reference=reference,
        _margin=SimpleNamespace(at=margin.at, ideal_values_are_allowed='projection' not in controller),
        _is_disturbed=is_disturbed,
        _ticks=SimpleNamespace(sample_time=1e-4),
        _controller=SimpleNamespace(estimates=np.full(len(AdaptiveNn.estimate_names), r)),
        _dsp=SimpleNamespace(saturated_samples=limited),
    )
    found = AdaptiveNnController._diagnose_certificate(node)  # type: ignore[arg-type]
    message = f'{where} the bound of theorem 4.1, which does not cover {named}'
    assert (found.level, found.message) == (level, message)


def test_projection_that_excludes_the_ideal_values_is_found():
    allowed = {}
    for values in ({}, {'projection': True}, {'projection': True, 'phi.maximum': 1e-3}):
        found = CertificateMargin(from_mapping(AdaptiveNnParameters, {**THESIS, **values}), PlantParameters(), 1000.0)
        wait_for(found)
        allowed[tuple(values)] = found.ideal_values_are_allowed
    assert list(allowed.values()) == [True, True, False]


def wait_for(margin):
    wait_until = time.monotonic() + 200.0
    while margin.at(0.0, 0.0) is None:
        assert time.monotonic() < wait_until
        assert not margin.unavailable_reason
        time.sleep(0.01)


@pytest.fixture(scope='module')
def margin():
    """Compute the constants of the theorem for the default controller and drive, in a separate thread."""
    found = CertificateMargin(from_mapping(AdaptiveNnParameters, THESIS), PlantParameters(), 1000.0)
    wait_for(found)
    return found
