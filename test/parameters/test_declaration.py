import dataclasses
import math
import pickle

import numpy as np
import pytest

from hdd_servo_ros.graph.catalog import names_with_parameters
from hdd_servo_ros.graph.known_parameters import node_declarations, reject_unknown
from hdd_servo_ros.parameters import (
    ParameterError,
    ParameterSet,
    declarations,
    from_mapping,
    group,
    parameter,
    to_mapping,
)
from hdd_servo_ros.signals.reference import ReferenceParameters

PURE_NUMBERS = {
    'dsp.filters.low_pass.dampings',
    'dsp.filters.notch.dampings',
    'dsp.filters.resonant.dampings',
    'dsp.filters.resonant.gains',
    'dsp.filters.sections',
    'temperature.damping_scale',
    'temperature.frequency_scale',
    'rate',
    'duty_cycle',
    'shaping.share',
    'component_amplitudes',
    'component_frequencies',
    'actuator.amplifier_gain',
    'friction.stribeck_exponent',
    'friction.dahl_exponent',
    'friction.position_ripple',
    'resonance.numerators',
    'resonance.denominators',
    'resonance.damping_ratios',
    'resonance.residues',
    'travel.restitution',
    'network.width',
    'width.factor',
    'compensator.width',
    'damping_ratio',
    'runout.repeatable.sequence_cutoff',
    'flutter.damping_ratios',
    'vibration.rotational.recording_scale',
    'vibration.linear.recording_scale',
    'coupling.imbalance',
    'coupling.cubic',
    'missing.probability',
    'beam_damping_ratio',
    'gain_error',
    'gain_mismatch',
    'feedforward.initial_gain',
    'feedforward.step_size',
    'feedforward.leakage',
    'feedforward.weight_limit',
    'feedforward.model.imbalance',
    'feedforward.iir.step_size',
    'feedforward.iir.pole_radius',
    'feedforward.network.step_size',
    'feedforward.network.leakage',
    'feedforward.supervisor.tolerance',
    'feedforward.supervisor.gain_wanted',
    'seek.model.mode_spread',
    'seek.learning.gain_memory',
    'seek.learning.gain_range',
    'seek.learning.friction_range',
    'seek.ptos.discount',
    'seek.cnf.damping_ratio',
    'seek.cnf.start_share',
    'seek.cnf.settling_damping_ratio',
    'seek.cnf.steepness',
    'runout.orders',
    'runout.gain',
    'runout.initial_gain',
    'runout.wait',
}
"""Ratios, exponents, and lists with several units, which their descriptions state."""


@dataclasses.dataclass(frozen=True)
class Inner(ParameterSet):
    stiffness: float = parameter(1.0, 'stiffness', unit='V/um', above=0.0)
    level: float = parameter(2.0, 'level', unit='V', minimum=0.0, maximum=10.0)

    def check_together(self):
        if self.level < self.stiffness:
            raise ParameterError('level', self.level, 'at least stiffness')


@dataclasses.dataclass(frozen=True)
class Outer(ParameterSet):
    inner: Inner = group(Inner)
    count: int = parameter(3, 'count', minimum=1)
    gains: tuple[float, ...] = parameter((1.0, 2.0), 'gains')
    model: str = parameter('a', 'model', choices=('a', 'b'))
    on: bool = parameter(True, 'switch')


def test_names_are_dotted_and_go_round():
    names = [declaration.name for declaration in declarations(Outer)]
    assert names == ['inner.stiffness', 'inner.level', 'count', 'gains', 'model', 'on']
    values = from_mapping(Outer, {'inner.level': 5.0, 'gains': [3, 4.0], 'count': 7})
    assert values == Outer(inner=Inner(level=5.0), gains=(3.0, 4.0), count=7)
    assert from_mapping(Outer, to_mapping(values)) == values
    assert (
        from_mapping(Outer, {'gains': np.array([3.0, 4.0]), 'count': np.int64(7), 'inner.level': np.float64(5)})
        == values
    )


