"""Weights of the adaptive NN controller at every tick of a recorded run, recovered by replaying it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.messages.exit_codes import UNREADABLE

Array = NDArray[np.float64]

_PIECE = 8192


class WeightReplayError(ValueError):
    """Replay that differs from the recording."""

    exit_code = UNREADABLE


def replay_weights(
    parameters: AdaptiveNnParameters,
    dsp: DspParameters,
    drive_limit: float,
    sample_time: float,
    scales: SensorScales,
    reference: Array,
    ldv: Array,
    control: Array,
    estimates: Array,
) -> Iterator[tuple[slice, Array, Array]]:
    """
    Iterate over a run in pieces: the ticks, W_hat and the compensator's weights as used at each tick.

    The weights are too many for a topic, but the controller is a function of its inputs: given the recorded inputs, it
    passes through bit-identical states, and its commands through the DSP's output give the same voltages. This is
    checked at every tick, for all recorded values.

    Parameters
    ----------
    parameters, dsp
        Parameters of the controller and of the DSP between its law and `/control`; neither changes during the run.
    drive_limit
        Largest magnitude of the drive's input voltage [V].
    sample_time
        T [s].
    scales
        Scales by which the controller reads the vibrometer.
    reference, ldv
        Rows of ticks 0 to N: x_d, dx_d, ddx_d; displacement and velocity output [V] (further columns are ignored).
    control, estimates
        Recorded `/control` (u, u before the limit and its feedback part), and estimates.

    Raises
    ------
    WeightReplayError
        If the replay differs from the recording; reports the tick and the signal.
    """
    controller = AdaptiveNn(parameters, sample_time)
    output = Dsp(dsp, sample_time, drive_limit)
    controller.limit_output(output.limit)
    names = controller.estimate_names
    replayed = np.empty((min(_PIECE, len(ldv)), len(names) + 3))
    recorded = np.column_stack((estimates, control))
    inputs = np.column_stack((ldv[:, :2], reference))
    if recorded.shape[1] != replayed.shape[1]:
        raise WeightReplayError(
            f'{estimates.shape[1]} estimates were recorded, but the law has {len(names)}; theorem 4.1 is about the law '
            'alone, without feedforward or observer'
        )
    for start in range(0, len(inputs), _PIECE):
        piece = slice(start, min(start + _PIECE, len(inputs)))
        weights = np.empty((piece.stop - start, len(controller.weights)))
        compensator = np.empty((piece.stop - start, len(controller.compensator_weights)))
        for row, values in enumerate(inputs[piece].tolist()):
            weights[row] = controller.weights
            compensator[row] = controller.compensator_weights
            replayed[row, -3:] = output.step(*controller.step(scales.inputs(start + row, *values)))
            replayed[row, :-3] = controller.estimates
        wrong = np.argwhere(replayed[: piece.stop - start] != recorded[piece])
        if len(wrong):
            row, column = (int(index) for index in wrong[0])
            name = (*names, 'u', 'u before the limit', '-k r')[column]
            raise WeightReplayError(
                f'the replayed controller differs from the recording: at tick {start + row} {name} is '
                f'{float(replayed[row, column])!r}, but {float(recorded[start + row, column])!r} was recorded'
            )
        yield piece, weights, compensator
