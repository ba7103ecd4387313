"""Values that pass the check of one parameter, and with which a block cannot be made or stepped."""

import dataclasses
import math

import pytest

from hdd_servo_ros.analysis.parameter_trial import _STEPS, attempt_change, attempt_for, has_extremes, reject_failing
from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.graph.catalog import CONTROLLER, NODES
from hdd_servo_ros.parameters import ParameterError, from_mapping

T = 1e-4
RAISES = [
    ('reference_generator', 'start_time', 1.7e308),
    ('ldv_sensor', 'demodulator_bandwidth', 5e-324),
    ('disturbance_generator', 'vibration.rotational.low', 5e-324),
    ('adaptive_nn_controller', 'network.width', (1e-300,)),
    ('adaptive_nn_controller', 'sigma.scale', 1e-300),
    ('adaptive_nn_controller', 'compensator.width', 5e-324),
    ('adaptive_nn_controller', 'shaping.delay', 1.7e308),
    ('pid_controller', 'feedforward.supervisor.tolerance', 1e300),
    ('pid_controller', 'feedforward.model.gain', 1.797e308),
    ('pid_controller', 'observer.stiffness', 1.797e308),
]
"""An exception in the block; such a parameter is rejected in a file too."""
NOT_FINITE = [
    ('vcm_plant', 'gain', 1.797e308),
    ('vcm_plant', 'friction.bristle_damping', 1.797e308),
    ('reference_generator', 'amplitude', 1.797e308),
    ('reference_generator', 'frequency', 1e300),
    ('ldv_sensor', 'displacement_scale', 5e-324),
    ('servo_sensor', 'track_pitch', 5e-324),
    ('disturbance_generator', 'coupling.gain', 5e-324),
    ('pid_controller', 'proportional_gain', 1.797e308),
    ('pid_controller', 'feedforward.model.separation', 5e-324),
]
"""An output that is not finite; a run that begins with such a parameter ends at once and says where."""
ALSO: dict[str, dict[str, object]] = {
    'disturbance_generator': {'vibration.rotational.enabled': True, 'force_noise.enabled': True},
    'adaptive_nn_controller': {'compensator.enabled': True},
    'pid_controller': {'feedforward.method': 'fxlms'},
}
"""What makes a parameter act."""


def sets_of(node, **values):
    named = {**ALSO.get(node, {}), **values}
    found = {}
    for kind in NODES[node].parameter_sets:
        own = {field for field in named if field in names(kind)}
        found[kind] = from_mapping(kind, {name: named[name] for name in own})
    return found


def names(kind):
    from hdd_servo_ros.parameters import declarations

    return {declaration.name for declaration in declarations(kind)}


def block_of(name):
    """Return a run with accelerometers and the servo sensor, so that a controller has all that it may have."""
    present = {'vcm_plant', 'accelerometer', 'servo_sensor'}
    return NODES[name].block_parameters() if name in present else None


def reject(node, *, is_change, accepted=None, **values):
    sets = sets_of(node, **values)
    attempt = attempt_for(node, T, sets, block_of, is_change=is_change)
    assert attempt is not None
    reject_failing(node, sets, accepted or sets_of(node), attempt)


@pytest.mark.parametrize('is_change', [False, True])
@pytest.mark.parametrize(('node', 'name', 'value'), RAISES)
def test_a_block_that_cannot_be_made_is_rejected_by_name(node, name, value, is_change):
    with pytest.raises(ParameterError) as rejected:
        reject(node, is_change=is_change, **{name: value})
    assert rejected.value.name.endswith(name.rpartition('.')[2])
    assert repr(value) in str(rejected.value)


@pytest.mark.parametrize(('node', 'name', 'value'), NOT_FINITE)
def test_a_change_to_outputs_that_are_not_finite_is_rejected_by_name(node, name, value):
    with pytest.raises(ParameterError, match='not finite') as rejected:
        reject(node, is_change=True, **{name: value})
    assert rejected.value.name == name
    # A run that begins so ends by itself.
    reject(node, is_change=False, **{name: value})


@pytest.mark.parametrize('node', [row.name for row in NODES.values() if row.block])
def test_the_defaults_are_accepted(node):
    if node == 'signal_analyzer':
        sets = sets_of(node, stop_frequency=4000.0)
        attempt = attempt_for(node, T, sets, lambda _: None, is_change=True)
        assert attempt is not None
        reject_failing(node, sets, sets, attempt)
    else:
        reject(node, is_change=True)


def test_every_block_that_is_not_a_controller_has_a_step():
    assert {row.name for row in NODES.values() if row.block and row.role != CONTROLLER} == set(_STEPS)


def test_of_several_changes_the_one_to_blame_is_named():
    values = {'frequency': 120.0, 'start_time': 1.7e308, 'amplitude': 3.0}
    with pytest.raises(ParameterError, match=r'invalid value for parameter start_time: 1.7e\+308; '):
        reject('reference_generator', is_change=True, **values)


def test_an_own_error_of_the_block_stays_as_it_is():
    with pytest.raises(ParameterError, match=r'feedforward\.taps'):
        reject('pid_controller', is_change=False, **{'feedforward.taps': 400, 'feedforward.path_length': 400})


def test_a_copy_of_the_block_is_tried_and_the_block_stays():
    from hdd_servo_ros.disturbance.generator import DisturbanceGenerator

    sets = sets_of('disturbance_generator')
    generator = DisturbanceGenerator(sets[NODES['disturbance_generator'].block_parameters], T)
    twin = DisturbanceGenerator(sets[NODES['disturbance_generator'].block_parameters], T)
    changed = sets_of('disturbance_generator', **{'force_noise.sigma': 1.0})
    reject_failing(
        'disturbance_generator', changed, sets, attempt_change('disturbance_generator', generator, is_change=True)
    )
    assert [generator.step(tick) for tick in range(5)] == [twin.step(tick) for tick in range(5)]


def test_extremes_are_numbers_that_a_few_products_take_out_of_range():
    assert not has_extremes([AccelerometerParameters()])
    for value in (1e-31, 1e31, -1e300):
        assert has_extremes([AccelerometerParameters(parasitic_gain=value)]), value
    assert not has_extremes([dataclasses.replace(AccelerometerParameters(), parasitic_gain=0.0)])
    assert math.isfinite(AccelerometerParameters().noise)
