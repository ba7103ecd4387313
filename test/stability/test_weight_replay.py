"""The replayed controller goes through the states of the recorded one."""

import numpy as np
import pytest

from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.adaptive_nn_parameters import BARE_LAW
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.stability.weight_replay import WeightReplayError, replay_weights

T = 1e-4
SCALES = SensorScales(8.0, 5000.0)
VALUES = {**BARE_LAW, 'compensator.enabled': True, 'width.enabled': True, 'velocity_source': 'difference'}
PARAMETERS = from_mapping(AdaptiveNnParameters, VALUES)
NO_DSP = DspParameters()


@pytest.fixture(scope='module')
def recorded():
    experiment = Experiment(T, 'adaptive_nn', {'adaptive_nn_controller': VALUES})
    rows = experiment.run(0, 9000)
    return rows, experiment.controller


def replayed(rows, parameters=PARAMETERS, dsp=NO_DSP, **other):
    signals = {name: rows[name] for name in ('reference', 'ldv', 'control', 'estimates')} | other
    return list(replay_weights(parameters, dsp, 10.0, T, SCALES, **signals))


def test_weights_are_those_of_the_run(recorded):
    rows, controller = recorded
    pieces = replayed(rows)
    assert [piece.start for piece, _, _ in pieces] == [0, 8192]
    weights = np.concatenate([weights for _, weights, _ in pieces])
    compensator = np.concatenate([compensator for _, _, compensator in pieces])
    assert (weights.shape, compensator.shape) == ((9000, 25), (9000, 49))
    norms = np.sqrt((weights**2).sum(axis=1))
    np.testing.assert_allclose(norms, rows.estimates['W_norm'], rtol=1e-12)
    # After one more step the replayed controller is in the state of the run's controller.
    last = AdaptiveNn(PARAMETERS, T)
    for tick in range(9000):
        last.step(SCALES.inputs(tick, *rows.ldv[tick, :2], *rows.reference[tick]))
    np.testing.assert_array_equal(last.weights, controller.weights)
    np.testing.assert_array_equal(last.compensator_weights, controller.compensator_weights)


def test_a_record_that_does_not_fit_is_rejected(recorded):
    rows, _ = recorded
    estimates = rows['estimates'].copy()
    estimates[8500, 4] = np.nextafter(estimates[8500, 4], 1.0)
    with pytest.raises(WeightReplayError, match='tick 8500 phi_hat is'):
        replayed(rows, estimates=estimates)
    with pytest.raises(WeightReplayError, match='at tick 0 position_width is'):
        replayed(rows, from_mapping(AdaptiveNnParameters, VALUES | {'network.width': (0.7,)}))
    with pytest.raises(WeightReplayError, match='3 estimates'):
        replayed(rows, estimates=estimates[:, :3])


@pytest.mark.parametrize(
    'values',
    [
        {'computation_delay': 1},
        {'updates_per_sample': 4, 'interpolation': 'linear'},
        {'filters.notch.frequencies': (4500.0,)},
        {'dac_bits': 16, 'dac_range': 10.0},
        {'dac_range': 0.05},
        {'computation_delay': 1, 'dac_bits': 6, 'dac_range': 0.05},
    ],
)
def test_a_run_through_the_dsp_is_replayed_to_the_bit(values, recorded):
    section = VALUES | {f'dsp.{name}': value for name, value in values.items()}
    rows = Experiment(T, 'adaptive_nn', {'adaptive_nn_controller': section}).run(0, 3000)
    ideal, _ = recorded
    assert (rows.control[:, 0] != ideal.control[:3000, 0]).any()
    dsp = from_mapping(DspParameters, values)
    # It raises if a single bit of a recorded number differs.
    assert sum(len(weights) for _, weights, _ in replayed(rows, dsp=dsp)) == 3000
    with pytest.raises(WeightReplayError, match='the replayed controller differs from the recording'):
        replayed(rows)
    control = rows.control.copy()
    control[2500, 0] = np.nextafter(control[2500, 0], 1.0)
    with pytest.raises(WeightReplayError, match='at tick 2500 u is'):
        replayed(rows, dsp=dsp, control=control)