@pytest.mark.parametrize(
    ('name', 'value', 'allowed'),
    [
        ('inner.stiffness', 0.0, 'a finite number above 0 .V/um.'),
        ('inner.stiffness', math.nan, 'finite'),
        ('inner.level', math.inf, 'at least 0 and at most 10'),
        ('inner.level', 0.5, 'at least stiffness'),
        ('inner.level', '1', 'a finite number'),
        ('inner.level', True, 'a finite number'),
        ('count', 1.0, 'an integer at least 1'),
        ('count', 0, 'an integer at least 1'),
        ('gains', 1.0, 'a list, each element a finite number'),
        ('gains', [1.0, math.nan], 'a list, each element a finite number'),
        ('gains', 'text', 'a list'),
        ('model', 'c', 'one of a, b'),
        ('on', 1, 'true or false'),
    ],
)
def test_a_bad_value_is_rejected_by_name_value_and_what_is_allowed(name, value, allowed):
    with pytest.raises(ParameterError, match=allowed) as rejected:
        from_mapping(Outer, {name: value})
    assert rejected.value.name == name
    assert f'invalid value for parameter {name}: {value!r};' in str(rejected.value)
    assert str(pickle.loads(pickle.dumps(rejected.value))) == str(rejected.value)


def test_an_unknown_name_is_rejected_with_the_known_ones():
    with pytest.raises(
        ParameterError, match=r'unknown parameter inner\.absent; known: inner\.stiffness, inner\.level$'
    ):
        from_mapping(Outer, {'inner.absent': 1})
    with pytest.raises(ParameterError, match='unknown parameter absent; known: '):
        from_mapping(Outer, {'absent': 1})


@pytest.mark.parametrize('node', names_with_parameters())
def test_every_parameter_of_every_node_is_described(node):
    found = list(node_declarations(node))
    assert len({declaration.name for declaration in found}) == len(found)
    for declaration in found:
        assert declaration.description, declaration.name
        assert declaration.check(declaration.default) == declaration.default
        if declaration.element_type is float and declaration.name not in PURE_NUMBERS:
            assert declaration.unit, f'{node}: {declaration.name} has no unit'


def test_what_another_node_has_is_passed_over_and_a_typo_is_not():
    reject_unknown({'duration': 1.0, 'controller': 'pid'})
    with pytest.raises(ParameterError, match='did you mean duration'):
        reject_unknown({'durration': 1.0})


def test_a_set_of_before_is_taken_for_the_very_same_values_only():
    """Bit for bit and with their types, after others of equal value were accepted."""
    first = from_mapping(ReferenceParameters, {'offset': 0.0, 'component_amplitudes': (1.0,)})
    assert from_mapping(ReferenceParameters, {'offset': 0.0, 'component_amplitudes': (1.0,)}) is first
    negative = from_mapping(ReferenceParameters, {'offset': -0.0, 'component_amplitudes': (1.0,)})
    assert math.copysign(1.0, negative.offset) == -1.0
    assert math.copysign(1.0, first.offset) == 1.0
    assert from_mapping(ReferenceParameters, {'offset': 1}).offset == 1.0
    for value in (True, 'a', (1.0,), math.nan):
        for _ in range(2):
            with pytest.raises(ParameterError, match='offset'):
                from_mapping(ReferenceParameters, {'offset': value})
    with pytest.raises(ParameterError, match='component_amplitudes'):
        from_mapping(ReferenceParameters, {'component_amplitudes': (True,)})
    # The error has the name that was given.
    with pytest.raises(ParameterError, match=r'own\.offset'):
        from_mapping(ReferenceParameters, {'offset': True}, 'own.')


def test_a_set_from_outside_the_package_is_made_each_time():
    @dataclasses.dataclass
    class Own(ParameterSet):
        gain: float = parameter(1.0, 'a gain')

    first, second = (from_mapping(Own, {'gain': 2.0}) for _ in range(2))
    first.gain = 3.0
    assert second.gain == from_mapping(Own, {'gain': 2.0}).gain == 2.0
