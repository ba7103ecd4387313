"""Experiment: sections, errors, a custom controller, and tracking with the defaults."""

import numpy as np
import pytest

from hdd_servo_ros.analysis.metrics import tracking_metrics
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.simulation.experiment import Experiment

T = 1e-4


def metrics(rows, transient):
    return tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient)


class Outside:
    """A controller that satisfies the protocol and nothing more."""

    estimate_names = ('t', 'e')

    def __init__(self):
        self.estimates = np.zeros(2)

    def step(self, inputs):
        e = inputs.position - inputs.desired_position
        self.estimates[:] = inputs.tick * T, e
        u = -0.1 * e - 5e-5 * (inputs.velocity - inputs.desired_velocity)
        return u, u, u


def test_a_controller_from_outside():
    rows = Experiment(T, Outside()).run(0, 1500)
    assert rows.estimate_names == ('t', 'e')
    assert metrics(rows, 0.1).rms_error < 300.0
    np.testing.assert_array_equal(rows.estimates['t'], np.arange(1500) * T)


def test_an_object_with_the_former_arguments_of_step_is_rejected_with_advice():
    class Old(Outside):
        def step(self, tick, displacement_volts, velocity_volts, x_d, dx_d, ddx_d):  # type: ignore[override]
            return 0.0, 0.0, 0.0

    with pytest.raises(
        ParameterError,
        match=r"'Old'; Old\.step now takes one argument: inputs, with",
    ):
        Experiment(T, Old())  # type: ignore[arg-type]


OTHER_SENSOR = {'displacement_scale': 4.0, 'velocity_scale': 2000.0}


def test_a_controller_reads_the_sensor_by_its_own_scales_or_else_by_the_sensors():
    """Bit-identical with a power of two, if neither the noise nor the ADC depends on volts."""
    sections = {'ldv_sensor': {'noise': False, 'adc_bits': 0, 'output_range': 0.0}}
    other = {'ldv_sensor': {**sections['ldv_sensor'], 'displacement_scale': 4.0, 'velocity_scale': 2500.0}}
    for controller in ('adaptive_nn', 'pid'):
        usual, found = (Experiment(T, controller, each).run(0, 1000) for each in (sections, other))
        assert found['head'].tobytes() == usual['head'].tobytes()
        assert (found.ldv[1:, 0] == 2.0 * usual.ldv[1:, 0]).all()
        # With the usual scales it reads the motion as twice as large.
        wrong = {f'{controller}_controller': {'displacement_scale': 8.0, 'velocity_scale': 5000.0}}
        misread = Experiment(T, controller, {**other, **wrong}).run(0, 1000)
        assert misread['head'].tobytes() != usual['head'].tobytes()
        assert misread['control'].tobytes() != usual['control'].tobytes()


def test_a_controller_from_outside_tracks_alike_with_another_sensor():
    usual, other = (
        metrics(Experiment(T, Outside(), {'ldv_sensor': sensor}).run(0, 3000), 0.1) for sensor in ({}, OTHER_SENSOR)
    )
    assert other.rms_error == pytest.approx(usual.rms_error, rel=0.02)


class Absurd:
    """Asks for more than any drive takes."""

    estimate_names = ('t',)

    def __init__(self):
        self.estimates = np.zeros(1)

    def update(self, parameters):
        pass

    def step(self, inputs):
        return 8700.0, 8700.0, 8700.0


def test_a_command_above_the_drive_limit_is_not_held():
    rows = Experiment(1e-4, Absurd(), {'vcm_plant': {'control_limit': 3.0}}).run(0, 3)
    assert rows.control.tolist() == [[3.0, 8700.0, 8700.0]] * 3


def test_the_loop_in_python_equals_the_compiled_one():
    parameters = PidParameters()
    outside = Experiment(T, Pid(parameters, T))
    pieces = [outside.run(0, 700), outside.run(700, 800)]
    compiled = Experiment(T, 'pid').run(0, 1500)
    for name in ('reference', 'head', 'ldv', 'control', 'estimates'):
        together = np.concatenate([piece[name] for piece in pieces])
        assert together.tobytes() == compiled[name].tobytes()


