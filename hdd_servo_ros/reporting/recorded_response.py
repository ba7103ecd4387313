"""The frequency response of a recorded run of the signal analyzer, recomputed from its bag."""

from collections.abc import Mapping
from typing import Any

from hdd_servo_ros.bench.response import FrequencyResponse
from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer
from hdd_servo_ros.graph.block_parameters import block_parameters, input_parameters, sensor_scales
from hdd_servo_ros.graph.recorded_nodes import recorded_parameters
from hdd_servo_ros.messages.topics import ESTIMATES, LDV
from hdd_servo_ros.recording.recorded_run import RecordedRun


def response_of_run(run: RecordedRun) -> FrequencyResponse:
    """
    Return the measured response of a run, from `/ldv` and the parameters.

    Raises
    ------
    ValueError
        If the run is not a sweep from tick 0, or its `/estimates` disagree.
    """
    analyzer = SignalAnalyzer(
        block_parameters('signal_analyzer', node_parameters(run, 'signal_analyzer')), run.sample_time
    )
    if not run.is_long and (len(run.ticks) == 0 or run.ticks[0] != 0):
        raise ValueError('the bag does not start at tick 0')
    own = input_parameters('signal_analyzer', node_parameters(run, 'signal_analyzer'))
    sensor = block_parameters('ldv_sensor', node_parameters(run, 'ldv_sensor'))
    recorded: Mapping[str, Any] = {}
    for piece in run.pieces([LDV.name, ESTIMATES.name]):
        analyzer.replay(piece.ldv, *sensor_scales(own, sensor), first_tick=int(piece.ticks[0]))
        recorded = piece.estimates
    for name, value in zip(analyzer.estimate_names, analyzer.estimates.tolist(), strict=True):
        if recorded[name][-1] != value:
            raise ValueError(f'/estimates has {name} = {recorded[name][-1]!r} at the end, /ldv gives {value!r}')
    measured = analyzer.response()
    return measured.at(measured.is_seen)


def node_parameters(run: RecordedRun, name: str) -> Mapping[str, object]:
    """Return the parameters of a node from ``run.yaml``; raises ValueError for an unknown node."""
    found = recorded_parameters(run.description)
    if name not in found:
        raise ValueError(f'run.yaml has no {name}')
    return found[name]
