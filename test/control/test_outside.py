"""Adapter of custom controllers: passed values, added values and error messages."""

import dataclasses
import math

import numpy as np
import pytest

from hdd_servo_ros.control.controller import HasPlan, KnowsOutputLimit, ReportsFault, WarnsBeforeRun
from hdd_servo_ros.control.outside import ControllerError, OutsideController
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

T = 2.5e-4
CAPABILITIES = (WarnsBeforeRun, KnowsOutputLimit, ReportsFault, HasPlan)


@dataclasses.dataclass(frozen=True)
class Gain(ParameterSet):
    gain: float = parameter(2.0, 'a gain', unit='V/um', minimum=0.0)


class Proportional:
    def __init__(self, parameters, sample_time):
        self.update(parameters)

    def update(self, parameters):
        self.parameters = parameters

    def step(self, inputs):
        return self.parameters.gain * (inputs.desired_position - inputs.position)


def answering(answer):
    """Return a controller whose step returns an answer, or raises it."""

    class Answering(Proportional):
        def step(self, inputs):
            if isinstance(answer, BaseException):
                raise answer
            return answer

    return OutsideController('mine', Answering, Gain(), T)


def step(controller, tick=0):
    return controller.step(SensorScales(1.0, 1.0).inputs(tick, 0.5, 0.0, 2.0, 0.0, 0.0))


def test_a_voltage_stands_for_all_three_and_the_time_is_added():
    controller = OutsideController('mine', Proportional, Gain(), T)
    assert step(controller, 7) == (3.0, 3.0, 3.0)
    assert controller.estimate_names == ('t',)
    assert controller.estimates.tolist() == [7 * T]
    controller.update(Gain(gain=4.0))
    assert step(controller, 8) == (6.0, 6.0, 6.0)


@pytest.mark.parametrize('answer', [1, 1.0, np.float64(1.0), np.float32(1.0), np.int64(1), (1, 1.0, np.float64(1.0))])
def test_any_real_number_will_do(answer):
    assert step(answering(answer)) == (1.0, 1.0, 1.0)
    assert all(type(number) is float for number in step(answering(answer)))


def test_three_voltages_keep_their_order():
    assert step(answering((1.0, 2.0, 3.0))) == (1.0, 2.0, 3.0)


def test_what_is_not_finite_is_passed_on_for_the_topic_to_reject():
    assert math.isnan(step(answering(math.nan))[0])


@pytest.mark.parametrize('answer', [None, '1', True, 1j, (1.0, 2.0), (1.0, 2.0, None), np.array([1.0, 2.0, 3.0])])
def test_anything_else_is_rejected(answer):
    with pytest.raises(ControllerError, match=r'^mine: step returned .* not the voltage u, .* at tick 41$') as rejected:
        step(answering(answer), 41)
    assert rejected.value.tick == 41


def test_an_exception_is_told_in_one_line_with_its_place():
    with pytest.raises(ControllerError) as rejected:
        step(answering(ValueError('no\n  good')), 3)
    said = str(rejected.value)
    assert said.startswith('mine: step raised ValueError: no good (')
    assert f'{__file__}:' in said
    assert said.endswith(' at tick 3')


def test_a_step_that_would_end_the_process_is_told_as_an_exception():
    with pytest.raises(ControllerError, match=r'^mine: step raised SystemExit: 3 \(.* at tick 7$'):
        step(answering(SystemExit(3)), 7)


def test_a_failing_update_names_the_last_tick():
    class Stubborn(Proportional):
        def update(self, parameters):
            if parameters.gain > 2.0:
                raise ValueError('too much')
            super().update(parameters)

    controller = OutsideController('mine', Stubborn, Gain(), T)
    step(controller, 12)
    with pytest.raises(ControllerError, match=r'mine: update raised ValueError: too much .* at tick 12'):
        controller.update(Gain(gain=3.0))


@pytest.mark.parametrize(('names', 'expected'), [(('e', 'n'), ('t', 'e', 'n')), (('t', 'e'), ('t', 'e'))])
def test_estimates_get_the_time_in_front_unless_it_is_there(names, expected):
    class Estimating(Proportional):
        estimate_names = names

        def step(self, inputs):
            self.estimates = [0.25 * inputs.tick, inputs.tick]
            return 0.0

    controller = OutsideController('mine', Estimating, Gain(), T)
    step(controller, 8)
    assert controller.estimate_names == expected
    # The time is that of the tick, independent of the class.
    assert controller.estimates.tolist() == ([8 * T, 2.0, 8.0] if names[0] == 'e' else [8 * T, 8.0])


@pytest.mark.parametrize('estimates', [None, [1.0], [1.0, 'x'], [[1.0, 2.0]]])
def test_estimates_of_another_shape_are_rejected(estimates):
    class Estimating(Proportional):
        estimate_names = ('e', 'n')

        def step(self, inputs):
            self.estimates = estimates
            return 0.0

    with pytest.raises(ControllerError, match=r'mine: estimates = .* are not the 2 numbers e, n at tick 5'):
        step(OutsideController('mine', Estimating, Gain(), T), 5)


