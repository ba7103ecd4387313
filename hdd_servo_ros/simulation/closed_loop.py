"""Closed loop as one compiled kernel: runs the blocks of an experiment tick by tick without calls to Python."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.accelerometer import AccelerometerArrays, accelerometer_step
from hdd_servo_ros.bench.dsp import DSP, QUARTERS, DspArrays, dsp_step
from hdd_servo_ros.bench.ldv import LdvArrays, fill_ldv_deviates, ldv_output
from hdd_servo_ros.bench.servo_sensor import ServoSensorArrays, servo_sensor_step
from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzerArrays, signal_analyzer_step
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnArrays, adaptive_nn_step
from hdd_servo_ros.control.feedforward import PlainArrays as FeedforwardArrays
from hdd_servo_ros.control.feedforward_kernel import feedforward_step
from hdd_servo_ros.control.observer import ObserverArrays, observer_step
from hdd_servo_ros.control.open_loop import OpenLoopArrays, open_loop_step
from hdd_servo_ros.control.pid import PidArrays, pid_step
from hdd_servo_ros.control.runout import PlainArrays as RunoutArrays
from hdd_servo_ros.control.runout_kernel import runout_step
from hdd_servo_ros.control.seek import PlainArrays as SeekArrays
from hdd_servo_ros.control.seek_kernel import seek_after_law, seek_before_law
from hdd_servo_ros.drive.plant import PlantArrays, multirate_plant_step, plant_output, plant_step
from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.signals.reference import ReferenceArrays, reference_step


class Controllers(NamedTuple):
    """
    Arrays of each built-in controller, by its short name; only those of the controller that runs are used.

    Numba compiles all branches of the kernel, so each branch needs arrays of the right type.
    """

    adaptive_nn: AdaptiveNnArrays
    pid: PidArrays
    open_loop: OpenLoopArrays
    signal_analyzer: SignalAnalyzerArrays


LINEAR_Y, ANGULAR_Z = (BASE_ACCELERATION.field_names.index(name) for name in ('linear_y', 'angular_z'))
"""Columns of the base acceleration that the accelerometers measure."""
ADAPTIVE_NN, PID, OPEN_LOOP, SIGNAL_ANALYZER = range(len(Controllers._fields))


@compiled
def closed_loop(
    first_tick: int,
    controller_kind: int,
    reference: ReferenceArrays,
    plant: PlantArrays,
    ldv: LdvArrays,
    displacement_scale: float,
    velocity_scale: float,
    servo: ServoSensorArrays,
    observer: ObserverArrays,
    controllers: Controllers,
    has_seek: bool,
    seek: SeekArrays,
    accelerometer: AccelerometerArrays,
    has_feedforward: bool,
    feedforward: FeedforwardArrays,
    has_runout: bool,
    runout: RunoutArrays,
    dsp: DspArrays,
    held: NDArray[np.float64],
    deviates: NDArray[np.float64],
    signals: Any,
) -> None:
    """
    Run consecutive ticks from ``first_tick`` on and write one row per tick.

    At tick k the head position results from u_{k-1} and the disturbance of tick k-1, both held over the last sample.
    The vibrometer or the servo sensor measures it, and the accelerometers measure the base acceleration of the last
    sample. The controller computes its output, the outputs of the blocks around it are added, and the DSP converts the
    sum to u_k. The kernel calls the same compiled functions as the ``step`` methods of the blocks, in the same order,
    so its rows are bit-identical to theirs. Only the vibrometer noise, which is a function of the tick, is generated in
    advance for all ticks.

    Parameters
    ----------
    first_tick
        First tick; a run may be split at any tick.
    controller_kind
        Index into the fields of :class:`Controllers`.
    reference, plant, ldv, dsp
        The ``arrays`` of the blocks: constants, and states (which are advanced).
    displacement_scale, velocity_scale
        Scales of the vibrometer outputs for the controller [um/V], [um/s/V]; 1 with the servo sensor.
    servo, observer
        The ``arrays`` of the servo sensor and of the velocity observer. They replace the vibrometer if there are rows
        for ``/pes``; ``/ldv`` then has no rows.
    controllers
        The ``arrays`` of the controllers; the last array of each contains its estimates.
    has_seek, seek, accelerometer, has_feedforward, feedforward, has_runout, runout, dsp
        The ``arrays`` of the blocks around the controller. The accelerometers are enabled by their rows; seek block,
        feedforward and runout cancellation are enabled by their flags.
    held
        Array of six values that are held until the next tick: u and disturbance [V], linear [m/s^2] and angular
        [rad/s^2] acceleration of the base, feedforward in u and in the last command [V].
    deviates
        Buffer for the noise deviates of the vibrometer, two per tick, shape (2 n,).
    signals
        :attr:`~hdd_servo_ros.messages.signals.SignalRows.kernel_arrays`: one array per topic, one row per tick.
    """
    reference_rows, head_rows, ldv_rows, control_rows, estimate_rows = signals[:5]
    disturbance_rows, base_rows, sensor_rows, pes_rows, update_rows = signals[5:]
    # The noise depends on the tick only, so generate it first: the compiler vectorizes such a short loop.
    has_servo = len(pes_rows) > 0
    if not has_servo:
        fill_ldv_deviates(ldv[0], first_tick, deviates)
    # Optional nodes are branches on conditions that are constant for all ticks.
    is_disturbed = len(disturbance_rows) > 0
    has_base_motion = len(base_rows) > 0
    has_accelerometer = len(sensor_rows) > 0
    is_multirate = len(update_rows) > 0
    updates = dsp[2]
    output_1, output_2 = 0.0, 0.0
    for row in range(len(head_rows)):
        tick = first_tick + row
        x_d, dx_d, ddx_d = reference_step(*reference, tick)
        if tick == 0:
            position, velocity, friction = plant_output(*plant)
        elif is_multirate:
            later = (updates[0, 0], updates[0, 1], updates[0, 2])
            position, velocity, friction = multirate_plant_step(*plant, tick, held[0], *later, held[1])
        else:
            position, velocity, friction = plant_step(*plant, tick, held[0], held[1])
        applied = updates[0, QUARTERS] if is_multirate else held[0]
        if has_servo:
            track_center = disturbance_rows[row, 1] if is_disturbed else 0.0
            error, displacement_volts, sector = servo_sensor_step(*servo, tick, position, track_center)
            # Exclude the feedforward: it cancels a force that the observer does not model.
            _, velocity_volts = observer_step(*observer, displacement_volts, applied - held[4])
            pes_rows[row, 0] = error
            pes_rows[row, 1] = displacement_volts
            pes_rows[row, 2] = sector
        else:
            displacement_volts, velocity_volts = ldv_output(
                *ldv, tick, position, velocity, deviates[2 * row], deviates[2 * row + 1]
            )
            ldv_rows[row, 0] = displacement_volts
            ldv_rows[row, 1] = velocity_volts
            ldv_rows[row, 2] = 0.0
        measured, rate = displacement_volts * displacement_scale, velocity_volts * velocity_scale
        if has_seek:
            offset, offset_rate = seek_before_law(*seek, measured, rate, x_d, dx_d, ddx_d, applied)
            measured -= offset
            rate -= offset_rate
            displacement_volts -= offset / displacement_scale
            velocity_volts -= offset_rate / velocity_scale
        # The fields of ControllerInputs, in order: numba cannot concatenate named tuples.
        inputs = (tick, measured, rate, displacement_volts, velocity_volts, x_d, dx_d, ddx_d)
        if controller_kind == ADAPTIVE_NN:
            u, unsaturated, feedback = adaptive_nn_step(*controllers.adaptive_nn, *inputs)
            estimates = controllers.adaptive_nn[-1]
        elif controller_kind == PID:
            u, unsaturated, feedback = pid_step(*controllers.pid, *inputs)
            estimates = controllers.pid[-1]
        elif controller_kind == SIGNAL_ANALYZER:
            u, unsaturated, feedback = signal_analyzer_step(*controllers.signal_analyzer, *inputs)
            estimates = controllers.signal_analyzer[-1]
        else:
            u, unsaturated, feedback = open_loop_step(*controllers.open_loop, *inputs)
            estimates = controllers.open_loop[-1]
        if has_accelerometer:
            output_1, output_2 = accelerometer_step(*accelerometer, tick, held[2], held[3], held[0])
            sensor_rows[row, 0] = output_1
            sensor_rows[row, 1] = output_2
            sensor_rows[row, 2] = 0.0
        column = _write(estimates, estimate_rows, row, 0)
        if has_seek:
            u_seek = seek_after_law(*seek, u)
            u += u_seek
            unsaturated += u_seek
            column = _write(seek[-1], estimate_rows, row, column)
        if has_feedforward:
            u_ff = feedforward_step(*feedforward, measured - x_d, output_1, output_2)
            u += u_ff
            unsaturated += u_ff
            column = _write(feedforward[-1], estimate_rows, row, column)
            held[4] = held[5] if record(dsp[0], DSP).delay > 0.0 else u_ff
            held[5] = u_ff
        if has_runout:
            u_rro = runout_step(*runout, tick, measured - x_d)
            u += u_rro
            unsaturated += u_rro
            column = _write(runout[-1], estimate_rows, row, column)
        if has_servo:
            _write(observer[-1], estimate_rows, row, column)
        u, unsaturated, feedback = dsp_step(*dsp, u, unsaturated, feedback)
        held[0] = u
        held[1] = disturbance_rows[row, 0] if is_disturbed else 0.0
        if has_base_motion:
            held[2] = base_rows[row, LINEAR_Y]
            held[3] = base_rows[row, ANGULAR_Z]
        reference_rows[row, 0] = x_d
        reference_rows[row, 1] = dx_d
        reference_rows[row, 2] = ddx_d
        head_rows[row, 0] = position
        head_rows[row, 1] = velocity
        head_rows[row, 2] = friction
        control_rows[row, 0] = u
        control_rows[row, 1] = unsaturated
        control_rows[row, 2] = feedback
        if is_multirate:
            for j in range(QUARTERS):
                update_rows[row, j] = updates[0, j]


@compiled
def _write(estimates: NDArray[np.float64], rows: NDArray[np.float64], row: int, column: int) -> int:
    """Write the estimates of a block, starting at a column; return the next free column."""
    for i in range(len(estimates)):
        rows[row, column + i] = estimates[i]
    return column + len(estimates)
