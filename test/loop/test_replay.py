"""The replayed controller goes through the states of the recorded one."""

import numpy as np
import pytest

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.loop.experiment import Experiment
from hdd_servo_ros.loop.replay import ReplayError, replay_weights
from hdd_servo_ros.parameters import from_mapping

T = 1e-4
VALUES = {'compensator.enabled': True, 'width.enabled': True, 'velocity_source': 'difference'}
PARAMETERS = from_mapping(AdaptiveNnParameters, VALUES)


@pytest.fixture(scope='module')
def recorded():
    experiment = Experiment(T, 'adaptive_nn', {'adaptive_nn_controller': VALUES})
    rows = experiment.run(0, 9000)
    return rows, experiment.controller


def replayed(rows, parameters=PARAMETERS):
    return list(replay_weights(parameters, T, rows.reference, rows.ldv, rows.control, rows.estimates))


def test_weights_are_those_of_the_run(recorded):
    rows, controller = recorded
    pieces = replayed(rows)
    assert [piece.start for piece, _, _ in pieces] == [0, 8192]
    weights = np.concatenate([weights for _, weights, _ in pieces])
    compensator = np.concatenate([compensator for _, _, compensator in pieces])
    assert (weights.shape, compensator.shape) == ((9000, 25), (9000, 49))
    norms = np.sqrt((weights**2).sum(axis=1))
    np.testing.assert_allclose(norms, rows.estimate('W_norm'), rtol=1e-12)
    # One step more is where the controller of the run stands.
    last = AdaptiveNn(PARAMETERS, T)
    for tick in range(9000):
        last.step(tick, *rows.ldv[tick], *rows.reference[tick])
    np.testing.assert_array_equal(last.weights, controller.weights)
    np.testing.assert_array_equal(last.compensator_weights, controller.compensator_weights)


def test_a_record_that_does_not_fit_is_refused(recorded):
    rows, _ = recorded
    estimates = rows.estimates.copy()
    estimates[8500, 4] = np.nextafter(estimates[8500, 4], 1.0)
    with pytest.raises(ReplayError, match='tick 8500 phi_hat is'):
        list(replay_weights(PARAMETERS, T, rows.reference, rows.ldv, rows.control, estimates))
    with pytest.raises(ReplayError, match='at tick 0 position_width is'):
        replayed(rows, from_mapping(AdaptiveNnParameters, VALUES | {'network.width': (0.7,)}))
    with pytest.raises(ReplayError, match='3 estimates'):
        list(replay_weights(PARAMETERS, T, rows.reference, rows.ldv, rows.control, estimates[:, :3]))