def test_names_of_estimates_must_be_names():
    class Estimating(Proportional):
        estimate_names = 'error'

    with pytest.raises(ParameterError, match="a class whose estimate_names are a tuple of strings, not 'error'"):
        OutsideController('mine', Estimating, Gain(), T)


def test_a_constructor_that_raises():
    class Broken(Proportional):
        def __init__(self, parameters, sample_time):
            raise RuntimeError('out of order')

    with pytest.raises(ParameterError, match='it raised RuntimeError: out of order'):
        OutsideController('mine', Broken, Gain(), T)


def test_the_limit_behind_it_is_told_to_those_who_want_to_know():
    class Knowing(Proportional):
        def limit_output(self, limit):
            self.limit = 1.0 / limit

        def step(self, inputs):
            return self.limit

    controller = OutsideController('mine', Knowing, Gain(), T)
    controller.limit_output(0.5)
    assert step(controller)[0] == 2.0
    with pytest.raises(ControllerError, match=r'mine: limit_output raised ZeroDivisionError.* at tick 0'):
        controller.limit_output(0.0)


def test_it_can_do_what_the_class_can_do_and_no_more():
    class Cautious(Proportional):
        def warnings(self):
            return ('mind the gain',)

    class Knowing(Proportional):
        def limit_output(self, limit):
            pass

    class Explaining(Proportional):
        def fault(self):
            return 'the head is\n lost'

    class Planning(Proportional):
        def __init__(self, parameters, sample_time):
            super().__init__(parameters, sample_time)
            self.last_tick = np.int64(round(0.5 / sample_time))

    found = {
        kind: [isinstance(OutsideController('mine', kind, Gain(), T), protocol) for protocol in CAPABILITIES]
        for kind in (Proportional, Cautious, Knowing, Explaining, Planning)
    }
    assert found == {
        Proportional: [False, False, False, False],
        Cautious: [True, False, False, False],
        Knowing: [False, True, False, False],
        Explaining: [False, False, True, False],
        Planning: [False, False, False, True],
    }
    assert OutsideController('mine', Cautious, Gain(), T).warnings() == ('mind the gain',)
    assert OutsideController('mine', Explaining, Gain(), T).fault() == 'the head is lost'
    assert OutsideController('mine', Planning, Gain(), T).last_tick == 2000


@pytest.mark.parametrize(
    ('body', 'said'),
    [
        (lambda self: 3, 'mine: fault returned 3, not a string, at tick 4'),
        (lambda self: 1 / 0, 'mine: fault raised ZeroDivisionError'),
    ],
)
def test_a_fault_that_is_no_text_is_the_reason_then(body, said):
    controller = OutsideController('mine', type('Faulty', (Proportional,), {'fault': body}), Gain(), T)
    step(controller, 4)
    assert controller.fault().startswith(said)


@pytest.mark.parametrize('answer', ['mind the gain', None, 3, ['mind', 3]])
def test_warnings_are_texts(answer):
    kind = type('Cautious', (Proportional,), {'warnings': lambda self: answer})
    controller = OutsideController('mine', kind, Gain(), T)
    with pytest.raises(
        ControllerError, match=r'^mine: warnings returned .*, not a list or tuple of strings, at tick 0$'
    ):
        controller.warnings()


def test_warnings_that_raise_are_told_in_one_line():
    class Cautious(Proportional):
        def warnings(self):
            yield 'mind the gain'
            raise ValueError('no\n more')

    with pytest.raises(ControllerError, match=r'^mine: warnings raised ValueError: no more \(.* at tick 0$'):
        OutsideController('mine', Cautious, Gain(), T).warnings()


@pytest.mark.parametrize('attribute', ['limit_output', 'warnings', 'fault'])
def test_what_is_to_be_a_method_must_be_one(attribute):
    said = rf"'mine'; expected a class whose {attribute} is a method {attribute}\("
    with pytest.raises(ParameterError, match=said):
        OutsideController('mine', type('Odd', (Proportional,), {attribute: 3}), Gain(), T)


@pytest.mark.parametrize('tick', [-1, 1.0, None, True])
def test_a_plan_ends_at_a_tick(tick):
    with pytest.raises(ParameterError, match=r"'mine'; expected a class whose last_tick is an integer at least 0"):
        OutsideController('mine', type('Planning', (Proportional,), {'last_tick': tick}), Gain(), T)


def test_a_controller_of_the_full_protocol_goes_through_unchanged():
    inner = Pid(PidParameters(), T)
    outer = OutsideController('mine', Pid, PidParameters(), T)
    for tick in range(50):
        inputs = SensorScales(8.0, 5000.0).inputs(tick, 0.01 * tick, 0.02 * tick, 1.0, 2.0, 3.0)
        assert outer.step(inputs) == inner.step(inputs)
        assert outer.estimates.tobytes() == inner.estimates.tobytes()
    assert outer.estimate_names == inner.estimate_names
