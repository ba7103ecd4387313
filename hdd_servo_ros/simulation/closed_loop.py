"""The closed loop as one compiled kernel: the blocks of one experiment, tick by tick, without a call from Python."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.dsp import dsp_step
from hdd_servo_ros.bench.ldv import ldv_step
from hdd_servo_ros.bench.signal_analyzer import signal_analyzer_step
from hdd_servo_ros.control.adaptive_nn import adaptive_nn_step
from hdd_servo_ros.control.open_loop import open_loop_step
from hdd_servo_ros.control.pid import pid_step
from hdd_servo_ros.drive.plant import plant_output, plant_step
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.signals.reference import reference_step

CONTROLLERS = ('adaptive_nn', 'pid', 'open_loop', 'signal_analyzer')
ADAPTIVE_NN, PID, OPEN_LOOP, SIGNAL_ANALYZER = range(len(CONTROLLERS))


@compiled
def closed_loop(
    first_tick: int,
    count: int,
    controller_kind: int,
    reference_constants: NDArray[np.float64],
    reference_state: NDArray[np.float64],
    plant_constants: NDArray[np.float64],
    plant_state: NDArray[np.float64],
    ldv_constants: NDArray[np.float64],
    ldv_state: NDArray[np.float64],
    controller_constants: NDArray[np.float64],
    controller_state: NDArray[np.float64],
    dsp_constants: NDArray[np.float64],
    dsp_state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    held: NDArray[np.float64],
    reference_out: NDArray[np.float64],
    head_out: NDArray[np.float64],
    ldv_out: NDArray[np.float64],
    control_out: NDArray[np.float64],
    estimates_out: NDArray[np.float64],
) -> None:
    """
    Run ticks ``first_tick`` to ``first_tick + count - 1`` and write one row a tick.

    At tick k the head is where u_{k-1}, held over the last sample, has brought it; the vibrometer reads it, the
    controller answers, and the DSP makes u_k of it. The kernel calls the very kernels that the blocks' ``step`` calls,
    in the same order, so its rows equal theirs to the bit.

    Parameters
    ----------
    first_tick, count
        Which ticks; a run may be cut anywhere.
    controller_kind
        Index into ``CONTROLLERS``.
    reference_constants ... dsp_state
        Constants and states of the blocks; the states are advanced.
    estimates
        The controller's array of estimates.
    held
        Array of one element: u_{k-1} [V] before, u of the last tick after.
    reference_out, head_out, ldv_out, control_out, estimates_out
        Rows of the ticks, of shape (count, 3), (count, 3), (count, 2), (count, 3), (count, len(estimates)).
    """
    for row in range(count):
        tick = first_tick + row
        x_d, dx_d, ddx_d = reference_step(reference_constants, reference_state, tick)
        if tick == 0:
            position, velocity, friction = plant_output(plant_constants, plant_state)
        else:
            position, velocity, friction = plant_step(plant_constants, plant_state, tick, held[0], 0.0)
        displacement_volts, velocity_volts = ldv_step(ldv_constants, ldv_state, tick, position, velocity)
        if controller_kind == ADAPTIVE_NN:
            u, unsaturated, feedback = adaptive_nn_step(
                controller_constants,
                controller_state,
                estimates,
                tick,
                displacement_volts,
                velocity_volts,
                x_d,
                dx_d,
                ddx_d,
            )
        elif controller_kind == PID:
            u, unsaturated, feedback = pid_step(
                controller_constants,
                controller_state,
                estimates,
                tick,
                displacement_volts,
                velocity_volts,
                x_d,
                dx_d,
                ddx_d,
            )
        elif controller_kind == SIGNAL_ANALYZER:
            u, unsaturated, feedback = signal_analyzer_step(
                controller_constants,
                controller_state,
                estimates,
                tick,
                displacement_volts,
                velocity_volts,
                x_d,
                dx_d,
                ddx_d,
            )
        else:
            u, unsaturated, feedback = open_loop_step(
                controller_constants,
                controller_state,
                estimates,
                tick,
                displacement_volts,
                velocity_volts,
                x_d,
                dx_d,
                ddx_d,
            )
        u, unsaturated, feedback = dsp_step(dsp_constants, dsp_state, u, unsaturated, feedback)
        held[0] = u
        reference_out[row, 0] = x_d
        reference_out[row, 1] = dx_d
        reference_out[row, 2] = ddx_d
        head_out[row, 0] = position
        head_out[row, 1] = velocity
        head_out[row, 2] = friction
        ldv_out[row, 0] = displacement_volts
        ldv_out[row, 1] = velocity_volts
        control_out[row, 0] = u
        control_out[row, 1] = unsaturated
        control_out[row, 2] = feedback
        for i in range(len(estimates)):
            estimates_out[row, i] = estimates[i]
