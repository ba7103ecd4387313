"""What the adaptive NN controller's node says of the estimates on /diagnostics."""

from types import SimpleNamespace

import pytest

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.nodes.adaptive_nn_controller import AdaptiveNnController
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.ros.diagnostics import OK, WARN


@pytest.mark.parametrize(
    ('values', 'level', 'said'),
    [
        ({}, OK, 'finite'),
        ({'phi.maximum': 1e-6}, WARN, 'at its bound: phi_hat'),
        ({'phi.maximum': 1e-6, 'projection': False}, OK, 'finite'),
        ({'phi.enabled': False}, OK, 'finite'),
    ],
)
def test_an_estimate_at_its_bound_is_told_of_where_it_takes_part(values, level, said):
    parameters = from_mapping(AdaptiveNnParameters, {'projection': True, **values})
    controller = AdaptiveNn(parameters, 1e-4)
    for tick in range(2):
        controller.step(tick, 0.0, 0.0, 1.0, 0.0, 0.0)
    node = SimpleNamespace(parameters={AdaptiveNnParameters: parameters}, _controller=controller)
    found = AdaptiveNnController._diagnose_adaptation(node)
    assert (found.level, said in found.message) == (level, True)
