"""Optional interfaces of the controllers of this package."""

import pytest

from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer, SignalAnalyzerParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.control.controller import HasPlan, KnowsOutputLimit, ReportsFault, WarnsBeforeRun
from hdd_servo_ros.control.open_loop import OpenLoop, OpenLoopParameters
from hdd_servo_ros.control.pid import Pid, PidParameters

T = 2e-5


@pytest.mark.parametrize(
    ('controller', 'expected'),
    [
        (AdaptiveNn(AdaptiveNnParameters(), T), {WarnsBeforeRun, KnowsOutputLimit}),
        (Pid(PidParameters(), T), {KnowsOutputLimit}),
        (OpenLoop(OpenLoopParameters(), T), {KnowsOutputLimit}),
        (SignalAnalyzer(SignalAnalyzerParameters(), T), {ReportsFault, HasPlan}),
    ],
)
def test_capabilities(controller, expected):
    protocols = (WarnsBeforeRun, KnowsOutputLimit, ReportsFault, HasPlan)
    assert {protocol for protocol in protocols if isinstance(controller, protocol)} == expected