def test_the_default_run_tracks():
    """10 s of the default: 2 µm at 100 Hz, and at 200 Hz; limits in nm."""
    for frequency, rms, largest in ((100.0, 8.0, 35.0), (200.0, 6.5, 25.0)):
        sections = {'reference_generator': {'frequency': frequency}}
        found = metrics(Experiment(T, 'adaptive_nn', sections).run(0, 100001), 2.0)
        assert found.rms_error < rms
        assert found.max_error < largest
        fair = metrics(Experiment(T, 'pid', sections).run(0, 100001), 2.0)
        assert found.rms_error < {100.0: 0.25, 200.0: 0.15}[frequency] * fair.rms_error


def test_a_minute_has_no_burst():
    """The error of no second after the second one exceeds 1.3 times that of the third."""
    experiment = Experiment(T)
    rows = experiment.run(0, 20000)
    errors = []
    for second in range(2, 60):
        rows = experiment.run(10000 * second, 10000, rows if second > 2 else None)
        errors.append(np.sqrt(np.mean((rows.head[:, 0] - rows.reference[:, 0]) ** 2)))
    assert max(errors) < 1.3 * errors[0]
    assert max(errors) < 0.010


def test_the_compensator_breaks_the_floor_and_lasts():
    sections = {'adaptive_nn_controller': {'compensator.enabled': True}}
    found = metrics(Experiment(T, 'adaptive_nn', sections).run(0, 600001), 2.0)
    assert found.rms_error < 4.0


@pytest.mark.parametrize(('height', 'settling'), [(0.5, 5e-3), (5.0, 3e-3)])
def test_steps_with_integral_action(height, settling):
    """Square wave of 10 Hz: overshoot, 2 % settling time, steady error of each rise, with lambda = 1500 1/s."""
    sections = {
        'reference_generator': {
            'waveform': 'square',
            'frequency': 10.0,
            'amplitude': 0.5 * height,
            'offset': 0.5 * height,
        },
        'adaptive_nn_controller': {'error_filter_lambda': 1500.0, 'integral_gain': 292500.0},
    }
    x = Experiment(T, 'adaptive_nn', sections).run(0, 20000).head[5000:, 0]
    for rise in x.reshape(15, 1000)[:, :500]:
        assert rise.max() <= 1.03 * height
        assert np.all(np.abs(rise[round(settling / T) :] - height) < 0.02 * height)
        assert abs(rise[250:].mean() - height) < 3e-3


def test_sections_reach_their_blocks():
    experiment = Experiment(
        T,
        'pid',
        {
            'reference_generator': {'amplitude': 1.0},
            'ldv_sensor': {'noise': False},
            'vcm_plant': {'friction.model': 'none', 'frame_id': 'a_drive'},
            'pid_controller': {'control_limit': 3.0},
            'deterministic_timer': {'rate': 1.0},
        },
    )
    assert experiment.reference.parameters.amplitude == 1.0
    assert not experiment.ldv.parameters.noise
    assert experiment.plant.parameters.friction.model == 'none'
    assert isinstance(experiment.controller, Pid)
    assert experiment.controller.parameters.control_limit == 3.0


def test_errors_name_node_and_parameter():
    with pytest.raises(ParameterError, match=r'ldv_sensor\.displacement_scale'):
        Experiment(T, 'pid', {'ldv_sensor': {'displacement_scale': 0.0}})
    with pytest.raises(ParameterError, match=r'adaptive_nn_controller\.network\.knots'):
        Experiment(T, 'adaptive_nn', {'adaptive_nn_controller': {'network.knots': 3}})
    with pytest.raises(ParameterError, match='controller'):
        Experiment(T, 'fuzzy')


def test_rows_by_name():
    rows = SignalRows.empty(5, 3, T, ('t', 'r'))
    rows['estimates'][:] = [[0, 1], [2, 3], [4, 5]]
    np.testing.assert_array_equal(rows.estimates['r'], [1, 3, 5])
    np.testing.assert_allclose(rows.time, [5e-4, 6e-4, 7e-4])
    with pytest.raises(KeyError, match='estimates: t, r'):
        rows.estimates['phi_hat']


def test_rows_are_written_again():
    experiment = Experiment(T, 'pid')
    first = experiment.run(0, 100)
    second = experiment.run(100, 100, first)
    assert second['head'] is first['head']
    assert second.first_tick == 100
    assert experiment.run(200, 50, second)['head'] is not second['head']


def test_ticks_follow_each_other():
    experiment = Experiment(T, 'pid')
    experiment.run(0, 10)
    with pytest.raises(ValueError, match='expected tick 10, got 11'):
        experiment.run(11, 5)
    assert experiment.run(10, 5).first_tick == 10
